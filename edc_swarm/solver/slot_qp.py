"""Slot QP: the steps of one slot nearest to the preferred ones that are safe in every execution.

With known disc centres p_k, R_kl = r_k + r_l and preferred steps v_k, |v_k| <= u_k,max:

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
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edc_swarm.geometry import (
    Floats,
    Indices,
    by_libm,
    closest_points_of_segments,
    dot,
    length_m,
    near_pairs,
)
from edc_swarm.solver.barrier_rows import Airspace, barrier_rows, moving_barrier_rows
from edc_swarm.solver.foreign_rows import Foreign, foreign_rows
from edc_swarm.solver.hull_rows import Obstacles, moving_obstacle_rows, obstacle_rows
from edc_swarm.solver.normals import DELTA_M, fan, towards_wishes
from edc_swarm.solver.stopping import Momentum


@dataclass(frozen=True, slots=True)
class Problem:
    """One slot QP with everything that its certificate needs.

    Attributes
    ----------
    position_m, wish_m
        (n, 2) disc centres now, and preferred waypoints. With momentum: rests, and preferred stopping points.
    u_max_m
        (n,) longest step of each UAV.
    first, second
        (p,) UAVs of each pair that could touch in this slot; first < second.
    normal
        (p, 2) unit vectors, from second to first.
    room_m
        (p,) n.(p_k - p_l) - R, without buffer.
    row_uav, row_normal, row_room_m
        (h,), (h, 2), (h,): the same for UAVs against hulls, barriers and, with half of the room, UAVs of other
        clusters: the plan moves only the UAV.
    hull_rows
        Number of the first rows that are of hulls.
    frozen
        (n,) UAVs inside a hull, which must hold (with momentum: brake).
    first_spare_m, second_spare_m, row_spare_m
        (p,), (p,), (h,) distances by which a UAV may close in from its rest before it is nearer than on its way there.
    momentum
        Motion of the UAVs, None if all can stop at once. Steps are then ways from rest to stopping point.
    """

    position_m: Floats
    wish_m: Floats
    u_max_m: Floats
    first: Indices
    second: Indices
    normal: Floats
    room_m: Floats
    row_uav: Indices
    row_normal: Floats
    row_room_m: Floats
    frozen: NDArray[np.bool_]
    hull_rows: int
    first_spare_m: Floats | float = 0.0
    second_spare_m: Floats | float = 0.0
    row_spare_m: Floats | float = 0.0
    momentum: Momentum | None = None

    @property
    def wish_step_m(self) -> Floats:
        """Preferred steps v (n, 2)."""
        return self.wish_m - self.position_m

    def closing_m(self, step_m: Floats) -> tuple[Floats, Floats]:
        """Return the distances by which each pair's two UAVs close in along the normal, each >= 0, (p,) and (p,)."""
        return (
            np.maximum(-dot(self.normal, step_m[self.first]) - self.first_spare_m, 0.0),
            np.maximum(dot(self.normal, step_m[self.second]) - self.second_spare_m, 0.0),
        )

    def row_closing_m(self, step_m: Floats) -> Floats:
        """Return the distance by which the UAV of each hull or barrier closes in, (h,)."""
        return np.maximum(-dot(self.row_normal, step_m[self.row_uav]) - self.row_spare_m, 0.0)

    def flown_m(self, waypoint_m: Floats) -> Floats:
        """Return the steps (n, 2) that lead to these waypoints, with momentum the ways from rest to stopping point."""
        return (waypoint_m if self.momentum is None else self.momentum.stops_m(waypoint_m)) - self.position_m


