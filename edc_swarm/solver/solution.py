"""Solution of the slot QP with OSQP: rows that can be active, a warm start, residuals in the result."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import osqp
import scipy.sparse
from numpy.typing import NDArray

from edc_swarm.geometry import Floats, Indices, length_m
from edc_swarm.solver.normals import DELTA_M
from edc_swarm.solver.slot_qp import Problem

SETTINGS: dict[str, Any] = {
    "verbose": False,
    "eps_abs": 1e-4,
    "eps_rel": 0.0,
    "rho": 30.0,
    "alpha": 1.6,
    "scaling": 0,
    "check_termination": 10,
    "max_iter": 4000,
    "time_limit": 1e10,
    # OSQP adapts rho by iterations, never by the clock: the same problem must give the same bytes.
    "adaptive_rho": 1,
    "adaptive_rho_interval": 50,
    "check_dualgap": False,
    "polishing": False,
}
_SOLVED = {1, 2}
_OUT_OF_ITERATIONS = 7
_FIRST, _SECOND, _BOTH = 0, 1, 2
_SPAN = 1 << 20
"""Bound above every roster index, so that a pair of indices becomes one key."""


@dataclass(frozen=True, slots=True)
class Program:
    """Rows that can be active, in matrix form: min |u - v|^2 subject to A u <= b.

    `uav` (m,) has the UAVs of these rows, in the order of the variables (x0, y0, x1, y1, ...). `matrix`
    is (rows, 2 m), `key` (rows,) identifies each row from slot to slot (-1: no warm start).
    """

    uav: Indices
    wish_step_m: Floats
    matrix: scipy.sparse.csc_matrix
    bound_m: Floats
    key: Indices


@dataclass(frozen=True, slots=True)
class Solution:
    """Steps (n, 2) and their quality.

    `status` is "no-qp-needed" if the preferred steps keep every row, "failed" if the solver
    has no usable result (the steps are then zero). Residuals are those of the solver's rows, in metres.
    """

    step_m: Floats
    status: str
    iterations: int = 0
    primal_residual_m: float = 0.0
    dual_residual_m: float = 0.0


@dataclass
class Memory:
    """Duals of the last slot's rows for the warm start, by key in increasing order."""

    key: Indices = field(default_factory=lambda: np.empty(0, np.int64))
    dual: Floats = field(default_factory=lambda: np.empty(0))

    def recall(self, key: Indices) -> Floats:
        """Return the duals of the rows `key`, zero for rows that the last slot did not have."""
        if not len(self.key):
            return np.zeros(len(key))
        place = np.minimum(np.searchsorted(self.key, key), len(self.key) - 1)
        return np.where((self.key[place] == key) & (key >= 0), self.dual[place], 0.0)

    def keep(self, key: Indices, dual: Floats) -> None:
        """Keep the duals of the rows that have a key."""
        order = np.argsort(key, kind="stable")
        order = order[key[order] >= 0]
        self.key, self.dual = key[order], dual[order]


def keeps_every_row(problem: Problem) -> bool:
    """Return True if the preferred steps are the optimum."""
    closing_first_m, closing_second_m = problem.closing_m(problem.wish_step_m)
    pairs = closing_first_m + closing_second_m <= np.maximum(problem.room_m - DELTA_M, 0.0)
    rows = problem.row_closing_m(problem.wish_step_m) <= np.maximum(problem.row_room_m - DELTA_M, 0.0)
    return bool(pairs.all() and rows.all())


def active_program(problem: Problem, uav_id: Indices) -> Program:
    """Return all rows that can be active at the optimum, where |u_k| <= |v_k|."""
    step_m = np.where(problem.frozen[:, None], 0.0, problem.wish_step_m)
    length = length_m(step_m)
    gap_m = np.maximum(problem.room_m - DELTA_M, 0.0)
    first_m, second_m = gap_m + problem.first_spare_m, gap_m + problem.second_spare_m
    bounds_m = np.stack([first_m, second_m, first_m + problem.second_spare_m])
    pair, kind = _corners(length[problem.first], length[problem.second], bounds_m)
    row_gap_m = np.maximum(problem.row_room_m - DELTA_M, 0.0) + problem.row_spare_m
    hull = np.flatnonzero(length[problem.row_uav] > row_gap_m)
    # A row of one UAV has no coefficient of the other, which holds.
    uav, matrix = _matrix(problem, pair, kind, hull)
    pair_key = (uav_id[problem.first[pair]] * _SPAN + uav_id[problem.second[pair]]) * 3 + kind
    return Program(
        uav,
        step_m[uav],
        matrix,
        np.concatenate([bounds_m[kind, pair], row_gap_m[hull]]),
        np.concatenate([pair_key, np.full(len(hull), -1)]),
    )


