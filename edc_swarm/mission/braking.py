"""Braking of one UAV: how far it flies until it rests, and where it is meanwhile. This module imports no numpy.

The plan of a UAV is a sequence of steps, one a slot. Consecutive steps differ by at most the step change
a_max dt^2, which is infinite for a vehicle without inertia. A UAV without a valid command brakes: each step
has the direction of the last one and is shorter by the step change, until it rests. From a step of length L
the braking path has the length

    B(L) = sum over i >= 1 of max(L - i change, 0) = m L - change m (m + 1) / 2,   m = floor(L / change),

which is convex in L, 0 up to L = change, and at most L^2 / (2 change) - L / 2 + change / 8.
"""

from __future__ import annotations

import math

from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.mission.vehicle_budget import step_change_m

Point = tuple[float, float]

BRAKE_SLACK = 1e-9
"""Rounding that a UAV allows in the change of its step: this share of it, and as many metres."""
AT_REST_M = 1e-9
"""Length up to which a braking step is rounding: the UAV rests."""


def change_of(mission: Mission, entry: RosterEntry) -> float:
    """Return the largest change of consecutive steps of a UAV in metres, infinite for an `ideal` vehicle."""
    change_m = step_change_m(mission, entry)
    return math.inf if change_m is None else change_m


def changes_m(mission: Mission) -> list[float] | None:
    """Return the largest step change of every UAV of the roster, None if all vehicles are `ideal`."""
    changes = [change_of(mission, entry) for entry in mission.roster]
    return None if all(map(math.isinf, changes)) else changes


def braking_m(length_m: float, change_m: float) -> float:
    """Return B(L), the length of the braking path after a step of `length_m`."""
    steps = math.floor(length_m / change_m)
    return steps * length_m - change_m * steps * (steps + 1) / 2 if steps else 0.0


def braked(from_m: Point, to_m: Point, change_m: float, slots: int = 1) -> tuple[Point, Point]:
    """Return start and end of the step that a UAV flies `slots` slots later if it brakes after the step from-to."""
    for _ in range(slots):
        length_m = math.dist(from_m, to_m)
        left_m = length_m - change_m
        if left_m <= AT_REST_M:
            return to_m, to_m
        dx_m, dy_m = to_m[0] - from_m[0], to_m[1] - from_m[1]
        share = left_m / length_m
        from_m, to_m = to_m, (to_m[0] + share * dx_m, to_m[1] + share * dy_m)
    return from_m, to_m


def rest_point(from_m: Point, to_m: Point, change_m: float) -> Point:
    """Return the point at which a UAV rests that brakes after the step from-to."""
    length_m = math.dist(from_m, to_m)
    if length_m <= change_m:
        return to_m
    share = braking_m(length_m, change_m) / length_m
    return to_m[0] + share * (to_m[0] - from_m[0]), to_m[1] + share * (to_m[1] - from_m[1])


def allows(from_m: Point, at_m: Point, to_m: Point, change_m: float) -> bool:
    """Return True if the step at-to differs from the last step, from-at, by at most the step change."""
    dx_m = to_m[0] - at_m[0] - (at_m[0] - from_m[0])
    dy_m = to_m[1] - at_m[1] - (at_m[1] - from_m[1])
    return math.hypot(dx_m, dy_m) <= change_m * (1 + BRAKE_SLACK) + BRAKE_SLACK


def reach_m(length_m: float, slots: int, u_max_m: float, change_m: float) -> float:
    """Return the greatest distance that a UAV flies in `slots` slots and while it brakes after them.

    Its last step has `length_m`, the next ones grow by at most the step change and are at most `u_max_m` long. The
    result is 0 for no slot: the braking path of the present step is then known and is no part of it.
    """
    if slots <= 0:
        return 0.0
    growing = 0 if math.isinf(change_m) else min(slots, math.ceil(max(u_max_m - length_m, 0.0) / change_m))
    flown_m = sum(min(u_max_m, length_m + i * change_m) for i in range(1, growing + 1)) + (slots - growing) * u_max_m
    fastest_m = u_max_m if growing < slots else min(u_max_m, length_m + slots * change_m)
    return flown_m + braking_m(fastest_m, change_m)
