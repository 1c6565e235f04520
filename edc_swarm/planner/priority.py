"""Planner "priority": prioritised planning, a space-time A* for one UAV after another in a window of slots.

Source: D. Silver, "Cooperative pathfinding", AIIDE 2005 (windowed hierarchical cooperative A*); prioritised planning is
M. Erdmann, T. Lozano-Perez, Algorithmica 2, 1987.

The UAVs plan in an order, each in space and time around the ways of those before it. The way beyond the window counts
as straight. A UAV moves by a full step in one of `DIRECTIONS` directions, flies towards its target, or waits.
Those after it in the order must be able to wait for `YIELD_SLOTS` slots. A UAV that has waited in vain goes first next
time, then the UAV with the longest way; so a UAV at its target makes room for all others. A UAV for which the search
finds no way waits. At the end all UAVs wait whose step would meet another's, so discs stay apart if all fly evenly.

The windows are planned anew every `REPLAN_SLOTS` slots, and when a UAV is not where its way has it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import count

import numpy as np

from edc_swarm.geometry import Floats, closest_approach_m, length_m
from edc_swarm.mission.configuration import Mission
from edc_swarm.planner.discs import CLEARANCE_M, Discs, Sight, plan_of
from edc_swarm.planner.interface import Plan, PlanRequest, Stopwatch

WINDOW_SLOTS = 12
"""Slots of a plan."""
REPLAN_SLOTS = 4
"""Slots after which the UAVs plan anew."""
YIELD_SLOTS = 2
"""Slots in which a UAV keeps clear of where those after it in the order are now."""
DIRECTIONS = 12
"""Directions of a full step."""
MOST_EXPANSIONS = 300
"""Expansions of one search, after which the UAV waits."""
CELL_SHARE = 0.25
"""Side of the cells in which two places count as one, as a share of a step."""
TURN_PRICE = 0.02
"""Price of a full step beside the slot that it takes: a shorter way of the same time is better."""


@dataclass(slots=True)
class _Window:
    """The ways of one window: (n, slots + 1, 2) places from slot `first` on, for the UAVs `uav`."""

    uav: tuple[int, ...]
    first: int
    way_m: Floats


class Priority:
    """Planner that gives each UAV a way around those before it."""

    def __init__(self, mission: Mission, stopwatch: Stopwatch) -> None:
        self._stopwatch = stopwatch
        self._sight = Sight(mission, horizon_slots=0)
        self._window = _Window((), 0, np.empty((0, 1, 2)))
        self._vain: dict[int, int] = {}

    def plan(self, request: PlanRequest) -> Plan:
        """Return the next waypoints of the UAVs of `request`."""
        started_ns = self._stopwatch()
        discs = self._sight.discs(request)
        if not self._keeps(discs):
            self._window = _Window(tuple(discs.uav.tolist()), discs.slot, self._ways_m(discs))
        to_m = self._window.way_m[:, discs.slot - self._window.first + 1]
        step_m = without_meetings(discs, to_m - discs.position_m)
        return plan_of(discs, step_m, "planned", (self._stopwatch() - started_ns) / 1e6)

    def _keeps(self, discs: Discs) -> bool:
        """Return True if the window still serves: same UAVs, each in its place, no hull, and not old."""
        window, age = self._window, discs.slot - self._window.first
        if tuple(discs.uav.tolist()) != window.uav or not 0 <= age < REPLAN_SLOTS or len(discs.still_r_m):
            return False
        return bool((length_m(window.way_m[:, age] - discs.position_m) <= CLEARANCE_M).all())

    def _ways_m(self, discs: Discs) -> Floats:
        """Return the ways (n, WINDOW_SLOTS + 1, 2) of all UAVs, planned in their order."""
        number = len(discs.uav)
        left_m = length_m(discs.target_m - discs.position_m)
        vain = [self._vain.get(k, 0) for k in discs.uav.tolist()]
        order = sorted(range(number), key=lambda i: (-vain[i], -left_m[i], i))
        way_m = np.repeat(discs.position_m[:, None], WINDOW_SLOTS + 1, axis=1)
        for rank, i in enumerate(order):
            found = _way_m(discs, i, order[:rank], order[rank + 1 :], way_m)
            waits = found is None and left_m[i] > CLEARANCE_M
            self._vain[int(discs.uav[i])] = vain[i] + 1 if waits else 0
            if found is not None:
                way_m[i] = found
        return way_m


def _way_m(discs: Discs, i: int, before: list[int], after: list[int], way_m: Floats) -> Floats | None:
    """Return the way (WINDOW_SLOTS + 1, 2) of UAV `i` around the ways of those `before` it; None if none is found."""
    goal_m, u_max_m, r_m = discs.target_m[i], float(discs.u_max_m[i]), float(discs.r_m[i]) + CLEARANCE_M
    moves_m = np.array(
        [
            (math.cos(math.tau * k / DIRECTIONS) * u_max_m, math.sin(math.tau * k / DIRECTIONS) * u_max_m)
            for k in range(DIRECTIONS)
        ]
    ) * (1 - 1e-12)
    fixed_m = np.concatenate([discs.still_m, discs.position_m[after]])
    fixed_r_m = np.concatenate([discs.still_r_m, discs.r_m[after]]) + r_m
    stills, before_r_m = len(discs.still_r_m), discs.r_m[before] + r_m
    start_m = discs.position_m[i]
    number = count()
    heap: list[tuple[float, int, int, Floats, tuple[Floats, ...], float]] = []
    heappush(heap, (float(length_m(goal_m - start_m)) / u_max_m, next(number), 0, start_m, (start_m,), 0.0))
    seen: set[tuple[int, int, int]] = set()
    cell_m = CELL_SHARE * u_max_m
    for _ in range(MOST_EXPANSIONS):
        if not heap:
            return None
        _, _, depth, here_m, path, spent = heappop(heap)
        if depth == WINDOW_SLOTS:
            return np.array(path)
        key = (depth, round(float(here_m[0]) / cell_m), round(float(here_m[1]) / cell_m))
        if key in seen:
            continue
        seen.add(key)
        towards_m = goal_m - here_m
        away_m = float(length_m(towards_m))
        ahead_m = towards_m if away_m <= u_max_m else towards_m * (u_max_m / away_m * (1 - 1e-12))
        to_m = here_m + np.concatenate([ahead_m[None], np.zeros((1, 2)), moves_m])
        bound = stills if depth >= YIELD_SLOTS else len(fixed_r_m)
        others_m = np.concatenate([way_m[before, depth], fixed_m[:bound]])
        others_to_m = np.concatenate([way_m[before, depth + 1], fixed_m[:bound]])
        apart_m = np.concatenate([before_r_m, fixed_r_m[:bound]])
        near = length_m(others_m - here_m) < apart_m + 4 * u_max_m
        closest_m = closest_approach_m(here_m, to_m[:, None], others_m[near], others_to_m[near])
        free = (closest_m >= np.minimum(apart_m[near], length_m(others_m[near] - here_m))).all(axis=1)
        for place_m in to_m[free]:
            left_m = float(length_m(goal_m - place_m))
            price = (left_m > CLEARANCE_M) + TURN_PRICE * float(length_m(place_m - here_m)) / u_max_m
            total = spent + price
            heappush(heap, (total + left_m / u_max_m, next(number), depth + 1, place_m, (*path, place_m), total))
    return None


def without_meetings(discs: Discs, step_m: Floats) -> Floats:
    """Return the steps (n, 2), 0 for the UAVs whose step would meet another's if all fly evenly."""
    step_m = step_m.copy()
    first, second = np.triu_indices(len(step_m), 1)
    apart_m = discs.r_m[first] + discs.r_m[second] + CLEARANCE_M / 2
    here_m = discs.position_m
    apart_m = np.minimum(apart_m, length_m(here_m[first] - here_m[second]))
    for _ in range(len(step_m)):
        to_m = here_m + step_m
        meets = closest_approach_m(here_m[first], to_m[first], here_m[second], to_m[second]) < apart_m - 1e-12
        moves = length_m(step_m) > 0
        waits = np.unique(np.concatenate([first[meets], second[meets]]))
        if not moves[waits].any():
            break
        step_m[waits] = 0.0
    return step_m
