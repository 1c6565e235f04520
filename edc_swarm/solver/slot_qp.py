"""Slot QP: the steps of one slot nearest to the preferred ones that are safe in every execution.

With known disc centres p_k, R_kl = r_k + r_l and preferred steps v_k, |v_k| <= u_max:

    minimise   sum_k |u_k - v_k|^2
    for every near pair (k, l), with a unit normal n and g = n.(p_k - p_l) - R - delta >= 0:
               -n.u_k         <= g      (k moves, l holds)
                n.u_l         <= g      (l moves, k holds)
               -n.u_k + n.u_l <= g      (both move)

The rows are the corners of the box [0, 1]^2 of the fractions of their steps that k and l have flown, so every
asynchronous, partial or missing execution keeps n.(x_k - x_l) >= R: the discs are disjoint at every
instant, not only at the ends of slots. This is weaker, hence better, than keeping each UAV in its
buffered Voronoi cell (D. Zhou et al., IEEE RA-L 2(2), 2017), and u = 0 is always feasible. At the
optimum |u_k| <= |v_k| (scaling u_k down keeps every row), so no speed constraint is needed, and a
pair with |p_k - p_l| - R - delta >= |v_k| + |v_l| can never be active.

A barrier of a zone never moves, so it gives a row of one UAV: -n.u <= g with g = min n.(p - x) - D - delta over its
points x, where D is the distance that the UAV keeps. That is one corner of the box, and holds for every part of a step.

It replaces eq. 29-43 of the paper, whose convexification does not separate anything.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edc_swarm.geometry import (
    BarrierIndex,
    Barriers,
    Floats,
    Indices,
    by_libm,
    closest_points_of_segments,
    dot,
    indexed,
    length_m,
    near_pairs,
    nearest_on_segment,
    point_segment_distance_m,
    rotated,
)

DELTA_M = 0.02
"""Buffer of the rows for the solver's error, so that the separation stays above R."""
ON_EDGE_M = 1e-9
"""Distance from an edge up to which a UAV is on it: it may only fly into the airspace."""


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


@dataclass(frozen=True, slots=True)
class Problem:
    """One slot QP with everything that its certificate needs.

    Attributes
    ----------
    position_m, wish_m
        (n, 2) disc centres now, and preferred waypoints.
    u_max_m
        Longest step.
    first, second
        (p,) UAVs of each pair that could touch in this slot; first < second.
    normal
        (p, 2) unit vectors, from second to first.
    room_m
        (p,) n.(p_k - p_l) - R, without buffer.
    row_uav, row_normal, row_room_m
        (h,), (h, 2), (h,): the same for UAVs against hulls and barriers, where only the UAV moves.
    hull_rows
        Number of the first rows that are of hulls.
    frozen
        (n,) UAVs inside a hull, which must hold.
    """

    position_m: Floats
    wish_m: Floats
    u_max_m: float
    first: Indices
    second: Indices
    normal: Floats
    room_m: Floats
    row_uav: Indices
    row_normal: Floats
    row_room_m: Floats
    frozen: NDArray[np.bool_]
    hull_rows: int

    @property
    def wish_step_m(self) -> Floats:
        """Preferred steps v (n, 2)."""
        return self.wish_m - self.position_m

    def closing_m(self, step_m: Floats) -> tuple[Floats, Floats]:
        """Return the distances by which each pair's two UAVs close in along the normal, each >= 0, (p,) and (p,)."""
        return (
            np.maximum(-dot(self.normal, step_m[self.first]), 0.0),
            np.maximum(dot(self.normal, step_m[self.second]), 0.0),
        )

    def row_closing_m(self, step_m: Floats) -> Floats:
        """Return the distance by which the UAV of each hull or barrier closes in, (h,)."""
        return np.maximum(-dot(self.row_normal, step_m[self.row_uav]), 0.0)


def slot_problem(
    position_m: Floats,
    wish_m: Floats,
    r_m: Floats,
    u_max_m: float,
    obstacles: Obstacles | None = None,
    previous_m: Floats | None = None,
    airspace: Airspace | None = None,
) -> Problem:
    """Assemble the QP of one slot.

    With `previous_m` (vehicles that finish up to a slot late) each UAV occupies the segment from
    its previous to its present centre, and the room of a pair is that of the worst end points.
    """
    if previous_m is None:
        first, second, gap_m = _point_pairs(position_m, r_m, u_max_m)
        normal, room_m = _normals(position_m, position_m, wish_m, r_m, first, second, gap_m)
    else:
        first, second, gap_m = _segment_pairs(previous_m, position_m, r_m, u_max_m)
        normal, room_m = _normals(previous_m, position_m, wish_m, r_m, first, second, gap_m)
    hull_uav, *hull_rows, frozen = _obstacle_rows(position_m, wish_m, r_m, u_max_m, obstacles or Obstacles.none())
    uav, *rows, at_centre = _barrier_rows(position_m, wish_m, r_m, u_max_m, airspace or Airspace.unbounded())
    row_normal, row_room_m = (np.concatenate(both) for both in zip(hull_rows, rows, strict=True))
    return Problem(
        position_m,
        wish_m,
        u_max_m,
        first,
        second,
        normal,
        room_m,
        np.concatenate([hull_uav, uav]),
        row_normal,
        row_room_m,
        frozen | at_centre,
        len(hull_uav),
    )


def _point_pairs(position_m: Floats, r_m: Floats, u_max_m: float) -> tuple[Indices, Indices, Floats]:
    """Return the pairs that could touch, with the vector (p, 2) from second to first."""
    widest_m = 2 * float(r_m.max(initial=0.0)) + 2 * u_max_m + DELTA_M
    first, second = near_pairs(position_m, widest_m)
    apart_m = position_m[first] - position_m[second]
    near = length_m(apart_m) < r_m[first] + r_m[second] + DELTA_M + 2 * u_max_m
    return first[near], second[near], apart_m[near]


