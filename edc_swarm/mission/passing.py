"""UAVs that would have to pass each other where zones leave no room: missions that no planner can fly.

Each UAV alone may have a way to its target, and several together none: two UAVs cannot change ends in an alley one disc
wide. A lane is a connected part of the airspace in which several UAVs start; `lanes` proves that some of them cannot
all be at their targets.

The reverse does not hold: what is not refused may still be impossible. To decide that for many discs of unlike radii is
strongly NP-hard (Spirakis and Yap, as cited in arXiv 1607.04005).

A smaller disc flies wherever a larger one does. So UAVs of unlike radii are compared as if all had the smallest radius.

Only lanes are searched: where a UAV has R/2 more room than it must keep on all sides, two discs of its radius turn
about each other.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from edc_swarm.errors import MissionError
from edc_swarm.mission.airspace import Airspace, zones_refusal
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.field_types import Point
from edc_swarm.mission.roster_entry import RosterEntry

Cell = tuple[int, int]

CELLS_PER_RADIUS = 4
MAX_CELLS = 3000
"""Most cells of a lane that is searched; a longer one is not."""
MAX_FLOODED = 20_000
"""Most cells that are looked at in one mission."""
GROWTH = 1.03
"""Discs that are larger by this factor leave about as much room as the planner needs to let UAVs pass each other.

In lanes with a bend of 45 degrees it flies those 3.92 radii wide, and not those of 3.84; 3.77 would suffice.
"""
ROUNDING_M = 1e-6
_HALF_DIAGONAL = math.sqrt(0.5)
_AROUND = [(a, b) for a in (-1, 0, 1) for b in (-1, 0, 1) if a or b]


def check_passing(mission: Mission) -> None:
    """Raise `MissionError` for UAVs that can reach their targets only by passing each other in a lane without room.

    A mission with faults is not checked, since a fault may take a UAV away or give it another target; nor is one with
    lifelong goals, whose UAVs need not be at their targets together.
    """
    for group, r_m in _stuck(mission, 1.0):
        raise _refusal(mission.roster, group, r_m)


def tight_passing(mission: Mission) -> list[str]:
    """Return a warning if UAVs of a mission have hardly more room to pass each other than they need."""
    roster = mission.roster
    for group, r_m in _stuck(mission, GROWTH):
        ways = [[(roster[k].start_x_m, roster[k].start_y_m), roster[k].points[-1]] for k in group]
        # Discs that a gate keeps in would not get past each other either.
        if not any(zones_refusal(mission.zone, GROWTH * r_m, way) for way in ways):
            *others, last = (roster[k].uav for k in group)
            return [
                f"{last} may not arrive: to pass {' and '.join(others)}, zones leave hardly more room than discs of"
                f" {r_m:g} m need ({100 * (GROWTH - 1):.0f} % larger ones could not pass)"
            ]
    return []


def _stuck(mission: Mission, growth: float) -> Iterator[tuple[list[int], float]]:
    """Yield UAVs that could not all reach their targets if their discs were larger by a factor, and their radius."""
    if not mission.zone or mission.fault or mission.goals == "lifelong":
        return
    airspace, roster, left = Airspace.of(mission.zone), mission.roster, MAX_FLOODED
    for r_m in sorted({entry.r_m for entry in roster}):
        at_least, grown_m = [index for index, entry in enumerate(roster) if entry.r_m >= r_m], growth * r_m
        lanes, left = _lanes(airspace, roster, at_least, grown_m, left)
        for cells, uavs in lanes:
            from edc_swarm.mission.lanes import Lane, stuck  # noqa: PLC0415  (imports scipy, which few missions need)

            ways = [((roster[k].start_x_m, roster[k].start_y_m), roster[k].points[-1]) for k in uavs]
            if group := stuck(Lane.of(airspace, cells, grown_m / CELLS_PER_RADIUS, grown_m), ways):
                yield [uavs[k] for k in group], r_m


def _refusal(roster: Sequence[RosterEntry], group: Sequence[int], r_m: float) -> MissionError:
    *others, last = group
    names = " and ".join(roster[k].uav for k in others)
    without = f"without passing {names}" if len(others) == 1 else f"while {names} reach theirs"
    allowed = f"reachable {without}, for which zones leave no room between discs of {r_m:g} m"
    return MissionError(f"roster[{last}].target_x_m, target_y_m", roster[last].points[-1], allowed)


def _lanes(
    airspace: Airspace, roster: Sequence[RosterEntry], uavs: Sequence[int], r_m: float, left: int
) -> tuple[list[tuple[set[Cell], list[int]]], int]:
    """Return the lanes that hold the starts of two or more of `uavs` with these UAVs, and the cells left to look at."""
    starts_m = [(roster[k].start_x_m, roster[k].start_y_m) for k in uavs]
    narrow = airspace.room_m(np.array(starts_m), r_m) < r_m
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
            found.append((cells, inside))
    return found, left


def _cell(point_m: Point, r_m: float) -> Cell:
    side_m = r_m / CELLS_PER_RADIUS
    return int(point_m[0] // side_m), int(point_m[1] // side_m)


def _flood(airspace: Airspace, start: Cell, r_m: float, most: int) -> tuple[set[Cell], bool]:
    """Return the free cells that are joined to `start`, and False if they are not all or two discs pass in one.

    A cell is free if zones may allow some point of it.
    """
    side_m = r_m / CELLS_PER_RADIUS
    found, seen, border = {start}, {start}, [start]
    while border:
        fresh = {(i + a, j + b) for i, j in border for a, b in _AROUND} - seen
        seen |= fresh
        tried = sorted(fresh)
        room_m = airspace.room_m((np.array(tried).reshape(-1, 2) + 0.5) * side_m, r_m)
        border = [
            cell
            for cell, room in zip(tried, room_m.tolist(), strict=True)
            if room >= -_HALF_DIAGONAL * side_m - ROUNDING_M
        ]
        found |= set(border)
        if len(found) > most or room_m.max(initial=-np.inf) >= r_m:
            return found, False
    return found, True
