"""Reference slot QP: its solution time measures the speed of a machine (the paper's response time)."""

from __future__ import annotations

import numpy as np

from edc_swarm.solver.certificate import certify
from edc_swarm.solver.slot_qp import slot_problem
from edc_swarm.solver.solution import Memory, Solution, active_program, solve

COLUMNS = 7
SPACING_M = 10.5
R_M = 5.0
U_MAX_M = 2.5


def solve_reference_qp() -> Solution:
    """Assemble, solve and certify the slot QP of 49 UAVs in a square that all fly towards the middle.

    The problem and its cold start are always the same: only the time differs between machines.
    """
    grid = np.arange(COLUMNS) * SPACING_M
    position_m = np.stack(np.meshgrid(grid, grid, indexing="ij"), axis=-1).reshape(-1, 2)
    inward_m = position_m.mean(axis=0) - position_m
    length = np.maximum(np.hypot(inward_m[:, 0], inward_m[:, 1]), 1e-9)
    wish_m = position_m + inward_m * (np.minimum(length, U_MAX_M) / length)[:, None]
    problem = slot_problem(position_m, wish_m, np.full(len(position_m), R_M), U_MAX_M)
    solution = solve(problem, active_program(problem, np.arange(len(position_m))), Memory())
    certify(problem, solution.step_m)
    return solution