def _segment_pairs(
    previous_m: Floats, position_m: Floats, r_m: Floats, u_max_m: float
) -> tuple[Indices, Indices, Floats]:
    """Return the same for UAVs anywhere on their previous step, with the vectors of closest points."""
    longest_m = float(length_m(position_m - previous_m).max(initial=0.0))
    widest_m = 2 * float(r_m.max(initial=0.0)) + 2 * (u_max_m + longest_m) + DELTA_M
    first, second = near_pairs(position_m, widest_m)
    on_first, on_second = closest_points_of_segments(
        previous_m[first], position_m[first], previous_m[second], position_m[second]
    )
    return first, second, on_first - on_second


def _normals(
    previous_m: Floats,
    position_m: Floats,
    wish_m: Floats,
    r_m: Floats,
    first: Indices,
    second: Indices,
    apart_m: Floats,
) -> tuple[Floats, Floats]:
    """Return unit normals (p, 2) and room (p,) without buffer, of the best candidate of each pair.

    Any n in the cone cos(angle to d) >= (R + delta) / |d| gives g >= 0. Seven of these are candidates,
    and so is the direction along which the preferred steps are farthest from touching. The best leaves the most
    room after both preferred steps, max n.d - max(-n.v_k, 0) - max(n.v_l, 0).
    """
    distance_m = length_m(apart_m)
    sum_m = r_m[first] + r_m[second]
    centre = np.where(distance_m[:, None] > 0, apart_m / np.where(distance_m > 0, distance_m, 1.0)[:, None], [1.0, 0.0])
    ratio = (sum_m + DELTA_M) / np.maximum(distance_m, sum_m + DELTA_M)
    angle = by_libm(math.acos, np.minimum(ratio, 1.0)) * (1 - 1e-9)
    step_m = wish_m - position_m
    towards = _towards_wishes(apart_m, step_m[first], step_m[second], centre)
    candidate = np.concatenate([_fan(centre, angle), towards[None]])
    room_m = dot(candidate, apart_m[None]) - sum_m
    if previous_m is not position_m:
        room_m = np.minimum(room_m, _least_room_m(candidate, previous_m, position_m, first, second) - sum_m)
    closing_m = np.maximum(-dot(candidate, step_m[first][None]), 0.0) + np.maximum(
        dot(candidate, step_m[second][None]), 0.0
    )
    # From the end points of a previous step a candidate may not separate at all: it is not eligible.
    left_m = np.where(room_m >= 0, room_m - closing_m, -np.inf)
    # A candidate must win by more than rounding, so that symmetric situations keep the centre line.
    left_m[0] += 1e-9
    best = np.argmax(left_m, axis=0)
    pick = np.arange(len(first))
    return candidate[best, pick], room_m[best, pick]


def _fan(centre: Floats, half_angle: Floats) -> Floats:
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


def _towards_wishes(apart_m: Floats, first_m: Floats, second_m: Floats, centre: Floats) -> Floats:
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


def _least_room_m(normal: Floats, previous_m: Floats, position_m: Floats, first: Indices, second: Indices) -> Floats:
    """Return the least n.(x_k - x_l) over the end points of both previous steps, (candidates, p)."""
    nearest = np.minimum(dot(normal, previous_m[first][None]), dot(normal, position_m[first][None]))
    farthest = np.maximum(dot(normal, previous_m[second][None]), dot(normal, position_m[second][None]))
    return np.asarray(nearest - farthest)


def _obstacle_rows(
    position_m: Floats, wish_m: Floats, r_m: Floats, u_max_m: float, obstacles: Obstacles
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
    outer, which = np.nonzero(~inside & (room_m >= 0) & (room_m < u_max_m + DELTA_M))
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


def _barrier_rows(
    position_m: Floats, wish_m: Floats, r_m: Floats, u_max_m: float, airspace: Airspace
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
    near = away_m < keep_m + u_max_m + DELTA_M
    uav, which, keep_m = uav[near], which[near], keep_m[near]
    point_m, a_m, b_m = position_m[uav], barriers.a_m[which], barriers.b_m[which]
    side = barriers.side[which]
    candidate = _barrier_normals(point_m, wish_m[uav], a_m, b_m, side)
    apart_m = np.minimum(dot(candidate, point_m - a_m), dot(candidate, point_m - b_m))
    largest_m = np.maximum(np.abs(a_m), np.abs(b_m)).max(axis=1, initial=0.0) + np.abs(point_m).max(axis=1, initial=0.0)
    apart_m = apart_m - 16 * np.spacing(largest_m)
    step_m = wish_m[uav] - point_m
    left_m = apart_m - np.maximum(-dot(candidate, step_m), 0.0)
    least_m = np.maximum(np.minimum(keep_m, apart_m.max(axis=0, initial=-np.inf)), ON_EDGE_M)
    best = np.argmax(np.where(apart_m >= least_m, left_m, -np.inf), axis=0)
    pick = np.arange(len(uav))
    separates = apart_m[best, pick] >= least_m
    normal = np.where(separates[:, None], candidate[best, pick], side)
    room_m = np.where(separates, np.maximum(apart_m[best, pick] - keep_m, 0.0), 0.0)
    frozen = np.zeros(len(position_m), dtype=bool)
    frozen[uav[~separates & (side == 0).all(axis=1)]] = True
    return uav, normal, room_m, frozen


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
