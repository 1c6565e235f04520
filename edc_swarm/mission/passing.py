"""Pairs of UAVs that would have to pass each other where zones leave no room: missions that no planner can fly.

Each UAV alone may have a way to its target, and two together none: two UAVs cannot change ends in an alley one disc
wide. A proof needs a search that misses nothing, so this one looks at more than is allowed:

1. Square cells cover the plane. A cell is *free* for a UAV if zones may allow some point of it.
2. A pair of free cells is *allowed* if two points of them may be R apart, R being the sum of the radii.
3. While two UAVs fly, each moves from its cell to a neighbour. So a pair of targets that no chain of allowed pairs
   joins to the pair of starts is out of reach in the plane too.

A cell is a quarter of a radius, so this proves nothing for lanes from 3.2 to 4 radii wide. For straight ones another
argument does. If all points of the lane on one line across it are less than R apart, two UAVs are never on one such
line, so they keep their order along the lane. Strips of a 32nd of a radius stand for these lines, which proves that for
lanes up to 3.9 radii wide.

The reverse does not hold: what is not refused may still be impossible, as for three UAVs with one niche. To decide that
for many discs in a polygon is strongly NP-hard (Spirakis and Yap, 1984).

A smaller disc flies wherever a larger one does. So UAVs of unlike radii are compared as two of the smaller radius.

Only lanes are searched: where a UAV has R/2 more room than it must keep on all sides, two discs of its radius turn
about each other.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edc_swarm.errors import MissionError
from edc_swarm.geometry import Floats, Indices
from edc_swarm.mission.airspace import Airspace
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.field_types import Point
from edc_swarm.mission.roster_entry import ARRIVED_M, RosterEntry

Bools = NDArray[np.bool_]
Cell = tuple[int, int]

CELLS_PER_RADIUS = 4
MAX_CELLS = 1500
"""Most cells of a lane that is searched; a longer one is not."""
MAX_FLOODED = 20_000
"""Most cells that are looked at in one mission."""
FINE = 8
"""Parts of a cell's side that are looked at where UAVs may keep their order."""
ROUNDING_M = 1e-6
_HALF_DIAGONAL = math.sqrt(0.5)
_AROUND = [(a, b) for a in (-1, 0, 1) for b in (-1, 0, 1) if a or b]


def check_passing(mission: Mission) -> None:
    """Raise `MissionError` for a UAV that can reach its target only by passing another in a lane without room.

    A mission with faults is not checked, since a fault may take a UAV away or give it another target; nor is one with
    lifelong goals, whose UAVs need not be at their targets together.
    """
    if not mission.zone or mission.fault or mission.goals == "lifelong":
        return
    airspace, roster, left = Airspace.of(mission.zone), mission.roster, MAX_FLOODED
    for r_m in sorted({entry.r_m for entry in roster}):
        at_least = [index for index, entry in enumerate(roster) if entry.r_m >= r_m]
        lanes, left = _lanes(airspace, roster, at_least, r_m, left)
        for lane, uavs in lanes:
            for first, second in itertools.chain(_stuck(lane, roster, uavs), _swapped(airspace, lane, roster, uavs)):
                allowed = (
                    f"reachable without passing {roster[first].uav}, for which zones leave no room between discs"
                    f" of {r_m:g} m"
                )
                field_name = f"roster[{second}].target_x_m, target_y_m"
                raise MissionError(field_name, roster[second].points[-1], allowed)


