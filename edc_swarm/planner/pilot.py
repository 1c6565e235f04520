"""Speed of UAVs that cannot stop at once: fast enough to get on, slow enough to stop at the target."""

from __future__ import annotations

import numpy as np

from edc_swarm.geometry import Floats, dot, length_m
from edc_swarm.solver.stopping import Momentum, step_of

AHEAD = 0.5
"""Cosine of the angle between a step and the bearing of the target up to which the step leads to the target."""


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
