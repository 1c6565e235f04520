"""Certificate: it turns any steps of a solver into steps that keep every pair apart.

For each pair with normal n and true room g = n.(p_k - p_l) - R let a = max(-n.u_k, 0) and
b = max(n.u_l, 0) be the distances by which each one closes in. Scaling both steps by any factors <= f with
f (a + b) <= g keeps the discs apart however the steps are flown, so each step is scaled by the least
f of its pairs. The last check repeats this on the published floats, waypoint - position.

In a row without room, f is 0 as soon as a solver's residual of 1e-13 closes in. So a first pass replaces a step
that breaks its rows by no more than a solver's error with the nearest step that keeps them all with `_inward_m` to
spare. That pass needs no proof: the passes after it accept any steps. The proof is the last check alone. Let u be a
published step, computed in floats, and e a bound on the rounding of waypoint - position and of the product with n;
`_rounding_m` is many times larger. The check keeps

    -n.u + e  <= max(g - MARGIN_M / 2, 0)     in every row of a UAV that moves
    a + b + e <= max(g - MARGIN_M / 2, 0)     if both UAVs of a pair move and close in

So the exact step between the published floats has -n.u <= max(g - MARGIN_M / 2, 0) without any tolerance. Rows
without room are kept strictly, and no error accumulates from slot to slot. A hold keeps every row, so a step
rejected for one row breaks no other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edc_swarm.geometry import Floats, Indices, dot, length_m
from edc_swarm.solver.slot_qp import Problem
from edc_swarm.solver.stopping import STOP_SLACK

MARGIN_M = 1e-9
"""Room kept free for rounding."""
SNAP_M = 1e-10
"""Distance from the preferred waypoint within which a step ends exactly there."""
RESIDUAL_M = 1e-3
"""Largest violation that the first pass repairs, ten times a solver's error; in a row with more room than this,
scaling shortens a step only slightly."""


@dataclass(frozen=True, slots=True)
class Certified:
    """Waypoints (n, 2) safe to publish, and a mask (n,) of the UAVs that the certificate slowed down."""

    waypoint_m: Floats
    scaled: NDArray[np.bool_]


def certify(problem: Problem, step_m: Floats) -> Certified:
    """Make any steps (n, 2) safe, with NaN and infinities among them; see the module's docstring."""
    step_m = _limited(problem, step_m)
    if (slips := _slips(problem, step_m)).any():
        step_m = _limited(problem, _onto_rows(problem, step_m, slips))
    share = _shares(problem, step_m)
    momentum = problem.momentum
    if momentum is None:
        waypoint_m, stay_m = _rounded(problem, share[:, None] * step_m), problem.position_m
    else:
        waypoint_m, stay_m = momentum.nearest_m(problem.position_m, share[:, None] * step_m), momentum.braked_m
    waypoint_m = np.where(_refused(problem, waypoint_m)[:, None], stay_m, waypoint_m)
    return Certified(waypoint_m, share < 1.0)


def least_gap_m(problem: Problem, waypoint_m: Floats) -> float:
    """Return the least room n.(x_k - x_l) - R in any execution of the steps; infinite without pairs."""
    step_m = problem.flown_m(waypoint_m)
    closing_first_m, closing_second_m = problem.closing_m(step_m)
    pairs_m = problem.room_m - closing_first_m - closing_second_m
    rows_m = (problem.row_room_m - problem.row_closing_m(step_m))[: problem.hull_rows]
    return float(min(pairs_m.min(initial=math.inf), rows_m.min(initial=math.inf)))


def _limited(problem: Problem, step_m: Floats) -> Floats:
    """Return finite steps no longer than each UAV's u_max; a NaN step, or one from inside a hull, becomes a hold."""
    # Lengths overflow far beyond any speed limit: such a step becomes a hold too. NaN fails the comparison.
    small: NDArray[np.bool_] = np.abs(step_m) < 1e150
    usable = small.all(axis=1) & ~problem.frozen
    step_m = np.where(np.reshape(usable, (-1, 1)), step_m, 0.0)
    length = length_m(step_m)
    limit_m = _limit_m(problem)
    too_long = length > limit_m
    scale = np.where(too_long, limit_m / np.where(too_long, length, 1.0), 1.0)
    limited_m: Floats = step_m * np.reshape(scale, (-1, 1))
    return limited_m