def slot_problem(
    position_m: Floats,
    wish_m: Floats,
    r_m: Floats,
    u_max_m: Floats | float,
    obstacles: Obstacles | None = None,
    previous_m: Floats | None = None,
    airspace: Airspace | None = None,
    uav: Indices | None = None,
    foreign: Foreign | None = None,
) -> Problem:
    """Assemble the QP of one slot; `u_max_m` is the longest step of each UAV (n,), or one for all.

    With `previous_m` (vehicles that finish up to a slot late) each UAV occupies the segment from
    its previous to its present centre, and the room of a pair is that of the worst end points. `foreign` UAVs need the
    roster indices `uav` (n,) of the others.
    """
    u_max_m = np.broadcast_to(np.asarray(u_max_m, dtype=np.float64), (len(position_m),))
    if previous_m is None:
        first, second, gap_m = _point_pairs(position_m, r_m, u_max_m)
        normal, room_m = _normals(position_m, position_m, wish_m, r_m, first, second, gap_m)
    else:
        first, second, gap_m = _segment_pairs(previous_m, position_m, r_m, u_max_m)
        normal, room_m = _normals(previous_m, position_m, wish_m, r_m, first, second, gap_m)
    hull_uav, *hull_rows, frozen = obstacle_rows(position_m, wish_m, r_m, u_max_m, obstacles or Obstacles.none())
    walled, *rows, at_centre = barrier_rows(position_m, wish_m, r_m, u_max_m, airspace or Airspace.unbounded())
    kinds: list[list[NDArray[Any]]] = [[hull_uav, *hull_rows, frozen], [walled, *rows, at_centre]]
    if uav is not None and foreign is not None:
        places_m = np.stack([position_m] if previous_m is None else [position_m, previous_m])
        others = foreign_rows(uav, places_m, r_m, u_max_m, foreign)
        kinds.append([others.uav, others.normal, others.room_m, others.frozen])
    (row_uav, row_normal, row_room_m), frozen = _stacked(kinds)
    return Problem(
        position_m,
        wish_m,
        u_max_m,
        first,
        second,
        normal,
        room_m,
        row_uav,
        row_normal,
        row_room_m,
        frozen,
        len(hull_uav),
    )


def _stacked(kinds: Sequence[Sequence[NDArray[Any]]]) -> tuple[list[NDArray[Any]], NDArray[np.bool_]]:
    """Return the columns of the rows of all kinds, one kind behind the other, and the UAVs that any kind freezes.

    Each kind has its columns, and a mask (n,) of the UAVs that it freezes.
    """
    *columns, frozen = zip(*kinds, strict=True)
    return [np.concatenate(parts) for parts in columns], np.asarray(np.any(frozen, axis=0))


def moving_problem(
    momentum: Momentum,
    wish_m: Floats,
    r_m: Floats,
    obstacles: Obstacles | None = None,
    previous_m: Floats | None = None,
    airspace: Airspace | None = None,
    uav: Indices | None = None,
    foreign: Foreign | None = None,
) -> Problem:
    """Assemble the QP of one slot for UAVs that cannot stop at once; `wish_m` are waypoints that they can fly to.

    A UAV occupies the segment from its position p (with `previous_m` from its previous centre, on the same line) to its
    rest q, and with its step the segment from p to its stopping point q + z too. Along one normal n the least of
    p, q and q + z counts. Hence the UAV closes in by max(-n.z - spare, 0), where spare = n.q - min(n.p, n.q), and all
    rows are linear in z.
    """
    rest_m, stop_m, reach_m = momentum.rest_m, momentum.stops_m(wish_m), momentum.reach_m
    starts_m = (momentum.position_m,) if previous_m is None else (momentum.position_m, previous_m)
    first, second, gap_m = _segment_pairs(starts_m[-1], rest_m, r_m, reach_m)
    sum_m = r_m[first] + r_m[second] + DELTA_M
    near = length_m(gap_m) < sum_m + reach_m[first] + reach_m[second]
    first, second, gap_m = first[near], second[near], gap_m[near]
    path_m = np.subtract(
        *closest_points_of_segments(
            momentum.position_m[first], stop_m[first], momentum.position_m[second], stop_m[second]
        )
    )
    places_m = np.stack([rest_m, *starts_m])
    normal, room_m, spare_m = _moving_normals(places_m, stop_m - rest_m, r_m, first, second, gap_m, path_m)
    obstacles, airspace = obstacles or Obstacles.none(), airspace or Airspace.unbounded()
    hull_uav, *hull_rows, frozen = moving_obstacle_rows(places_m, stop_m, r_m, reach_m, obstacles)
    walled, *rows, at_centre = moving_barrier_rows(places_m, stop_m, r_m, reach_m, airspace)
    kinds: list[list[NDArray[Any]]] = [[hull_uav, *hull_rows, frozen], [walled, *rows, at_centre]]
    if uav is not None and foreign is not None:
        others = foreign_rows(uav, places_m, r_m, reach_m, foreign)
        kinds.append([others.uav, others.normal, others.room_m, others.spare_m, others.frozen])
    (row_uav, row_normal, row_room_m, row_spare_m), frozen = _stacked(kinds)
    return Problem(
        rest_m,
        stop_m,
        reach_m,
        first,
        second,
        normal,
        room_m,
        row_uav,
        row_normal,
        row_room_m,
        frozen,
        len(hull_uav),
        spare_m[0],
        spare_m[1],
        row_spare_m,
        momentum,
    )


