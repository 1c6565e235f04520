"""The certificate: whatever a solver returned, only steps that keep every pair apart get through.

For each pair with normal n and true room g = n.(p_k - p_l) - R let a = max(-n.u_k, 0) and
b = max(n.u_l, 0) be what each one closes in. Scaling both steps by any factors <= f with
f (a + b) <= g keeps the discs apart however the steps are flown, so each step is scaled by the least
f of its pairs. The checks are made again on the floats that are published, waypoint - position.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edc_swarm.geometry import Floats, length_m
from edc_swarm.solver.slot_qp import Problem

MARGIN_M = 1e-9
"""Room that is never used, for rounding."""
SNAP_M = 1e-10
"""A step this near to the preferred one ends exactly there."""


@dataclass(frozen=True, slots=True)
class Certified:
    """Waypoints (n, 2) that may be published, and who had to be slowed down (n,)."""

    waypoint_m: Floats
    scaled: NDArray[np.bool_]


def certify(problem: Problem, step_m: Floats) -> Certified:
    """Make any steps (n, 2), NaN and infinities included, safe; see the module's docstring."""
    step_m = _limited(problem, step_m)
    share = _shares(problem, step_m)
    waypoint_m = _rounded(problem, share[:, None] * step_m)
    waypoint_m = np.where(_refused(problem, waypoint_m)[:, None], problem.position_m, waypoint_m)
    return Certified(waypoint_m, share < 1.0)


def least_gap_m(problem: Problem, waypoint_m: Floats) -> float:
    """Least room n.(x_k - x_l) - R left in any execution of the steps; infinite without pairs."""
    step_m = waypoint_m - problem.position_m
    closing_first_m, closing_second_m = problem.closing_m(step_m)
    pairs_m = problem.room_m - closing_first_m - closing_second_m
    rows_m = problem.row_room_m - problem.row_closing_m(step_m)
    return float(min(pairs_m.min(initial=math.inf), rows_m.min(initial=math.inf)))


def _limited(problem: Problem, step_m: Floats) -> Floats:
    """Finite steps no longer than u_max; a step that is no number, or from inside a hull, is none."""
    # Far beyond any speed limit lengths overflow: such a step is no step either. NaN fails too.
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
    """u_max less what the rounding of position + step can add, (n,)."""
    ulp_m = np.spacing(np.abs(problem.position_m).max(axis=1, initial=0.0) + problem.u_max_m)
    limit_m: Floats = np.maximum(problem.u_max_m - 4 * ulp_m, 0.0)
    return limit_m


def _shares(problem: Problem, step_m: Floats) -> Floats:
    """Largest certified share of each step, (n,)."""
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
    """Waypoints as published: exactly the preferred ones where the step is the preferred one."""
    waypoint_m = problem.position_m + step_m
    near = length_m(waypoint_m - problem.wish_m) <= SNAP_M
    near &= length_m(problem.wish_step_m) <= _limit_m(problem)
    return np.where(near[:, None], problem.wish_m, waypoint_m)


def _refused(problem: Problem, waypoint_m: Floats) -> NDArray[np.bool_]:
    """UAVs (n,) whose published floats break a row or the speed limit: they hold instead.

    Holding is safe whatever the others do (it is a corner of every row), so one pass is enough.
    """
    step_m = waypoint_m - problem.position_m
    rounding_m = 8 * np.spacing(np.abs(waypoint_m).max(initial=0.0) + np.abs(problem.room_m).max(initial=0.0))
    closing_first_m, closing_second_m = problem.closing_m(step_m)
    bad = closing_first_m + closing_second_m > np.maximum(problem.room_m - MARGIN_M / 2, 0.0) + rounding_m
    bad_row = problem.row_closing_m(step_m) > np.maximum(problem.row_room_m - MARGIN_M / 2, 0.0) + rounding_m
    refused = _too_long(step_m, problem.u_max_m)
    for uav in (problem.first[bad], problem.second[bad], problem.row_uav[bad_row]):
        refused[uav] = True
    return refused


def limited_waypoints(position_m: Floats, wish_m: Floats, u_max_m: float) -> Floats:
    """The wishes themselves where they are within one step, else one full step towards them."""
    none = np.empty(0, np.int64)
    problem = Problem(
        position_m, wish_m, u_max_m, none, none, np.empty((0, 2)), np.empty(0),
        none, np.empty((0, 2)), np.empty(0), np.zeros(len(position_m), dtype=bool),
    )  # fmt: skip
    return certify(problem, problem.wish_step_m).waypoint_m


def _too_long(step_m: Floats, u_max_m: float) -> NDArray[np.bool_]:
    """Whether a UAV would refuse the step: the very test that it makes, where it is a close call."""
    too_long: NDArray[np.bool_] = ~(length_m(step_m) <= u_max_m * (1 - 1e-12))
    for uav in np.flatnonzero(too_long):
        too_long[uav] = not math.hypot(step_m[uav, 0], step_m[uav, 1]) <= u_max_m
    return too_long


__all__ = ["MARGIN_M", "Certified", "certify", "least_gap_m", "limited_waypoints"]