def _limit_m(problem: Problem) -> Floats:
    """Return u_max minus the largest rounding error of position + step, (n,)."""
    ulp_m = np.spacing(np.abs(problem.position_m).max(axis=1, initial=0.0) + problem.u_max_m)
    limit_m: Floats = np.maximum(problem.u_max_m - 4 * ulp_m, 0.0)
    return limit_m


def _shares(problem: Problem, step_m: Floats) -> Floats:
    """Return the largest certified share of each step, (n,)."""
    share = np.ones(len(step_m))
    closing_first_m, closing_second_m = problem.closing_m(step_m)
    pair_share = _share(closing_first_m + closing_second_m, problem.room_m)
    np.minimum.at(share, problem.first, pair_share)
    np.minimum.at(share, problem.second, pair_share)
    np.minimum.at(share, problem.row_uav, _share(problem.row_closing_m(step_m), problem.row_room_m))
    return share


def _share(closing_m: Floats, room_m: Floats) -> Floats:
    usable_m = np.maximum(room_m - MARGIN_M, 0.0)
    share = np.ones(len(closing_m))
    over = closing_m > usable_m
    share[over] = usable_m[over] / closing_m[over]
    return share


def _rounded(problem: Problem, step_m: Floats) -> Floats:
    """Return the waypoints to publish: exactly the preferred ones for preferred steps."""
    waypoint_m = problem.position_m + step_m
    near = length_m(waypoint_m - problem.wish_m) <= SNAP_M
    near &= length_m(problem.wish_step_m) <= _limit_m(problem)
    return np.where(near[:, None], problem.wish_m, waypoint_m)


def _refused(problem: Problem, waypoint_m: Floats) -> NDArray[np.bool_]:
    """Return a mask (n,) of the UAVs whose published floats break a row or the speed limit: they hold instead.

    A hold is safe with any steps of the others (it is a corner of every row), so one pass is enough. With momentum the
    same holds for braking.
    """
    step_m = problem.flown_m(waypoint_m)
    over = _rows_over_m(problem, step_m, MARGIN_M / 2)
    rounding_m = _rounding_m(problem)
    if problem.momentum is None:
        refused = _too_long(step_m, problem.u_max_m)
    else:
        refused = ~problem.momentum.allows(waypoint_m, STOP_SLACK) | problem.frozen
    for uav, over_m, _ in over:
        refused[uav[over_m > -rounding_m]] = True
    return refused


def _rows_over_m(problem: Problem, step_m: Floats, margin_m: float) -> list[tuple[Indices, Floats, Floats]]:
    """Return (uav, over, usable) of each row of a UAV that moves: over = closing - usable, in metres.

    usable = max(room - `margin_m`, 0). The UAV keeps the row if over <= 0. A pair has a row for each of its UAVs,
    and a row for both if both close in.
    """
    moves: NDArray[np.bool_] = np.any(step_m != 0, axis=1)
    usable_m, row_usable_m = (np.maximum(room_m - margin_m, 0.0) for room_m in (problem.room_m, problem.row_room_m))
    first, second, single = problem.first, problem.second, problem.row_uav
    a_m = -dot(problem.normal, step_m[first]) - problem.first_spare_m
    b_m = dot(problem.normal, step_m[second]) - problem.second_spare_m
    both = moves[first] & moves[second] & (a_m > 0) & (b_m > 0)
    row_m = -dot(problem.row_normal, step_m[single]) - problem.row_spare_m
    return [
        (uav[counts], (closing_m - room_m)[counts], room_m[counts])
        for uav, counts, closing_m, room_m in (
            (first, moves[first], a_m, usable_m),
            (second, moves[second], b_m, usable_m),
            (first, both, a_m + b_m, usable_m),
            (second, both, a_m + b_m, usable_m),
            (single, moves[single], row_m, row_usable_m),
        )
    ]


def _rounding_m(problem: Problem) -> float:
    """Return a bound above all rounding errors of a row: waypoint - position, the normal, and their product."""
    largest_m = np.abs(problem.position_m).max(initial=0.0) + problem.u_max_m.max(initial=0.0)
    gain = 1.0 if problem.momentum is None else problem.momentum.gain
    return float(8 * gain * np.spacing(largest_m + np.abs(problem.room_m).max(initial=0.0)))


def _inward_m(problem: Problem) -> float:
    """Return the distance by which a repaired step stays inside its rows: above rounding, snapping and last check."""
    return 2 * MARGIN_M + 8 * _rounding_m(problem)


