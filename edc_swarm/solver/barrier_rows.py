"""Rows of the slot QP between UAVs and the barriers of zones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edc_swarm.geometry import (
    BarrierIndex,
    Barriers,
    Floats,
    Indices,
    closest_points_of_segments,
    dot,
    indexed,
    length_m,
    nearest_on_segment,
    point_segment_distance_m,
)
from edc_swarm.solver.normals import DELTA_M

ON_EDGE_M = 1e-9
"""Distance from an edge up to which a UAV is on it: it may only fly into the airspace."""


@dataclass(frozen=True, slots=True)
class Airspace:
    """The barriers of a mission, and an index of those that a UAV with a radius up to `r_m` can be near to."""

    barriers: Barriers
    index: BarrierIndex
    r_m: float

    @staticmethod
    def of(barriers: Barriers, r_m: float, reach_m: float) -> Airspace:
        """Return the airspace for UAVs with radii up to `r_m` that look `reach_m` further than they keep away."""
        least_m = barriers.least_m(np.full(1, r_m))[0]
        return Airspace(barriers, indexed(barriers, least_m + reach_m + DELTA_M), r_m)

    @staticmethod
    def unbounded() -> Airspace:
        """Return an airspace without barriers."""
        return Airspace.of(Barriers.none(), 0.0, 0.0)

    def contains(self, point_m: Floats) -> NDArray[np.bool_]:
        """Return a mask (n,) of the points that lie in the airspace, by the zones' polygons and circles."""
        return self.barriers.airspace_contains(point_m)


def barrier_rows(
    position_m: Floats, wish_m: Floats, r_m: Floats, u_max_m: Floats, airspace: Airspace
) -> tuple[Indices, Floats, Floats, NDArray[np.bool_]]:
    """Return the rows of the UAVs within reach of a barrier, and a mask of the UAVs at the centre of a circle.

    A normal n separates the UAV from the barrier if the least n.(p - x) over its points x, which is at one of its
    ends, is above `ON_EDGE_M`. The row has the normal of these that leaves the most room after the preferred step.
    It keeps the distance D, or, for a UAV that starts nearer, the present distance. A UAV on an edge has no normal
    that separates: it may fly to the side of the airspace.
    """
    assert r_m.max(initial=0.0) <= airspace.r_m or not len(airspace.index.which)
    uav, which = airspace.index.near(position_m)
    barriers = airspace.barriers
    keep_m = barriers.radius_m[which] + barriers.keeps_disc[which] * r_m[uav]
    away_m = point_segment_distance_m(position_m[uav], barriers.a_m[which], barriers.b_m[which])
    near = away_m < keep_m + u_max_m[uav] + DELTA_M
    uav, which, keep_m = uav[near], which[near], keep_m[near]
    point_m, a_m, b_m = position_m[uav], barriers.a_m[which], barriers.b_m[which]
    side = barriers.side[which]
    candidate = _barrier_normals(point_m, wish_m[uav], a_m, b_m, side)
    apart_m = np.minimum(dot(candidate, point_m - a_m), dot(candidate, point_m - b_m))
    largest_m = np.maximum(np.abs(a_m), np.abs(b_m)).max(axis=1, initial=0.0) + np.abs(point_m).max(axis=1, initial=0.0)
    apart_m = apart_m - 16 * np.spacing(largest_m)
    step_m = wish_m[uav] - point_m
    left_m = apart_m - np.maximum(-dot(candidate, step_m), 0.0)
    _, separates, normal, room_m = _best_rows(candidate, apart_m, left_m, keep_m, side)
    frozen = np.zeros(len(position_m), dtype=bool)
    frozen[uav[~separates & (side == 0).all(axis=1)]] = True
    return uav, normal, room_m, frozen


