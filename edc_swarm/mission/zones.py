"""Zones as barriers: the segments and circles that no UAV crosses.

The airspace has a boundary: the edges of all polygons and the rims of all circles. A UAV that starts in the airspace
and whose every step keeps its distance from the boundary never leaves the airspace. So planner and certificate need
no "inside" or "outside", concave polygons need no decomposition, and a step is checked as one segment against others.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edc_swarm.geometry import Floats
from edc_swarm.mission.configuration import RIM_CORNERS, Zone


@dataclass(frozen=True, slots=True)
class Barriers:
    """The m barriers of a mission as arrays: all points within `radius_m` (m,) of the segments a-b (m, 2), in metres.

    A step of a UAV with radius r stays at least `radius_m`, and where `keeps_disc` (m,) `radius_m` + r, from each
    segment.
    """

    a_m: Floats
    b_m: Floats
    radius_m: Floats
    keeps_disc: NDArray[np.bool_]


def barriers(zones: list[Zone]) -> Barriers:
    """Return the barriers of the zones, in their order: one per edge of a polygon, one per circle that is excluded."""
    starts: list[Floats] = []
    ends: list[Floats] = []
    radii: list[float] = []
    discs: list[bool] = []
    for zone in zones:
        if zone.kind == "exclusion" and not zone.polygon:
            corner_m = np.array([zone.centre], dtype=np.float64)
            radius_m = zone.radius_m
        else:
            corner_m = np.array(zone.polygon or _rim(zone), dtype=np.float64)
            radius_m = 0.0
        starts.append(corner_m)
        ends.append(np.roll(corner_m, -1, axis=0))
        radii += [radius_m] * len(corner_m)
        discs += [zone.keeps_disc] * len(corner_m)
    empty = np.empty((0, 2))
    return Barriers(
        np.concatenate([empty, *starts]), np.concatenate([empty, *ends]), np.array(radii), np.array(discs, dtype=bool)
    )


def _rim(zone: Zone) -> list[tuple[float, float]]:
    """Return the corners of the regular polygon inscribed in a circular zone."""
    turns = [2 * math.pi * corner / RIM_CORNERS for corner in range(RIM_CORNERS)]
    x_m, y_m = zone.centre
    return [(x_m + zone.radius_m * math.cos(turn), y_m + zone.radius_m * math.sin(turn)) for turn in turns]
