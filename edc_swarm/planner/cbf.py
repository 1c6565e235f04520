"""Planner "cbf": safety barrier certificates, a quadratic program.

Source: L. Wang, A. D. Ames, M. Egerstedt, "Safety barrier certificates for collisions-free multirobot systems", IEEE
Transactions on Robotics 33(3), 2017; in discrete time as A. Agrawal, K. Sreenath, RSS 2017.

Of the pair k, l with the difference d of their positions the barrier function is h = |d|^2 - R^2. The steps u are those
nearest to the straight ones for which h falls by at most the share `BARRIER_GAIN` in a slot:

    2 d.(u_k - u_l) >= -BARRIER_GAIN h,

a row that is linear in u. What it leaves out, |u_k - u_l|^2, only adds to h, so h >= 0 stays true at every instant
if all fly their steps evenly. A head solves one program for all UAVs (the paper's centralised certificates). A UAV that
plans for itself takes half of the row of each neighbour (its decentralised certificates); neighbours without a fix go
on at constant velocity, whose part of the row it knows, for at most `HORIZON_S`. A hull takes the whole row.

*Deadlock*: a UAV that stands still away from its target turns its preferred step to the right for a while, as
the paper perturbs it consistently (`planner.detours`).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import osqp
import scipy.sparse

from edc_swarm.geometry import Floats, dot, length_m
from edc_swarm.mission.configuration import Mission
from edc_swarm.planner.detours import Detours
from edc_swarm.planner.discs import CLEARANCE_M, Discs, Sight, plan_of
from edc_swarm.planner.interface import Plan, PlanRequest, PlanStatus, Stopwatch

BARRIER_GAIN = 0.8
"""Greatest share by which h falls in a slot; at most 1."""
HORIZON_S = 5.0
"""Time for which a neighbour without a fix is taken to go on at constant velocity."""
SPEED_SIDES = 32
"""Sides of the polygon in the circle of the longest step."""
SETTINGS: dict[str, Any] = {
    "verbose": False,
    "eps_abs": 1e-6,
    "eps_rel": 0.0,
    "max_iter": 4000,
    "time_limit": 1e10,
    "adaptive_rho": 0,
    "check_dualgap": False,
    "polishing": False,
}
_SOLVED = {1, 2}

Row = tuple[list[tuple[int, float, float]], float]
"""Coefficients (UAV, x, y) of a row, and its upper bound in square metres."""


class Cbf:
    """Planner of barrier-certified steps, for all UAVs or for one among its neighbours."""

    def __init__(self, mission: Mission, stopwatch: Stopwatch) -> None:
        self._stopwatch = stopwatch
        self._sight = Sight(mission, HORIZON_S / mission.dt_s)
        self._detours = Detours()

    def plan(self, request: PlanRequest) -> Plan:
        """Return the next waypoints of the UAVs of `request`."""
        started_ns = self._stopwatch()
        discs = self._sight.discs(request)
        wish_m = self._detours.turned(discs, discs.wish_m)
        step_m, status, iterations = certified_steps(discs, wish_m)
        return plan_of(discs, step_m, status, (self._stopwatch() - started_ns) / 1e6, iterations)


def certified_steps(discs: Discs, wish_m: Floats) -> tuple[Floats, PlanStatus, int]:
    """Return the steps nearest to `wish_m` that keep every row, the status, and the solver's iterations.

    All UAVs hold if the program has no solution.
    """
    rows = [*_pair_rows(discs), *_neighbour_rows(discs), *_hull_rows(discs)]
    if all(sum(x * wish_m[k, 0] + y * wish_m[k, 1] for k, x, y in row) <= bound for row, bound in rows):
        return wish_m, "no-qp-needed", 0
    matrix, lower, upper = _program(rows, discs.u_max_m)
    size = wish_m.size
    cost = scipy.sparse.identity(size, format="csc")
    solver = osqp.OSQP(algebra="builtin")
    solver.setup(cost, -wish_m.ravel(), matrix, lower, upper, **SETTINGS)
    solver.warm_start(x=wish_m.ravel())
    result = solver.solve(raise_error=False)
    if result.info.status_val not in _SOLVED or not np.isfinite(result.x).all():
        return np.zeros_like(wish_m), "failed", int(result.info.iter)
    return np.asarray(result.x).reshape(-1, 2), "planned", int(result.info.iter)


def _pair_rows(discs: Discs) -> list[Row]:
    """Return the rows of the pairs that the plan moves, where full speed can break them."""
    first, second = np.triu_indices(len(discs.uav), 1)
    d_m = discs.position_m[first] - discs.position_m[second]
    h = _barrier(d_m, discs.r_m[first] + discs.r_m[second])
    near = np.flatnonzero(2 * length_m(d_m) * (discs.u_max_m[first] + discs.u_max_m[second]) > BARRIER_GAIN * h)
    return [
        ([(k, -2 * x_m, -2 * y_m), (other, 2 * x_m, 2 * y_m)], BARRIER_GAIN * bound)
        for k, other, (x_m, y_m), bound in zip(
            first[near].tolist(), second[near].tolist(), d_m[near].tolist(), h[near].tolist(), strict=True
        )
    ]


def _neighbour_rows(discs: Discs) -> list[Row]:
    """Return half of the row of each UAV with each neighbour."""
    return _single_rows(discs, discs.other_m, discs.other_r_m, 0.5)


def _hull_rows(discs: Discs) -> list[Row]:
    """Return the rows of the UAVs with the hulls."""
    return _single_rows(discs, discs.still_m, discs.still_r_m, 1.0)


def _single_rows(discs: Discs, place_m: Floats, radius_m: Floats, share: float) -> list[Row]:
    """Return the share of the rows that UAVs have with discs that the plan does not move."""
    rows: list[Row] = []
    for k, (here_m, r_m, u_max_m) in enumerate(zip(discs.position_m, discs.r_m, discs.u_max_m, strict=True)):
        d_m = here_m - place_m
        h = _barrier(d_m, r_m + radius_m)
        near = 2 * length_m(d_m) * u_max_m > share * BARRIER_GAIN * h
        rows += [
            ([(k, -2 * x_m, -2 * y_m)], share * BARRIER_GAIN * bound)
            for (x_m, y_m), bound in zip(d_m[near].tolist(), h[near].tolist(), strict=True)
        ]
    return rows


def _barrier(d_m: Floats, apart_m: Floats) -> Floats:
    """Return h in square metres."""
    return np.asarray(dot(d_m, d_m) - (apart_m + CLEARANCE_M) ** 2)


def _program(rows: list[Row], u_max_m: Floats) -> tuple[scipy.sparse.csc_matrix, Floats, Floats]:
    """Return matrix and bounds: the rows, scaled to metres, and those of the longest steps."""
    data, row_of, column, upper = list[float](), list[int](), list[int](), list[float]()
    for index, (coefficients, bound) in enumerate(rows):
        scale = 1 / max(math.hypot(*coefficients[0][1:]), CLEARANCE_M)
        for k, x, y in coefficients:
            data += [x * scale, y * scale]
            row_of += [index, index]
            column += [2 * k, 2 * k + 1]
        upper.append(bound * scale)
    count, sides = len(u_max_m), SPEED_SIDES // 2
    angles = [math.pi * side / sides for side in range(sides)]
    normals = scipy.sparse.kron(
        scipy.sparse.identity(count), np.array([(math.cos(angle), math.sin(angle)) for angle in angles])
    )
    longest_m = np.repeat(u_max_m * math.cos(math.pi / SPEED_SIDES), sides)
    pairs = scipy.sparse.csc_matrix((data, (row_of, column)), shape=(len(rows), 2 * count))
    matrix = scipy.sparse.vstack([pairs, normals], format="csc")
    return (
        matrix,
        np.concatenate([np.full(len(rows), -np.inf), -longest_m]),
        np.concatenate([upper, longest_m]),
    )
