"""Missions in which one UAV would have to pass another where zones leave no room."""

from __future__ import annotations

import math
import re
from random import Random
from typing import Any

import pytest
from shapely.geometry import Polygon, box
from shapely.ops import unary_union

from edc_swarm.errors import MissionError
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.passing import check_passing, tight_passing
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.mission.zone import Zone
from tests.builders import entry, mission

Cell = tuple[int, int]

SIDES = [(0, 1), (1, 0), (0, -1), (-1, 0)]
ALLEY = [(0.0, 0.0), (90.0, 0.0), (90.0, 11.0), (0.0, 11.0)]
NICHE = [(0.0, 0.0), (90.0, 0.0), (90.0, 11.0), (52.0, 11.0), (52.0, 24.0), (40.0, 24.0), (40.0, 11.0), (0.0, 11.0)]
SHALLOW = [(x, min(y, 16.0)) for x, y in NICHE]
RING = [(0.0, 0.0), (60.0, 0.0), (60.0, 60.0), (0.0, 60.0)]
BLOCK = [(11.0, 11.0), (49.0, 11.0), (49.0, 49.0), (11.0, 49.0)]
HEAD_ON = [entry("a", (6, 5.5), (84, 5.5)), entry("b", (84, 5.5), (6, 5.5))]


def fence(polygon: list[tuple[float, float]], **fields: Any) -> Zone:
    """An inclusion zone that whole discs keep to."""
    return Zone(**{"name": "fence", "kind": "inclusion", "polygon": polygon, "keep": "disc", **fields})


def refusal(roster: list[RosterEntry], *zones: Zone, **fields: Any) -> str:
    """Why the mission cannot be flown, "" if nothing is proven."""
    try:
        complete_mission(mission(roster, zone=list(zones), dt_s=0.5, v_max_mps=5.0, **fields))
    except MissionError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("width_m", [10.0, 14.0, 18.0, 19.8])
def test_head_on_in_a_dead_end_is_refused(width_m: float) -> None:
    """One line with the UAV, its target, the other UAV and the reason."""
    roster = [entry("a", (6, width_m / 2), (84, width_m / 2)), entry("b", (84, width_m / 2), (6, width_m / 2))]
    said = refusal(roster, fence([(x, min(y, width_m) if y else y) for x, y in [*ALLEY[:2], (90, 99), (0, 99)]]))
    assert re.match(r"roster\[1\]\.target_x_m, target_y_m = \(6(\.0)?, .*: must be reachable without passing a", said)


@pytest.mark.parametrize(
    ("name", "roster", "zones"),
    [
        ("side by side", HEAD_ON, [fence([(x, 2 * y) for x, y in ALLEY])]),
        ("just wide enough", HEAD_ON, [fence([(x, 20 / 11 * y) for x, y in ALLEY])]),
        ("a niche", HEAD_ON, [fence(NICHE)]),
        ("round a block", [entry("a", (6, 5.5), (30, 54.5)), entry("b", (54.5, 30), (5.5, 30))],
         [fence(RING), Zone(name="block", kind="exclusion", polygon=BLOCK, keep="disc")]),
        ("one behind the other", [entry("a", (6, 5.5), (60, 5.5)), entry("b", (30, 5.5), (84, 5.5))], [fence(ALLEY)]),
        ("two alleys", [HEAD_ON[0], entry("b", (84, 35.5), (6, 35.5))],
         [fence([(0, 0), (90, 0), (90, 41), (0, 41)]),
          Zone(name="wall", kind="exclusion", polygon=[(-1, 11), (91, 11), (91, 30), (-1, 30)])]),
        ("no zones", HEAD_ON, []),
    ],
)  # fmt: skip
def test_what_can_be_flown_is_not_refused(name: str, roster: list[RosterEntry], zones: list[Zone]) -> None:
    """Room beside each other, a niche, a second way, or no need to pass."""
    assert refusal(roster, *zones) == "", name


@pytest.mark.parametrize("turn", [0.3, 1.2])
def test_a_lane_may_lie_askew(turn: float) -> None:
    """Of 3.8 radii, in any direction; UAVs in order are not refused."""

    def turned(x: float, y: float) -> tuple[float, float]:
        return x * math.cos(turn) - y * math.sin(turn), x * math.sin(turn) + y * math.cos(turn)

    zone = fence([turned(x, 19 / 11 * y) for x, y in ALLEY])
    left, right = turned(10, 9), turned(80, 10)
    assert "without passing a" in refusal([entry("a", left, right), entry("b", right, left)], zone)
    near = turned(40, 9.5)
    assert refusal([entry("a", left, near), entry("b", near, right)], zone) == ""


