"""Unions of square cells as few simple polygons.

A cell (column, row) covers the square from (column, row) to (column + 1, row + 1); points are whole numbers.
"""

from __future__ import annotations

from collections.abc import Iterator

Cell = tuple[int, int]
Loop = list[Cell]


def components(cells: set[Cell]) -> Iterator[set[Cell]]:
    """Yield the parts of a set of cells that are connected by common sides, the one with the least cell first."""
    left = set(cells)
    for seed in sorted(cells):
        if seed in left:
            yield _grown(seed, left)


def _grown(seed: Cell, left: set[Cell]) -> set[Cell]:
    """Take from `left` all cells connected with `seed`, and return them."""
    left.discard(seed)
    part, edge = {seed}, [seed]
    while edge:
        column, row = edge.pop()
        for cell in ((column + 1, row), (column - 1, row), (column, row + 1), (column, row - 1)):
            if cell in left:
                left.discard(cell)
                part.add(cell)
                edge.append(cell)
    return part


def component_of(seed: Cell, cells: set[Cell]) -> set[Cell]:
    """Return the part of `cells` that is connected with `seed`."""
    return _grown(seed, set(cells))


def loops(cells: set[Cell]) -> tuple[list[Loop], list[Loop]]:
    """Return the boundary of a set of cells as simple polygons: outer ones, and those of holes.

    Where two cells touch at a corner alone, polygons touch there too.
    """
    ahead: dict[Cell, list[Cell]] = {}
    for column, row in sorted(cells):
        corners = ((column, row), (column + 1, row), (column + 1, row + 1), (column, row + 1))
        beside = ((column, row - 1), (column + 1, row), (column, row + 1), (column - 1, row))
        for side, cell in enumerate(beside):
            if cell not in cells:
                ahead.setdefault(corners[side], []).append(corners[(side + 1) % 4])
    outer: list[Loop] = []
    holes: list[Loop] = []
    for start in sorted(ahead):
        while ahead[start]:
            for loop in _simple(_walk(start, ahead)):
                (outer if _doubled_area(loop) > 0 else holes).append(_without_straight(loop))
    return outer, holes


def _walk(start: Cell, ahead: dict[Cell, list[Cell]]) -> Loop:
    """Take from `ahead` a closed way of sides from `start`, with the cells on its left, and return it."""
    path, here = [start], ahead[start].pop()
    while here != start:
        path.append(here)
        here = ahead[here].pop()
    return path


def _simple(path: Loop) -> Iterator[Loop]:
    """Yield a closed way as closed ways that pass no point twice."""
    trail: Loop = []
    place: dict[Cell, int] = {}
    for point in path:
        if point in place:
            first = place[point]
            yield trail[first:]
            for passed in trail[first:]:
                del place[passed]
            del trail[first:]
        place[point] = len(trail)
        trail.append(point)
    yield trail


def _without_straight(loop: Loop) -> Loop:
    """Return a closed way without the points at which it goes straight on."""
    return [
        loop[i]
        for i in range(len(loop))
        if (loop[i][0] - loop[i - 1][0]) * (loop[(i + 1) % len(loop)][1] - loop[i][1])
        != (loop[i][1] - loop[i - 1][1]) * (loop[(i + 1) % len(loop)][0] - loop[i][0])
    ]


def _doubled_area(loop: Loop) -> int:
    """Return twice the area of a polygon, below 0 if it runs clockwise."""
    return sum(loop[i - 1][0] * loop[i][1] - loop[i][0] * loop[i - 1][1] for i in range(len(loop)))


def polygons(cells: set[Cell], most_corners: int) -> Iterator[Loop]:
    """Yield simple polygons without holes, of at most `most_corners` corners, that cover just the cells.

    A part with a hole, or with too many corners, is cut along the left side of the hole, or in the middle.
    """
    waiting = list(components(cells))
    while waiting:
        part = waiting.pop()
        outer, holes = loops(part)
        if not holes and all(len(loop) <= most_corners for loop in outer):
            yield from outer
            continue
        columns = sorted({column for column, _ in part})
        if holes:
            cut = min(column for column, _ in holes[0])
        elif len(columns) > 1:
            cut = columns[len(columns) // 2]
        else:  # pragma: no cover - a single column has four corners
            raise AssertionError("a column of cells has four corners")
        waiting += components({cell for cell in part if cell[0] < cut})
        waiting += components({cell for cell in part if cell[0] >= cut})
