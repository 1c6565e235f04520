"""Speed of UAVs that cannot stop at once: fast enough to get on, slow enough to stop at the target."""

from __future__ import annotations

import numpy as np

from edc_swarm.geometry import Floats, dot, length_m
from edc_swarm.mission.braking import changes_m
from edc_swarm.mission.configuration import Mission
from edc_swarm.planner.request import Arrays, steps_of
from edc_swarm.solver.stopping import Momentum, step_of

AHEAD = 0.5
"""Cosine of the angle between a step and the bearing of the target up to which the step leads to the target."""


def step_changes(mission: Mission) -> Floats | None:
    """Return the largest step changes (K,) of the roster, None if all UAVs stop at once."""
    changes = changes_m(mission)
    return None if changes is None else np.array(changes)


def momentum_of(arrays: Arrays, u_max_m: Floats, change_m: Floats | None) -> Momentum | None:
    """Return the motion of the UAVs of a request, None if `change_m`, the step changes of the roster, is None."""
    if change_m is None:
        return None
    previous_m = arrays.position_m if arrays.previous_m is None else arrays.previous_m
    return Momentum(
        arrays.position_m, arrays.position_m - previous_m, change_m[arrays.uav], steps_of(u_max_m, arrays.uav)
    )


def slowed_m(momentum: Momentum, wish_m: Floats, target_m: Floats) -> Floats:
    """Return the preferred waypoints (n, 2), nearer where a UAV would fly past its target before it can stop.

    A step that leads to the target is at most as long as one after which the UAV rests at the target.
    """
    step_m, way_m = wish_m - momentum.position_m, target_m - momentum.position_m
    length, left_m = length_m(step_m), length_m(way_m)
    leads = dot(step_m, way_m) > AHEAD * length * left_m
    most_m = step_of(left_m, momentum.change_m)
    share = np.where(leads & (length > most_m), most_m / np.where(length > 0, length, 1.0), 1.0)
    return np.asarray(momentum.position_m + share[:, None] * step_m)
