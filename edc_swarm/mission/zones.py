"""Zones as barriers: the segments and circles that no UAV crosses.

The airspace has a boundary: the edges of all polygons and the rims of all circles. A UAV that starts in the airspace
and whose every step keeps its distance from the boundary never leaves the airspace. So planner and certificate need
no "inside" or "outside", concave polygons need no decomposition, and a step is checked as one segment against others.
"""

from __future__ import annotations

import math

import numpy as np

from edc_swarm.geometry import Barriers, Floats, length_m
from edc_swarm.mission.zone import RIM_CORNERS, Zone


def barriers(zones: list[Zone]) -> Barriers:
    """Return the barriers of the zones, in their order: one per edge of a polygon, one per circle that is excluded."""
    starts: list[Floats] = []
    ends: list[Floats] = []
    sides: list[Floats] = []
    radii: list[float] = []
    discs: list[bool] = []
    number: list[int] = []
    for index, zone in enumerate(zones):
        radius_m = zone.radius_m if zone.kind == "exclusion" and not zone.polygon else 0.0
        a_m, b_m, side = _circle(zone) if radius_m else _edges(zone)
        starts.append(a_m)
        ends.append(b_m)
        sides.append(side)
        radii += [radius_m] * len(a_m)
        discs += [zone.keeps_disc] * len(a_m)
        number += [index] * len(a_m)
    empty = np.empty((0, 2))
    a_m, b_m, side = (np.concatenate([empty, *parts]) for parts in (starts, ends, sides))
    zone_of = np.array(number, dtype=np.int64)
    kept_in = np.array([zones[index].kind == "inclusion" for index in number], dtype=bool)
    return Barriers(a_m, b_m, np.array(radii), np.array(discs, dtype=bool), side, zone_of, kept_in)


def _circle(zone: Zone) -> tuple[Floats, Floats, Floats]:
    """Return the only point of an excluded circle, as a segment without length or side."""
    centre_m = np.array([zone.centre], dtype=np.float64)
    return centre_m, centre_m, np.zeros((1, 2))


def _edges(zone: Zone) -> tuple[Floats, Floats, Floats]:
    """Return the ends of a zone's edges, and the normals that point into the airspace; edges have a length."""
    a_m = np.array(zone.polygon or _rim(zone), dtype=np.float64)
    b_m = np.roll(a_m, -1, axis=0)
    from_m, to_m = a_m - a_m[0], b_m - a_m[0]
    area_m2 = float((from_m[:, 0] * to_m[:, 1] - from_m[:, 1] * to_m[:, 0]).sum())
    long = length_m(b_m - a_m) > 0
    a_m, b_m = a_m[long], b_m[long]
    along = (b_m - a_m) / length_m(b_m - a_m)[:, None]
    inwards = math.copysign(1.0, area_m2) * np.stack([-along[:, 1], along[:, 0]], axis=-1)
    return a_m, b_m, inwards if zone.kind == "inclusion" else -inwards


def _rim(zone: Zone) -> list[tuple[float, float]]:
    """Return the corners of the regular polygon inscribed in a circular zone."""
    turns = [2 * math.pi * corner / RIM_CORNERS for corner in range(RIM_CORNERS)]
    x_m, y_m = zone.centre
    return [(x_m + zone.radius_m * math.cos(turn), y_m + zone.radius_m * math.sin(turn)) for turn in turns]


__all__ = ["Barriers", "barriers"]