@dataclass(frozen=True, slots=True)
class _Lane:
    """The free cells of one connected part of the airspace, for UAVs of one radius.

    `cell_m` is the side of a cell, `middle_m` (c, 2) the middles of the cells, `near` (c, 8) the indices of each cell's
    neighbours, -1 for none.
    """

    r_m: float
    cell_m: float
    middle_m: Floats
    near: Indices

    @classmethod
    def of(cls, cells: set[Cell], r_m: float) -> _Lane:
        order, side_m = sorted(cells), r_m / CELLS_PER_RADIUS
        index = {cell: number for number, cell in enumerate(order)}
        near = [[index.get((i + a, j + b), -1) for a, b in _AROUND] for i, j in order]
        return cls(r_m, side_m, (np.array(order) + 0.5) * side_m, np.array(near))

    def cells_near(self, point_m: Point, within_m: float) -> Indices:
        """Return the cells that may hold a point within a distance of `point_m`."""
        away_m = np.abs(self.middle_m - point_m).max(axis=1)
        return np.flatnonzero(away_m <= self.cell_m / 2 + within_m + ROUNDING_M)

    def allowed(self) -> Bools:
        """Return a mask (c, c) of the pairs of cells that may hold points R apart."""
        x_m, y_m = self.middle_m.T
        away_m = np.hypot(x_m[:, None] - x_m, y_m[:, None] - y_m)
        return np.asarray(away_m >= 2 * (self.r_m - _HALF_DIAGONAL * self.cell_m) - ROUNDING_M)


def _lanes(
    airspace: Airspace, roster: Sequence[RosterEntry], uavs: Sequence[int], r_m: float, left: int
) -> tuple[list[tuple[_Lane, list[int]]], int]:
    """Return the lanes that hold the starts of two or more of `uavs` with these UAVs, and the cells left to look at."""
    starts_m = [(roster[k].start_x_m, roster[k].start_y_m) for k in uavs]
    narrow = _room_m(airspace, np.array(starts_m), r_m) < r_m
    at = {_cell(start_m, r_m): k for k, start_m in zip(uavs, starts_m, strict=True)}
    found, done = [], set[Cell]()
    for start, is_narrow in zip(at, narrow.tolist(), strict=True):
        if not is_narrow or left <= 0 or start in done:
            continue
        cells, is_lane = _flood(airspace, start, r_m, min(left, MAX_CELLS))
        left -= len(cells)
        done |= cells
        inside = sorted(k for cell, k in at.items() if cell in cells)
        if is_lane and len(inside) > 1:
            found.append((_Lane.of(cells, r_m), inside))
    return found, left


def _cell(point_m: Point, r_m: float) -> Cell:
    side_m = r_m / CELLS_PER_RADIUS
    return int(point_m[0] // side_m), int(point_m[1] // side_m)


def _room_m(airspace: Airspace, points_m: Floats, r_m: float) -> Floats:
    """Return (n,) by how much points are farther from the zones than a UAV must be, below 0 where it must not be."""
    return np.asarray(-airspace.lack_m(points_m, np.full(len(points_m), r_m)).max(axis=1, initial=-np.inf))


def _flood(airspace: Airspace, start: Cell, r_m: float, most: int) -> tuple[set[Cell], bool]:
    """Return the free cells that are joined to `start`, and False if they are not all or two discs pass in one."""
    side_m = r_m / CELLS_PER_RADIUS
    found, seen, border = {start}, {start}, [start]
    while border:
        fresh = {(i + a, j + b) for i, j in border for a, b in _AROUND} - seen
        seen |= fresh
        tried = sorted(fresh)
        room_m = _room_m(airspace, (np.array(tried).reshape(-1, 2) + 0.5) * side_m, r_m)
        border = [
            cell
            for cell, room in zip(tried, room_m.tolist(), strict=True)
            if room >= -_HALF_DIAGONAL * side_m - ROUNDING_M
        ]
        found |= set(border)
        if len(found) > most or room_m.max(initial=-np.inf) >= r_m:
            return found, False
    return found, True


def _stuck(lane: _Lane, roster: Sequence[RosterEntry], uavs: Sequence[int]) -> Iterator[tuple[int, int]]:
    """Yield the pairs of UAVs whose targets no chain of allowed pairs of cells joins to their starts."""
    allowed = lane.allowed()
    starts = [lane.cells_near((roster[k].start_x_m, roster[k].start_y_m), 0.0) for k in uavs]
    targets = [lane.cells_near(roster[k].points[-1], ARRIVED_M) for k in uavs]
    reached: list[Bools] = []
    for j in range(len(uavs)):
        for i in range(j):
            joined = next((each for each in reached if each[starts[i][0], starts[j][0]]), None)
            if joined is None:
                joined = _reached(lane, allowed, starts[i], starts[j])
                reached.append(joined)
            if not joined[np.ix_(targets[i], targets[j])].any():
                yield uavs[i], uavs[j]


def _reached(lane: _Lane, allowed: Bools, first: Indices, second: Indices) -> Bools:
    """Return a mask (c, c) of the pairs of cells that a chain of allowed pairs joins to the starts of two UAVs."""
    reached = np.zeros_like(allowed)
    pairs = np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1).reshape(-1, 2)
    while len(pairs):
        reached[pairs[:, 0], pairs[:, 1]] = True
        one, other = pairs.T
        moves = [(lane.near[one].ravel(), np.repeat(other, 8)), (np.repeat(one, 8), lane.near[other].ravel())]
        trial = np.concatenate([np.stack(move) for move in moves], axis=1)
        trial = trial[:, (trial >= 0).all(axis=0)]
        trial = trial[:, allowed[trial[0], trial[1]] & ~reached[trial[0], trial[1]]]
        keys = np.unique(trial[0] * len(allowed) + trial[1])
        pairs = np.stack(np.divmod(keys, len(allowed)), axis=-1)
    return reached


