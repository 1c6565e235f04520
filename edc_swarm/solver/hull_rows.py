"""Rows of the slot QP between UAVs and hulls: where a UAV that nobody hears can be."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edc_swarm.geometry import (
    Floats,
    Indices,
    by_libm,
    closest_points_of_segments,
    dot,
    length_m,
    nearest_on_segment,
)
from edc_swarm.solver.normals import DELTA_M


@dataclass(frozen=True, slots=True)
class Obstacles:
    """The m hulls as arrays: all points within `radius_m` (m,) of the segments a-b (m, 2), where no UAV may fly.

    `keep_m` (m,) is the GPS radius of the UAV inside each hull.
    """

    a_m: Floats
    b_m: Floats
    radius_m: Floats
    keep_m: Floats

    @staticmethod
    def none() -> Obstacles:
        """Return no hull."""
        return Obstacles(np.empty((0, 2)), np.empty((0, 2)), np.empty(0), np.empty(0))

    def chosen(self, mask: NDArray[np.bool_]) -> Obstacles:
        """Return the hulls of a mask (m,)."""
        return Obstacles(self.a_m[mask], self.b_m[mask], self.radius_m[mask], self.keep_m[mask])

    def followed_by(self, more: Obstacles) -> Obstacles:
        """Return these hulls, and more behind them."""
        return Obstacles(
            np.concatenate([self.a_m, more.a_m]),
            np.concatenate([self.b_m, more.b_m]),
            np.concatenate([self.radius_m, more.radius_m]),
            np.concatenate([self.keep_m, more.keep_m]),
        )


def obstacle_rows(
    position_m: Floats, wish_m: Floats, r_m: Floats, u_max_m: Floats, obstacles: Obstacles
) -> tuple[Indices, Floats, Floats, NDArray[np.bool_]]:
    """Return the rows of the UAVs within reach of a hull, and a mask of the UAVs inside one.

    ==================  ==========================================================================================
    distance of p       rows
    ==================  ==========================================================================================
    at least R          -n.u <= min n.(p - x) - R, with any n such that n.(p - x) >= R for all x of the hull; it keeps
                        the separation from every x: see `_outer_rows`
    less than R         u.(p - x) >= 0 for all x of the hull, so the UAV comes no nearer to any x. The unheard UAV is
                        still at some x at R or more. These u form the polar cone of the tangents seen from p:
                        two rows without room
    inside the hull     none; the UAV holds
    ==================  ==========================================================================================
    """
    frozen = np.zeros(len(position_m), dtype=bool)
    if not len(obstacles.radius_m) or not len(position_m):
        return np.empty(0, np.int64), np.empty((0, 2)), np.empty(0), frozen
    nearest_m = nearest_on_segment(position_m[:, None], obstacles.a_m[None], obstacles.b_m[None])
    apart_m = position_m[:, None] - nearest_m
    distance_m = length_m(apart_m)
    room_m = distance_m - obstacles.radius_m - (r_m[:, None] + obstacles.keep_m)
    inside = (distance_m <= obstacles.radius_m) | (distance_m == 0)
    frozen = inside.any(axis=1)
    outer, which = np.nonzero(~inside & (room_m >= 0) & (room_m < u_max_m[:, None] + DELTA_M))
    inner, near = np.nonzero(~inside & (room_m < 0))
    tangents = _tangent_normals(position_m[inner], obstacles, near)
    centre = apart_m[outer, which] / distance_m[outer, which, None]
    normal, outer_room_m = _outer_rows(
        position_m[outer], wish_m[outer], centre, room_m[outer, which], r_m[outer], obstacles, which
    )
    return (
        np.concatenate([outer, inner, inner]),
        np.concatenate([normal, *tangents]),
        np.concatenate([outer_room_m, np.zeros(2 * len(inner))]),
        frozen,
    )


def _outer_rows(
    point_m: Floats,
    wish_m: Floats,
    centre: Floats,
    centre_room_m: Floats,
    r_m: Floats,
    obstacles: Obstacles,
    which: Indices,
) -> tuple[Floats, Floats]:
    """Return normals (h, 2) and room (h,) of points at R or more from hulls: the better of two candidates.

    `centre` points from the hull's nearest point to the UAV; the other normal starts where the preferred step
    is nearest to the hull. If that step keeps R, it keeps R along this normal, so the QP grants a step past a hull.
    """
    a_m, b_m = obstacles.a_m[which], obstacles.b_m[which]
    on_step, on_axis = closest_points_of_segments(point_m, wish_m, a_m, b_m)
    apart_m = on_step - on_axis
    least_m = length_m(apart_m)[:, None]
    normal = np.where(least_m > DELTA_M, apart_m / np.maximum(least_m, DELTA_M), centre)
    room_m = np.minimum(dot(normal, point_m - a_m), dot(normal, point_m - b_m))
    room_m = room_m - obstacles.radius_m[which] - (r_m + obstacles.keep_m[which])
    step_m = wish_m - point_m
    left_m = room_m - np.maximum(-dot(normal, step_m), 0.0)
    better = (room_m >= 0) & (left_m > centre_room_m - np.maximum(-dot(centre, step_m), 0.0) + 1e-9)
    return np.where(better[:, None], normal, centre), np.where(better, room_m, centre_room_m)


def moving_obstacle_rows(
    places_m: Floats, stop_m: Floats, r_m: Floats, reach_m: Floats, obstacles: Obstacles
) -> tuple[Indices, Floats, Floats, Floats, NDArray[np.bool_]]:
    """Return the rows of UAVs that cannot stop at once: UAV, normal, room and spare; and a mask of those that brake.

    `places_m` (2 or 3, n, 2) are the rests q, the positions p and, with lag, the previous ones, all on one segment.

    ======================  ======================================================================================
    distance of the segment rows, with w = q + z - p
    ======================  ======================================================================================
    at least R              as `obstacle_rows`, where the least of all places counts
    less than R             w.(p - x) >= 0 for all x of the hull, and the same for the previous position: no part of
                            the path, nor of a curve that cuts its corner, is nearer to any x than the last step,
                            which is at R or more from the unheard UAV. If braking does not do so, the UAV brakes
    p inside the hull       none; the UAV brakes
    ======================  ======================================================================================
    """
    rest_m, starts_m = places_m[0], places_m[1:]
    frozen = np.zeros(len(rest_m), dtype=bool)
    if not len(obstacles.radius_m) or not len(rest_m):
        none = np.empty(0)
        return np.empty(0, np.int64), np.empty((0, 2)), none, none, frozen
    on_way, on_axis = closest_points_of_segments(
        starts_m[-1][:, None], rest_m[:, None], obstacles.a_m[None], obstacles.b_m[None]
    )
    apart_m = on_way - on_axis
    distance_m = length_m(apart_m)
    room_m = distance_m - obstacles.radius_m - (r_m[:, None] + obstacles.keep_m)
    start_m = np.min(
        [length_m(p_m[:, None] - nearest_on_segment(p_m[:, None], obstacles.a_m, obstacles.b_m)) for p_m in starts_m],
        axis=0,
    )
    inside = (start_m <= obstacles.radius_m) | (start_m == 0)
    frozen = inside.any(axis=1)
    outer, which = np.nonzero(~inside & (room_m >= 0) & (room_m < reach_m[:, None] + DELTA_M))
    inner, near = np.nonzero(~inside & (room_m < 0))
    normal, outer_room_m, outer_spare_m = _moving_outer_rows(
        places_m[:, outer], stop_m[outer], apart_m[outer, which], r_m[outer], obstacles, which
    )
    tangents = [tangent for p_m in starts_m for tangent in _tangent_normals(p_m[inner], obstacles, near)]
    spare_m = [dot(tangent, (rest_m - starts_m[0])[inner]) for tangent in tangents]
    for closer_m in spare_m:
        frozen[inner[closer_m < 0]] = True
    return (
        np.concatenate([outer, *[inner] * len(tangents)]),
        np.concatenate([normal, *tangents]),
        np.concatenate([outer_room_m, np.zeros(len(tangents) * len(inner))]),
        np.maximum(np.concatenate([outer_spare_m, *spare_m]), 0.0),
        frozen,
    )


def _moving_outer_rows(
    places_m: Floats, stop_m: Floats, apart_m: Floats, r_m: Floats, obstacles: Obstacles, which: Indices
) -> tuple[Floats, Floats, Floats]:
    """Return normals (h, 2), room (h,) and spare (h,): the better of two candidates, as `_outer_rows` does."""
    a_m, b_m = obstacles.a_m[which], obstacles.b_m[which]
    path_m = np.subtract(*closest_points_of_segments(places_m[1], stop_m, a_m, b_m))
    length = np.maximum(length_m(np.stack([apart_m, path_m])), 1e-300)[..., None]
    candidate = np.stack([apart_m, path_m]) / length
    along_m = dot(candidate[:, None], places_m)
    beyond_m = np.maximum(dot(candidate, a_m), dot(candidate, b_m))
    room_m = along_m.min(axis=1) - beyond_m - obstacles.radius_m[which] - (r_m + obstacles.keep_m[which])
    spare_m = along_m[:, 0] - along_m.min(axis=1)
    closing_m = np.maximum(-dot(candidate, stop_m - places_m[0]) - spare_m, 0.0)
    better = (room_m[1] >= 0) & (room_m[1] - closing_m[1] > room_m[0] - closing_m[0] + 1e-9)
    normal = np.where(better[:, None], candidate[1], candidate[0])
    return normal, np.where(better, room_m[1], room_m[0]), np.where(better, spare_m[1], spare_m[0])


def _tangent_normals(point_m: Floats, obstacles: Obstacles, which: Indices) -> tuple[Floats, Floats]:
    """Return the inward normals (m, 2), (m, 2) of the cone of steps that come no nearer to any point of the hull.

    The hull's tangents seen from p are those of the balls about its two ends. With e the direction
    from an end to p and beta = asin(radius / distance), they are e turned by +-beta; of the two ends
    the outermost counts, angles being taken from the first end's direction.
    """
    ends = [point_m - obstacles.a_m[which], point_m - obstacles.b_m[which]]
    base = by_libm(math.atan2, ends[0][:, 1], ends[0][:, 0])
    angles = []
    for end in ends:
        beta = by_libm(math.asin, np.minimum(obstacles.radius_m[which] / np.maximum(length_m(end), 1e-300), 1.0))
        turn = by_libm(math.atan2, end[:, 1], end[:, 0]) - base
        turn = (turn + np.pi) % (2 * np.pi) - np.pi
        angles.append((turn - beta, turn + beta))
    low = base + np.minimum(angles[0][0], angles[1][0])
    high = base + np.maximum(angles[0][1], angles[1][1])
    return (
        np.stack([by_libm(math.cos, low), by_libm(math.sin, low)], axis=-1),
        np.stack([by_libm(math.cos, high), by_libm(math.sin, high)], axis=-1),
    )