def _slips(problem: Problem, step_m: Floats) -> NDArray[np.bool_]:
    """Return a mask (n,) of the UAVs that break rows, or nearly do, by no more than a solver's error."""
    slips = np.zeros(len(step_m), dtype=bool)
    least_m = -_inward_m(problem) / 2
    for uav, over_m, usable_m in _rows_over_m(problem, step_m, MARGIN_M):
        slips[uav[(over_m > least_m) & (over_m <= RESIDUAL_M) & (usable_m <= RESIDUAL_M)]] = True
    return slips


def _onto_rows(problem: Problem, step_m: Floats, slips: NDArray[np.bool_]) -> Floats:
    """Return the steps, with each step in `slips` moved, one after another, to the nearest point inside its rows."""
    step_m, inward_m = step_m.copy(), _inward_m(problem)
    usable_m, row_usable_m = (np.maximum(room_m - MARGIN_M, 0.0) for room_m in (problem.room_m, problem.row_room_m))
    first_spare_m, second_spare_m = (
        np.broadcast_to(spare, usable_m.shape) for spare in (problem.first_spare_m, problem.second_spare_m)
    )
    row_spare_m = np.broadcast_to(problem.row_spare_m, row_usable_m.shape)
    for uav in np.flatnonzero(slips):
        first, second, single = (
            np.flatnonzero(which == uav) for which in (problem.first, problem.second, problem.row_uav)
        )
        closing_first_m, closing_second_m = problem.closing_m(step_m)
        normal = np.concatenate([problem.normal[first], -problem.normal[second], problem.row_normal[single]])
        room_m = np.concatenate(
            [
                (usable_m - closing_second_m)[first],
                (usable_m - closing_first_m)[second],
                row_usable_m[single],
            ]
        )
        spare_m = np.concatenate([first_spare_m[first], second_spare_m[second], row_spare_m[single]])
        step_m[uav] = nearest_step_m(step_m[uav], normal, inward_m - np.maximum(room_m, 0.0) - spare_m)
    return step_m


def nearest_step_m(wish_m: Floats, normal: Floats, least_m: Floats) -> Floats:
    """Return the step u (2,) nearest to `wish_m` with normal.u >= least_m in all rows (h, 2), (h,); else a zero step.

    The optimum is the wish, its projection on one row's line, or the corner of two of them.
    """
    on_line = wish_m + (least_m - dot(normal, wish_m))[:, None] * normal
    i, j = np.triu_indices(len(least_m), 1)
    det = normal[i, 0] * normal[j, 1] - normal[i, 1] * normal[j, 0]
    crossing = np.abs(det) > 1e-12
    i, j, det = i[crossing], j[crossing], det[crossing]
    corner = np.stack(
        [
            (least_m[i] * normal[j, 1] - least_m[j] * normal[i, 1]) / det,
            (least_m[j] * normal[i, 0] - least_m[i] * normal[j, 0]) / det,
        ],
        axis=-1,
    )
    trial = np.concatenate([wish_m[None], on_line, corner])
    slack_m = (trial @ normal.T - least_m).min(axis=1, initial=np.inf)
    away_m = np.where(slack_m >= -1e-3 * MARGIN_M, length_m(trial - wish_m), np.inf)
    best = int(np.argmin(away_m))
    return trial[best] if away_m[best] < np.inf else np.zeros(2)


def limited_waypoints(position_m: Floats, wish_m: Floats, u_max_m: Floats | float) -> Floats:
    """Return the preferred waypoints within one step, else the points one full step towards them.

    `u_max_m` is the longest step of each UAV (n,), or one for all.
    """
    u_max_m = np.broadcast_to(np.asarray(u_max_m, dtype=np.float64), (len(position_m),))
    none = np.empty(0, np.int64)
    problem = Problem(
        position_m, wish_m, u_max_m, none, none, np.empty((0, 2)), np.empty(0),
        none, np.empty((0, 2)), np.empty(0), np.zeros(len(position_m), dtype=bool), 0,
    )  # fmt: skip
    return certify(problem, problem.wish_step_m).waypoint_m


def _too_long(step_m: Floats, u_max_m: Floats) -> NDArray[np.bool_]:
    """Return a mask of the steps that a UAV would reject as too long; close cases use the UAV's own test."""
    too_long: NDArray[np.bool_] = ~(length_m(step_m) <= u_max_m * (1 - 1e-12))
    for uav in np.flatnonzero(too_long):
        too_long[uav] = not math.hypot(step_m[uav, 0], step_m[uav, 1]) <= u_max_m[uav]
    return too_long


__all__ = ["MARGIN_M", "Certified", "certify", "least_gap_m", "limited_waypoints", "nearest_step_m"]
