"""Candidate normals of a row, and the buffer of all rows."""

from __future__ import annotations

import math

import numpy as np

from edc_swarm.geometry import (
    Floats,
    by_libm,
    length_m,
    nearest_on_segment,
    rotated,
)

DELTA_M = 0.02
"""Buffer of the rows for the solver's error, so that the separation stays above R."""


def fan(centre: Floats, half_angle: Floats) -> Floats:
    """Return unit vectors (7, p, 2): the centre, which wins ties, and thirds of the half angle right and left of it."""
    third = half_angle / 3
    cos, sin = by_libm(math.cos, third), by_libm(math.sin, third)
    cos2, sin2 = cos * cos - sin * sin, 2 * sin * cos
    cos3, sin3 = cos2 * cos - sin2 * sin, sin2 * cos + cos2 * sin
    none = np.zeros_like(cos)
    turns = (  # cosines, sines
        np.stack([none + 1, cos, cos, cos2, cos2, cos3, cos3]),
        np.stack([none, -sin, sin, -sin2, sin2, -sin3, sin3]),
    )
    return rotated(centre[None], *turns)


def towards_wishes(apart_m: Floats, first_m: Floats, second_m: Floats, centre: Floats) -> Floats:
    """Return the direction (p, 2) of the point nearest to the origin of all d + s v_k - t v_l, 0 <= s, t <= 1.

    If the preferred steps v_k, v_l (p, 2) are safe at all, they are along this normal.
    """
    corners = (apart_m, apart_m + first_m, apart_m + first_m - second_m, apart_m - second_m)
    sides = zip(corners, (*corners[1:], corners[0]), strict=True)
    point = np.stack([nearest_on_segment(np.zeros(2), start, end) for start, end in sides])
    away_m = length_m(point)
    side, pair = np.argmin(away_m, axis=0), np.arange(len(apart_m))
    nearest, least_m = point[side, pair], away_m[side, pair][:, None]
    # Within reach of the origin the steps cannot be separated: every direction in the cone is equally good.
    return np.where(least_m > DELTA_M, nearest / np.maximum(least_m, DELTA_M), centre)