def _swapped(
    airspace: Airspace, lane: _Lane, roster: Sequence[RosterEntry], uavs: Sequence[int]
) -> Iterator[tuple[int, int]]:
    """Yield the pairs of UAVs whose targets are in another order along a lane in which they keep their order."""
    along = _along(lane)
    start_m = np.array([(roster[k].start_x_m, roster[k].start_y_m) for k in uavs]) @ along
    target_m = np.array([roster[k].points[-1] for k in uavs]) @ along
    pairs = [
        (i, j)
        for j in range(len(uavs))
        for i in range(j)
        if (start_m[i] - start_m[j]) * (target_m[i] - target_m[j]) < 0
        and abs(target_m[i] - target_m[j]) > 2 * ARRIVED_M
    ]
    if pairs and _widest_m(airspace, lane, along) < 2 * lane.r_m - ROUNDING_M:
        yield from ((uavs[i], uavs[j]) for i, j in pairs)


def _along(lane: _Lane) -> Floats:
    """Return the direction (2,) in which the cells of a lane are spread most."""
    x_m, y_m = (lane.middle_m - lane.middle_m.mean(axis=0)).T
    angle = math.atan2(2 * float((x_m * y_m).mean()), float((x_m**2 - y_m**2).mean())) / 2
    return np.array([math.cos(angle), math.sin(angle)])


def _widest_m(airspace: Airspace, lane: _Lane, along: Floats) -> float:
    """Return the largest distance of two points of a lane on a line across it, or more."""
    side_m = lane.cell_m / FINE
    half_m = _HALF_DIAGONAL * side_m + ROUNDING_M
    offset_m = (np.arange(FINE) + 0.5) * side_m - lane.cell_m / 2
    part_m = np.stack(np.meshgrid(offset_m, offset_m), axis=-1).reshape(-1, 2)
    point_m = (lane.middle_m[:, None] + part_m).reshape(-1, 2)
    point_m = point_m[_room_m(airspace, point_m, lane.r_m) >= -half_m]
    along_m, across_m = point_m @ along, point_m @ np.array([-along[1], along[0]])
    # A part of a cell is less than two strips long, so it lies in at most three of them.
    first, last = (np.floor(end_m / side_m).astype(np.int64) for end_m in (along_m - half_m, along_m + half_m))
    strip = np.concatenate([np.minimum(first + more, last) for more in range(3)]) - first.min()
    least_m, most_m = np.full(strip.max() + 1, np.inf), np.full(strip.max() + 1, -np.inf)
    np.minimum.at(least_m, strip, np.tile(across_m, 3))
    np.maximum.at(most_m, strip, np.tile(across_m, 3))
    return float((most_m - least_m).max()) + 2 * half_m