def moving_barrier_rows(
    places_m: Floats, stop_m: Floats, r_m: Floats, reach_m: Floats, airspace: Airspace
) -> tuple[Indices, Floats, Floats, Floats, NDArray[np.bool_]]:
    """Return the rows of UAVs that cannot stop at once: UAV, normal, room and spare; and a mask as `barrier_rows`.

    `places_m` (2 or 3, n, 2) are the rests, the positions and, with lag, the previous ones. The least of all counts, so
    a curve that cuts the corner of a turn keeps the distance too.
    """
    assert r_m.max(initial=0.0) <= airspace.r_m or not len(airspace.index.which)
    barriers = airspace.barriers
    uav, which = airspace.index.near(places_m[1])
    keep_m = barriers.radius_m[which] + barriers.keeps_disc[which] * r_m[uav]
    a_m, b_m = barriers.a_m[which], barriers.b_m[which]
    straight_m = np.subtract(*closest_points_of_segments(places_m[-1, uav], places_m[0, uav], a_m, b_m))
    near = length_m(straight_m) < keep_m + reach_m[uav] + DELTA_M
    uav, which = uav[near], which[near]
    keep_m, straight_m, a_m, b_m = keep_m[near], straight_m[near], a_m[near], b_m[near]
    points_m, side = places_m[:, uav], barriers.side[which]
    path_m = np.subtract(*closest_points_of_segments(points_m[1], stop_m[uav], a_m, b_m))
    towards = np.stack([straight_m, path_m])
    length = length_m(towards)[..., None]
    candidate = np.concatenate(
        [np.stack([side, -side]), np.where(length > 0, towards / np.where(length > 0, length, 1), 0.0)]
    )
    along_m = dot(candidate[:, None], points_m)
    spare_m = along_m[:, 0] - along_m.min(axis=1)
    largest_m = np.abs(np.stack([a_m, b_m])).max(axis=(0, 2), initial=0.0) + np.abs(points_m).max(
        axis=(0, 2), initial=0.0
    )
    beyond_m = np.maximum(dot(candidate, a_m), dot(candidate, b_m))
    apart_m = along_m.min(axis=1) - beyond_m - 16 * np.spacing(largest_m)
    left_m = apart_m - np.maximum(-dot(candidate, stop_m[uav] - points_m[0]) - spare_m, 0.0)
    best, separates, normal, room_m = _best_rows(candidate, apart_m, left_m, keep_m, side)
    inwards_m = np.maximum(dot(side, points_m[0] - points_m[1]), 0.0)
    frozen = np.zeros(len(r_m), dtype=bool)
    frozen[uav[~separates & (side == 0).all(axis=1)]] = True
    return uav, normal, room_m, np.where(separates, spare_m[best, np.arange(len(uav))], inwards_m), frozen


def _best_rows(
    candidate: Floats, apart_m: Floats, left_m: Floats, keep_m: Floats, side: Floats
) -> tuple[Indices, NDArray[np.bool_], Floats, Floats]:
    """Return, for each row, the candidate that leaves most room: its index, a mask, normal and room.

    Candidates (c, m, 2) keep their UAV `apart_m` (c, m) from the barrier and leave `left_m` of that after its step. The
    mask is False where none separates; then the normal is `side`, without room.
    """
    least_m = np.maximum(np.minimum(keep_m, apart_m.max(axis=0, initial=-np.inf)), ON_EDGE_M)
    best = np.argmax(np.where(apart_m >= least_m, left_m, -np.inf), axis=0)
    pick = np.arange(len(keep_m))
    separates = apart_m[best, pick] >= least_m
    normal = np.where(separates[:, None], candidate[best, pick], side)
    return best, separates, normal, np.where(separates, np.maximum(apart_m[best, pick] - keep_m, 0.0), 0.0)


def _barrier_normals(point_m: Floats, wish_m: Floats, a_m: Floats, b_m: Floats, side: Floats) -> Floats:
    """Return the unit normals (4, h, 2) that a row may have.

    These are both normals of an edge, the direction from its nearest point, and that from where the preferred step is
    nearest. The first two are exact even where a UAV almost touches an edge.
    """
    straight = point_m - nearest_on_segment(point_m, a_m, b_m)
    on_step, on_edge = closest_points_of_segments(point_m, wish_m, a_m, b_m)
    towards = np.stack([straight, on_step - on_edge])
    length = length_m(towards)[..., None]
    return np.concatenate(
        [np.stack([side, -side]), np.where(length > 0, towards / np.where(length > 0, length, 1), 0.0)]
    )