def bend(turn_deg: float, width_m: float) -> tuple[Zone, list[RosterEntry]]:
    """A lane of two arms of 45 m with a sharp bend between them, and a UAV at each end that flies to the other."""
    turn, reach_m = math.radians(turn_deg), width_m * math.tan(math.radians(turn_deg) / 2)
    along, out = (math.cos(turn), -math.sin(turn)), (math.sin(turn), math.cos(turn))
    inner = (45 + 45 * along[0], 45 * along[1])
    outer = (inner[0] + width_m * out[0], inner[1] + width_m * out[1])
    lane = fence([(0, 0), (45, 0), inner, outer, (45 + reach_m, width_m), (0, width_m)])
    ends = (6.0, width_m / 2), (45 + 39 * along[0] + width_m / 2 * out[0], 39 * along[1] + width_m / 2 * out[1])
    return lane, [entry("a", ends[0], ends[1]), entry("b", ends[1], ends[0])]


@pytest.mark.parametrize("turn_deg", [30, 60, 90])
def test_a_bend_is_a_place_to_pass_if_it_is_wide_enough(turn_deg: float) -> None:
    """One UAV in the outer corner and one at the inner one: sqrt(2) times as much room as in the lane at 90 degrees."""
    widest_m = 5 + 15 * math.cos(math.radians(turn_deg) / 2)
    for width_m, is_refused in ((widest_m - 0.4, True), (widest_m + 0.05, False)):
        lane, roster = bend(turn_deg, width_m)
        assert ("without passing a" in refusal(roster, lane)) is is_refused, width_m


def warnings(roster: list[RosterEntry], *zones: Zone) -> list[str]:
    """What a user is told of a mission that is not refused."""
    return tight_passing(complete_mission(mission(roster, zone=list(zones), dt_s=0.5, v_max_mps=5.0)))


def test_a_bend_that_is_hardly_wide_enough_is_named_before_take_off() -> None:
    """At 45 degrees 3.77 radii suffice: the planner does not fly 3.84 of them, and flies 3.92."""
    (said,) = warnings(bend(45, 19.2)[1], bend(45, 19.2)[0])
    assert said.startswith("b may not arrive: to pass a, zones leave hardly more room than discs of 5 m need")
    assert warnings(bend(45, 19.6)[1], bend(45, 19.6)[0]) == []
    side_by_side = fence([(x, 2 * y) for x, y in ALLEY])
    assert warnings(HEAD_ON, side_by_side) == []


def test_a_lane_that_larger_discs_cannot_enter_is_no_place_to_pass() -> None:
    """UAVs in a row through a gate just as wide as a disc, which larger discs would not leave at all."""
    half = [(0, 0), (44, 0), (44, 0.45), (46, 0.45), (46, 0), (90, 0)]
    gate = fence([*half, *((x, 11 - y) for x, y in reversed(half))])
    assert warnings([entry("a", (30, 5.5), (84, 5.5)), entry("b", (10, 5.5), (64, 5.5))], gate) == []
    narrow = fence([(x, min(y, 10.1)) for x, y in ALLEY])
    assert warnings([entry("a", (30, 5.05), (84, 5.05)), entry("b", (10, 5.05), (64, 5.05))], narrow) == []


def test_three_uavs_in_too_short_a_lane() -> None:
    """Two pass each other at a niche, unless a third one is to stay in it and the lane has no room for it."""
    ends = [(6.0, 5.5), (30.0, 5.5), (46.0, 17.0)]
    roster = [entry(*way) for way in zip("abc", ends, [ends[1], ends[0], ends[2]], strict=True)]
    short = fence([(min(x, 66.0), y) for x, y in NICHE])
    assert refusal(roster[:2], short) == ""
    said = refusal(roster, short)
    assert re.match(r"roster\[2\].*: must be reachable while a and b reach theirs, for which zones leave no room", said)
    assert refusal(roster, fence(NICHE)) == ""


def corridors(rng: Random, count: int) -> set[Cell]:
    """Grow a tree of corridors on a grid, without rooms of 2 x 2 cells."""
    cells = {(0, 0)}
    while len(cells) < count:
        i, j = rng.choice([(i + a, j + b) for i, j in sorted(cells) for a, b in SIDES])
        near = [(i + a, j + b) for a in (-1, 0, 1) for b in (-1, 0, 1) if (i + a, j + b) in cells]
        beside = [cell for cell in near if abs(cell[0] - i) + abs(cell[1] - j) == 1]
        if len(beside) == 1 and all(math.dist(cell, beside[0]) <= 1 for cell in near):
            cells.add((i, j))
    return cells


