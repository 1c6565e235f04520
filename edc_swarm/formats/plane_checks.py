"""Measures of imported zones and routes in the plane, in metres."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from edc_swarm.geometry import Floats, length_m, segment_distance_m
from edc_swarm.mission.zone import Zone
from edc_swarm.mission.zones import barriers

TOLERANCE_M = 1e-6
"""Distances that are short by less than this are rounding."""


def legs_through(zones: list[Zone], points: Floats, r_m: float) -> NDArray[np.bool_]:
    """Return which legs (n - 1,) of a route through points (n, 2) come too close to a boundary to be flown straight."""
    limits = barriers(zones)
    crossed = np.zeros(max(len(points) - 1, 0), dtype=bool)
    for leg in range(len(crossed)):
        distance_m = segment_distance_m(points[leg], points[leg + 1], limits.a_m, limits.b_m)
        needed_m = limits.radius_m + np.where(limits.keeps_disc, r_m, 0.0)
        crossed[leg] = bool((distance_m < needed_m - TOLERANCE_M).any())
    return crossed


def widest_radius_m(points: Floats) -> float:
    """Return the largest common radius of discs at points (n, 2) that do not overlap; infinite for one point."""
    least_m = np.inf
    for index in range(len(points) - 1):
        least_m = min(least_m, float(length_m(points[index + 1 :] - points[index]).min()))
    return least_m / 2