def _corners(first_m: Floats, second_m: Floats, bounds_m: Floats) -> tuple[Indices, Indices]:
    """Return the pairs' rows that steps of these lengths (p,) can break: the pair of each, and which UAVs move.

    `bounds_m` (3, p) are the bounds of the rows "the first moves", "the second moves" and "both move".
    """
    single = [np.flatnonzero(first_m > bounds_m[_FIRST]), np.flatnonzero(second_m > bounds_m[_SECOND])]
    both = np.flatnonzero((first_m + second_m > bounds_m[_BOTH]) & (first_m > 0) & (second_m > 0))
    kinds = np.repeat([_FIRST, _SECOND, _BOTH], [len(single[0]), len(single[1]), len(both)])
    return np.concatenate([*single, both]), kinds


def _matrix(problem: Problem, pair: Indices, kind: Indices, hull: Indices) -> tuple[Indices, scipy.sparse.csc_matrix]:
    """Return the UAVs of the rows, and the rows as a sparse matrix (rows, 2 m)."""
    with_first, with_second = np.flatnonzero(kind != _SECOND), np.flatnonzero(kind != _FIRST)
    row = np.concatenate([with_first, with_second, np.arange(len(hull)) + len(pair)])
    column = np.concatenate([problem.first[pair[with_first]], problem.second[pair[with_second]], problem.row_uav[hull]])
    value = np.concatenate(
        [-problem.normal[pair[with_first]], problem.normal[pair[with_second]], -problem.row_normal[hull]]
    )
    uav, place = np.unique(column, return_inverse=True)
    order = np.lexsort((row, place))
    row, place, value = row[order], place[order], value[order]
    count = np.bincount(place, minlength=len(uav))
    # Each UAV has the same rows in its x and its y column.
    start = np.repeat(np.cumsum(count) - count, count)
    slot = np.arange(len(row)) + start
    data, index = np.empty(2 * len(row)), np.empty(2 * len(row), np.int32)
    data[slot], data[slot + np.repeat(count, count)] = value[:, 0], value[:, 1]
    index[slot], index[slot + np.repeat(count, count)] = row, row
    pointer = np.concatenate([[0], np.cumsum(np.repeat(count, 2))]).astype(np.int32)
    shape = (len(pair) + len(hull), 2 * len(uav))
    return uav, scipy.sparse.csc_matrix((data, index, pointer), shape=shape)


def solve(problem: Problem, program: Program, memory: Memory) -> Solution:
    """Solve with OSQP from a warm start: the preferred steps and the last slot's duals."""
    if not len(program.bound_m):
        return Solution(np.where(problem.frozen[:, None], 0.0, problem.wish_step_m), "planned")
    result = _run_osqp(program, memory.recall(program.key))
    usable = result.info.status_val in _SOLVED or result.info.status_val == _OUT_OF_ITERATIONS
    usable = usable and bool(np.isfinite(result.x).all())
    memory.keep(program.key, _finite(np.asarray(result.y)))
    step_m = np.where(problem.frozen[:, None], 0.0, problem.wish_step_m)
    step_m[program.uav] = result.x.reshape(-1, 2)
    return Solution(
        step_m if usable else np.zeros_like(step_m),
        "planned" if usable else "failed",
        int(result.info.iter),
        float(result.info.prim_res),
        float(result.info.dual_res),
    )


def _run_osqp(program: Program, dual: Floats) -> Any:
    size = 2 * len(program.uav)
    wish = program.wish_step_m.ravel()
    cost = scipy.sparse.csc_matrix(
        (np.full(size, 2.0), np.arange(size, dtype=np.int32), np.arange(size + 1, dtype=np.int32)),
        shape=(size, size),
    )
    solver = osqp.OSQP(algebra="builtin")  # A search for other algebras reads the disk each time.
    lower = np.full(len(program.bound_m), -np.inf)
    solver.setup(cost, -2 * wish, program.matrix, lower, program.bound_m, **SETTINGS)
    # The primal point of these duals: 2 (u - v) + A'y = 0. Without duals it is the preferred steps.
    solver.warm_start(x=wish - program.matrix.T @ dual / 2, y=dual)
    return solver.solve(raise_error=False)


def _finite(values: Floats) -> NDArray[np.float64]:
    return np.where(np.isfinite(values), values, 0.0)