def _point_pairs(position_m: Floats, r_m: Floats, u_max_m: Floats) -> tuple[Indices, Indices, Floats]:
    """Return the pairs that could touch, with the vector (p, 2) from second to first."""
    widest_m = 2 * float(r_m.max(initial=0.0)) + 2 * float(u_max_m.max(initial=0.0)) + DELTA_M
    first, second = near_pairs(position_m, widest_m)
    apart_m = position_m[first] - position_m[second]
    near = length_m(apart_m) < r_m[first] + r_m[second] + DELTA_M + (u_max_m[first] + u_max_m[second])
    return first[near], second[near], apart_m[near]


def _segment_pairs(
    previous_m: Floats, position_m: Floats, r_m: Floats, u_max_m: Floats
) -> tuple[Indices, Indices, Floats]:
    """Return the same for UAVs anywhere on their previous step, with the vectors of closest points."""
    longest_m = float(length_m(position_m - previous_m).max(initial=0.0))
    widest_m = 2 * float(r_m.max(initial=0.0)) + 2 * (float(u_max_m.max(initial=0.0)) + longest_m) + DELTA_M
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
    towards = towards_wishes(apart_m, step_m[first], step_m[second], centre)
    candidate = np.concatenate([fan(centre, angle), towards[None]])
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


def _least_room_m(normal: Floats, previous_m: Floats, position_m: Floats, first: Indices, second: Indices) -> Floats:
    """Return the least n.(x_k - x_l) over the end points of both previous steps, (candidates, p)."""
    nearest = np.minimum(dot(normal, previous_m[first][None]), dot(normal, position_m[first][None]))
    farthest = np.maximum(dot(normal, previous_m[second][None]), dot(normal, position_m[second][None]))
    return np.asarray(nearest - farthest)


def _moving_normals(
    places_m: Floats, step_m: Floats, r_m: Floats, first: Indices, second: Indices, apart_m: Floats, path_m: Floats
) -> tuple[Floats, Floats, tuple[Floats, Floats]]:
    """Return normal (p, 2), room, and the spare of both UAVs, each (p,), of the best candidate of each pair.

    `places_m` (2 or 3, n, 2) are the rests, the positions and with lag the previous ones. The candidates are those of
    `_normals`, with the vector between the two closest points of the declared paths, `path_m` (p, 2).
    """
    distance_m = length_m(apart_m)
    sum_m = r_m[first] + r_m[second]
    centre = np.where(distance_m[:, None] > 0, apart_m / np.where(distance_m > 0, distance_m, 1.0)[:, None], [1.0, 0.0])
    ratio = (sum_m + DELTA_M) / np.maximum(distance_m, sum_m + DELTA_M)
    angle = by_libm(math.acos, np.minimum(ratio, 1.0)) * (1 - 1e-9)
    least_m = length_m(path_m)[:, None]
    path = np.where(least_m > DELTA_M, path_m / np.maximum(least_m, DELTA_M), centre)
    towards = towards_wishes(apart_m, step_m[first], step_m[second], centre)
    candidate = np.concatenate([fan(centre, angle), towards[None], path[None]])
    nearest_m = dot(candidate[:, None], places_m[:, first])
    farthest_m = dot(candidate[:, None], places_m[:, second])
    room_m = nearest_m.min(axis=1) - farthest_m.max(axis=1) - sum_m
    spare_m = nearest_m[:, 0] - nearest_m.min(axis=1), farthest_m.max(axis=1) - farthest_m[:, 0]
    closing_m = np.maximum(-dot(candidate, step_m[first][None]) - spare_m[0], 0.0) + np.maximum(
        dot(candidate, step_m[second][None]) - spare_m[1], 0.0
    )
    left_m = np.where(room_m >= 0, room_m - closing_m, -np.inf)
    left_m[0] += 1e-9
    best = np.argmax(left_m, axis=0)
    pick = np.arange(len(first))
    return candidate[best, pick], room_m[best, pick], (spare_m[0][best, pick], spare_m[1][best, pick])
