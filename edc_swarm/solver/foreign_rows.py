"""Rows of the slot QP between UAVs of different clusters, each of which is moved by a head of its own.

Let F_k be all points where UAV k is now and where it comes if it brakes at once (a point for a vehicle that stops at
once), and n the unit vector from F_l to F_k where they are nearest. Along n they leave the room g = min n.x over F_k -
max n.x over F_l - R. Both heads find the same n and g, and each lets its own UAV close in by at most g / 2, whether the
other UAV moves or not. So the two may move at any pace, and neither head needs to know what the other one plans.

A head that has no fix of this slot of the foreign UAV knows a hull that contains F_l, and keeps its half for every
place of the hull. With d the distance from F_k to the hull and b = max((d - R) / 2, 0), it is enough that n.z <= b for
all directions n in which the hull is seen, z being the way from rest to stopping point. `RAYS` rows stand for these
directions: of two neighbours 2 delta apart, n_i.z <= b cos(delta) and n_j.z <= b cos(delta), and any n between them is
a n_i + c n_j with a, c >= 0 and a + c <= 1 / cos(delta).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from edc_swarm.geometry import Floats, Indices, by_libm, closest_points_of_segments, dot, length_m
from edc_swarm.solver.hull_rows import Obstacles
from edc_swarm.solver.normals import DELTA_M

RAYS = 5
"""Rows of one UAV and one hull. With five of them a step is at most 8 % shorter than it need be."""
WIDER_RAD = 1e-9
"""Angle by which the rows reach beyond the hull on either side, for rounding."""


@dataclass(frozen=True, slots=True)
class Foreign:
    """UAVs of other clusters: m whose fixes of this slot are known, and the hulls of the others.

    `uav` (m,) roster indices; `from_m` and `rest_m` (m, 2) the ends of F_l; `r_m` (m,). `hulls` contain the sets F_l of
    the others when the slot begins.
    """

    uav: Indices
    from_m: Floats
    rest_m: Floats
    r_m: Floats
    hulls: Obstacles = field(default_factory=Obstacles.none)


@dataclass(frozen=True, slots=True)
class Rows:
    """Rows of one UAV each: `uav` (h,), `normal` (h, 2) away from the other, `room_m`, `spare_m` (h,).

    `frozen` (n,) has the UAVs whose places and a hull overlap: they hold, or brake.
    """

    uav: Indices
    normal: Floats
    room_m: Floats
    spare_m: Floats
    frozen: NDArray[np.bool_]


def foreign_rows(uav: Indices, places_m: Floats, r_m: Floats, reach_m: Floats, foreign: Foreign) -> Rows:
    """Return the rows between UAVs and foreign ones.

    `uav` (n,) are roster indices, `places_m` (p, n, 2) the rests, then the positions, with lag the previous ones, all
    on one segment F_k; `reach_m` (n,) bounds the way from the rest to the stopping point.
    """
    heard = _heard_rows(uav, places_m, r_m, reach_m, foreign)
    unheard = _hull_rows(places_m, r_m, reach_m, foreign.hulls)
    parts = zip(heard, unheard[:4], strict=True)
    which, normal, room_m, spare_m = (np.concatenate(both) for both in parts)
    return Rows(which, normal, room_m, spare_m, unheard[4])


def _heard_rows(
    uav: Indices, places_m: Floats, r_m: Floats, reach_m: Floats, foreign: Foreign
) -> tuple[Indices, Floats, Floats, Floats]:
    """Return UAV, normal, room and spare of the rows against foreign UAVs whose fixes are known."""
    rest_m, from_m = places_m[0], places_m[-1]
    apart_m = length_m(rest_m[:, None] - foreign.rest_m[None])
    longest_m = length_m(rest_m - from_m)[:, None] + length_m(foreign.rest_m - foreign.from_m)[None]
    sum_m = r_m[:, None] + foreign.r_m[None]
    k, other = np.nonzero(apart_m - longest_m - sum_m < 2 * (reach_m[:, None] + DELTA_M))
    # The UAV that is first in the roster comes first, so that both heads compute the same normal to the last bit.
    first = (uav[k] < foreign.uav[other])[:, None]
    ends_m = from_m[k], rest_m[k], foreign.from_m[other], foreign.rest_m[other]
    on_first, on_second = closest_points_of_segments(
        *(np.where(first, mine, theirs) for mine, theirs in zip(ends_m[:2], ends_m[2:], strict=True)),
        *(np.where(first, theirs, mine) for mine, theirs in zip(ends_m[:2], ends_m[2:], strict=True)),
    )
    vector_m = np.where(first, on_first - on_second, on_second - on_first)
    distance_m = length_m(vector_m)[:, None]
    normal = np.where(distance_m > 0, vector_m / np.where(distance_m > 0, distance_m, 1.0), [1.0, 0.0])
    along_m = dot(normal[None], places_m[:, k])
    beyond_m = np.maximum(dot(normal, ends_m[2]), dot(normal, ends_m[3]))
    nearest_m = along_m.min(axis=0)
    room_m = 0.5 * (nearest_m - beyond_m - sum_m[k, other])
    return k, normal, room_m, along_m[0] - nearest_m


def _hull_rows(
    places_m: Floats, r_m: Floats, reach_m: Floats, hulls: Obstacles
) -> tuple[Indices, Floats, Floats, Floats, NDArray[np.bool_]]:
    """Return UAV, normal, room and spare of the rows against hulls, and a mask of the UAVs within one."""
    rest_m, from_m = places_m[0], places_m[-1]
    frozen = np.zeros(len(rest_m), dtype=bool)
    if not len(hulls.keep_m) or not len(rest_m):
        return np.empty(0, np.int64), np.empty((0, 2)), np.empty(0), np.empty(0), frozen
    apart_m = length_m(rest_m[:, None] - hulls.a_m[None])
    longest_m = length_m(rest_m - from_m)[:, None] + (length_m(hulls.b_m - hulls.a_m) + hulls.radius_m)[None]
    sum_m = r_m[:, None] + hulls.keep_m[None]
    # Few pairs are so near that they can have rows.
    k, which = np.nonzero(apart_m - longest_m - sum_m < 2 * (reach_m[:, None] + DELTA_M))
    on_way, on_axis = closest_points_of_segments(from_m[k], rest_m[k], hulls.a_m[which], hulls.b_m[which])
    towards_m = on_axis - on_way
    distance_m = length_m(towards_m) - hulls.radius_m[which]
    room_m = np.maximum(0.5 * (distance_m - sum_m[k, which]), 0.0)
    inside: NDArray[np.bool_] = distance_m <= 0
    frozen[k[inside]] = True
    near = ~inside & (room_m < reach_m[k] + DELTA_M)
    k, which, towards_m, room_m = k[near], which[near], towards_m[near], room_m[near]
    low, high = _seen(from_m[k], rest_m[k], towards_m, hulls, which)
    share = np.linspace(0.0, 1.0, RAYS)
    angle = low[:, None] + (high - low)[:, None] * share
    bound_m = room_m * by_libm(math.cos, (high - low) / (2 * (RAYS - 1)))
    normal = -np.stack([by_libm(math.cos, angle), by_libm(math.sin, angle)], axis=-1).reshape(-1, 2)
    return (
        np.repeat(k, RAYS),
        normal,
        np.repeat(bound_m, RAYS),
        np.zeros(RAYS * len(k)),
        frozen,
    )


def _seen(from_m: Floats, rest_m: Floats, towards_m: Floats, hulls: Obstacles, which: Indices) -> tuple[Floats, Floats]:
    """Return the least and the greatest angle (h,), (h,) in which a hull is seen from any point of F_k.

    The differences of the points of both sets are the convex hull of four balls. It does not contain the origin, so
    all of it lies within 90 degrees of the direction `towards_m` (h, 2) of its nearest point.
    """
    base = by_libm(math.atan2, towards_m[:, 1], towards_m[:, 0])
    low, high = np.zeros(len(which)), np.zeros(len(which))
    for start_m in (from_m, rest_m):
        for end_m in (hulls.a_m[which], hulls.b_m[which]):
            way_m = end_m - start_m
            turn = by_libm(math.atan2, way_m[:, 1], way_m[:, 0]) - base
            turn = (turn + np.pi) % (2 * np.pi) - np.pi
            sine = np.minimum(hulls.radius_m[which] / np.maximum(length_m(way_m), 1e-300), 1.0)
            beta = by_libm(math.asin, sine)
            low, high = np.minimum(low, turn - beta), np.maximum(high, turn + beta)
    return base + low - WIDER_RAD, base + high + WIDER_RAD
