"""Maps and scenarios of the MAPF benchmarks (`.map`, `.scen`): blocked cells as zones, agents as UAVs."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import PurePath

from edc_swarm.errors import FormatError
from edc_swarm.formats.cells import Cell, Loop, component_of, components, loops, polygons
from edc_swarm.formats.content import Area, Content, Options, Point, Route, Stop
from edc_swarm.formats.fence import lines_of
from edc_swarm.mission.field_types import MAX_CORNERS, MAX_ZONES

FREE = ".GS"
"""Ground and swamp, which agents of the benchmarks pass."""
BLOCKED = "@OTW"
"""Out of bounds, trees and water."""
MAX_CELLS = 1 << 20
RADIUS_CELLS = 0.2
"""Radius of a disc in cells, if the user gives none: two UAVs pass each other in a corridor of one cell."""


@dataclass(frozen=True, slots=True)
class Grid:
    """A map: its size in cells and its free cells; row 0 of the file is the northernmost."""

    width: int
    height: int
    free: set[Cell]


@dataclass(frozen=True, slots=True)
class Agent:
    """One agent of a scenario, with the line that states it, its map, and its cells as (column, row) of the grid."""

    item: str
    map_name: str
    start: Cell
    goal: Cell


def read_map(data: bytes, options: Options) -> Content:
    """Return the zones of a map without a scenario.

    Raises
    ------
    FormatError
    """
    content = Content(frame="local")
    grid = _grid(data, content)
    largest = max(components(grid.free), key=len, default=set())
    content.areas = _areas(grid, [largest], options, content)
    return content


def read_mapf(map_data: bytes, scenario_data: bytes, map_name: str, options: Options) -> Content:
    """Return the zones of a map, and a route per agent of the first `options.agents` agents of a scenario.

    Raises
    ------
    FormatError
        With `file` set to `map_name` if the map is at fault.
    """
    content = Content(frame="local")
    try:
        grid = _grid(map_data, content)
    except FormatError as error:
        raise error.of(map_name) from None
    agents = _agents(scenario_data, grid)
    own = PurePath(map_name).name
    if others := [agent.item for agent in agents if PurePath(agent.map_name).name != own]:
        content.note(f"the scenario names another map than {own}", *others)
    if len(agents) > options.agents:
        content.note("agents beyond --agents", *(agent.item for agent in agents[options.agents :]))
        agents = agents[: options.agents]
    parts: list[set[Cell]] = []
    for agent in agents:
        part = next((part for part in parts if agent.start in part), None)
        if part is None:
            part = component_of(agent.start, grid.free)
            parts.append(part)
        if agent.goal not in part:
            raise FormatError(agent.item, "the goal: must be reachable from the start")
    content.areas = _areas(grid, parts, options, content)
    for agent in agents:
        stops = [
            Stop(f"{agent.item} {name}", _middle(cell, options))
            for name, cell in (("start", agent.start), ("goal", agent.goal))
        ]
        content.routes.append(Route(agent.item, stops, r_m=RADIUS_CELLS * options.cell_m))
    return content


def _grid(data: bytes, content: Content) -> Grid:
    lines = [line.rstrip() for line in lines_of(data)]
    header: dict[str, str] = {}
    for number, line in enumerate(lines, 1):
        key, _, value = line.partition(" ")
        if key == "map":
            break
        wanted = {"type", "height", "width"} - header.keys()
        if key not in wanted or (key == "type" and value.strip() != "octile"):
            raise FormatError(f"line {number}", f"{line[:40]!r}: must be type octile, height, width or map, each once")
        header[key] = value.strip()
    else:
        raise FormatError("", "must have a line 'map'")
    width, height = (_size(header, key) for key in ("width", "height"))
    if width * height > MAX_CELLS:
        raise FormatError("", f"{width} x {height} cells: must be at most {MAX_CELLS}")
    rows = lines[number : number + height]
    if len(rows) < height or any(lines[number + height :]):
        raise FormatError("", f"rows of the map: must be {height}, as height says")
    for index, row in enumerate(rows, number + 1):
        if len(row) != width:
            raise FormatError(f"line {index}", f"{len(row)} cells: must be {width}")
        if wrong := set(row) - set(FREE + BLOCKED):
            raise FormatError(f"line {index}", f"cell {min(wrong)!r}: must be one of {' '.join(FREE + BLOCKED)}")
    counts = Counter("".join(rows))
    for kind, said in (("S", "swamp, flown over"), ("T", "trees, blocked"), ("W", "water, blocked")):
        if counts[kind]:
            content.note(f"terrain {kind}: {said}", f"{counts[kind]} cells")
    free = {
        (column, height - 1 - row) for row, line in enumerate(rows) for column, cell in enumerate(line) if cell in FREE
    }
    if not free:
        raise FormatError("", "must have a free cell")
    return Grid(width, height, free)


def _size(header: dict[str, str], key: str) -> int:
    text = header.get(key, "")
    if not (text.isascii() and text.isdigit() and 0 < len(text) < 8 and int(text) > 0):
        raise FormatError(key, f"{text[:40]!r}: must be a whole number from 1")
    return int(text)


def _agents(data: bytes, grid: Grid) -> list[Agent]:
    agents = []
    for number, line in enumerate(lines_of(data), 1):
        parts = line.split()
        if not parts or (number == 1 and parts[0] == "version"):
            continue
        place = f"line {number}"
        if len(parts) < 9:
            raise FormatError(place, f"{len(parts)} columns: must be 9")
        width, height, *numbers = (_coordinate(place, text) for text in parts[-7:-1])
        if (width, height) != (grid.width, grid.height):
            raise FormatError(place, f"map of {width} x {height} cells: must be {grid.width} x {grid.height}")
        start = _cell(place, "start", numbers[0], numbers[1], grid)
        goal = _cell(place, "goal", numbers[2], numbers[3], grid)
        agents.append(Agent(place, " ".join(parts[1:-7]), start, goal))
        if len(agents) > MAX_CELLS:
            raise FormatError("", f"agents: must be at most {MAX_CELLS}")
    if not agents:
        raise FormatError("", "must hold at least one agent")
    return agents


def _coordinate(place: str, text: str) -> int:
    if text.isascii() and text.isdigit() and len(text) < 8:
        return int(text)
    raise FormatError(place, f"{text[:40]!r}: must be a whole number")


def _cell(place: str, name: str, column: int, row: int, grid: Grid) -> Cell:
    cell = (column, grid.height - 1 - row)
    if cell not in grid.free:
        raise FormatError(place, f"{name} = column {column}, row {row}: must be a free cell of the map")
    return cell


def _middle(cell: Cell, options: Options) -> Point:
    return (cell[0] + 0.5) * options.cell_m, (cell[1] + 0.5) * options.cell_m


def _areas(grid: Grid, parts: list[set[Cell]], options: Options, content: Content) -> list[Area]:
    """Return the zones that leave just `parts` of the free cells: a fence, and exclusions for all other cells."""
    flown = set().union(*parts)
    if closed := len(grid.free) - len(flown):
        content.note("free cells that no UAV can reach: they are closed", f"{closed} cells")
    fence: Loop = [(0, 0), (grid.width, 0), (grid.width, grid.height), (0, grid.height)]
    others = {(column, row) for column in range(grid.width) for row in range(grid.height)} - flown
    loops_out: list[Loop] = []
    for part in components(others):
        _, holes = loops(part)
        if len(parts) == 1 and len(holes) == 1 and len(holes[0]) <= MAX_CORNERS:
            fence = holes[0][::-1]  # The cells around everything that is flown.
        else:
            loops_out += polygons(part, MAX_CORNERS)
    if len(loops_out) >= MAX_ZONES:
        raise FormatError("", f"{len(loops_out) + 1} zones of its cells: must be at most {MAX_ZONES}")
    areas = [Area("the map", "map", "inclusion", _metres(fence, options), keep="disc")]
    return areas + [
        Area(f"block {number}", f"block {number}", "exclusion", _metres(loop, options))
        for number, loop in enumerate(sorted(loops_out), 1)
    ]


def _metres(loop: Loop, options: Options) -> list[Point]:
    return [(column * options.cell_m, row * options.cell_m) for column, row in loop]