def can_be_moved(cells: set[Cell], starts: tuple[Cell, ...], targets: tuple[Cell, ...]) -> bool:
    """Search all moves of one UAV to a free cell beside it."""
    seen, waiting = {starts}, [starts]
    while waiting and targets not in seen:
        here = waiting.pop()
        moves = [(k, (i + a, j + b)) for k, (i, j) in enumerate(here) for a, b in SIDES]
        after = {(*here[:k], cell, *here[k + 1 :]) for k, cell in moves if cell in cells and cell not in here}
        waiting += after - seen
        seen |= after
    return targets in seen


def test_random_corridors_against_a_search_of_all_moves() -> None:
    """Never is refused what a search of all moves from cell to cell can fly; what it cannot fly is refused here."""
    side_m, found = 11.0, []
    for seed in range(8):
        rng = Random(seed)
        cells, count = corridors(rng, rng.randint(5, 9)), rng.randint(2, 4)
        starts, targets = (tuple(rng.sample(sorted(cells), count)) for _ in range(2))
        ways = [[((i + 0.5) * side_m, (j + 0.5) * side_m) for i, j in way] for way in zip(starts, targets, strict=True)]
        shape: Any = unary_union([box(i * side_m, j * side_m, (i + 1) * side_m, (j + 1) * side_m) for i, j in cells])
        roster = [entry("abcd"[k], way[0], way[1]) for k, way in enumerate(ways)]
        said = refusal(roster, fence(list(shape.exterior.coords)[:-1]))
        assert said == "" or "leave no room" in said
        found.append((can_be_moved(cells, starts, targets), said == ""))
    assert set(found) == {(True, True), (False, False)}


def test_a_shallow_niche_does_not_help() -> None:
    """A UAV in it still blocks the alley."""
    assert "without passing a" in refusal(HEAD_ON, fence(SHALLOW))


def test_three_uavs_in_one_order_and_in_another() -> None:
    """The first pair out of order is named, whichever the others are."""
    starts, zone = [(6, 5.5), (30, 5.5), (60, 5.5)], fence(ALLEY)
    in_order = [entry(uav, start, (start[0] + 20, 5.5)) for uav, start in zip("abc", starts, strict=True)]
    assert refusal(in_order, zone) == ""
    swapped = [in_order[0], entry("b", starts[1], (80, 5.5)), entry("c", starts[2], (50, 5.5))]
    assert "roster[2]" in (said := refusal(swapped, zone))
    assert "without passing b" in said


def test_unlike_radii_count_as_the_smaller_one() -> None:
    """Discs of 5 m and 3 m do not pass where two of 3 m do not."""
    roster = [HEAD_ON[0], entry("b", (84, 5.5), (6, 5.5), r_m=4.0)]
    assert "discs of 4 m" in refusal(roster, fence(ALLEY))


def test_routes_count_by_their_ends() -> None:
    """UAVs that turn back before they meet are not refused."""
    there = [entry("a", (6, 5.5), route=[(35, 5.5), (6, 5.5)]), entry("b", (84, 5.5), route=[(50, 5.5), (84, 5.5)])]
    assert refusal(there, fence(ALLEY)) == ""
    across = [entry("a", (6, 5.5), route=[(35, 5.5), (84, 5.5)]), there[1]]
    assert "without passing a" in refusal([across[0], entry("b", (84, 5.5), route=[(50, 5.5), (6, 5.5)])], fence(ALLEY))


def test_faults_and_lifelong_goals_prove_nothing() -> None:
    """A UAV that dies and lands makes way; lifelong targets need not be reached together."""
    base = Mission(roster=HEAD_ON, uavs=2, zone=[fence(ALLEY)])
    with pytest.raises(MissionError):
        check_passing(base)
    check_passing(Mission(roster=HEAD_ON, uavs=2, zone=[fence(ALLEY)], fault=["kill a @3"]))
    check_passing(Mission(roster=HEAD_ON, uavs=2, zone=[fence(ALLEY)], goals="lifelong"))


def test_the_alleys_are_as_they_are_described() -> None:
    """By an independent geometry library: a disc of 5 m fits into all of them, and into the deep niche as well."""
    middles = {
        name: Polygon(shape).buffer(-5) for name, shape in {"alley": ALLEY, "niche": NICHE, "x": SHALLOW}.items()
    }
    assert all(middle.geom_type == "Polygon" for middle in middles.values())
    assert middles["niche"].bounds[3] == pytest.approx(19.0)
    assert middles["x"].bounds[3] == pytest.approx(11.0)
