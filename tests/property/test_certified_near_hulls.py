"""Near a hull the certificate lets through what is safe, to the last float, and hardly ever takes more away."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from edc_swarm.geometry import dot, length_m, point_segment_distance_m
from edc_swarm.solver.certificate import certify, nearest_step_m
from edc_swarm.solver.hull_rows import Obstacles
from edc_swarm.solver.normals import DELTA_M
from edc_swarm.solver.slot_qp import Problem, slot_problem
from edc_swarm.solver.solution import Memory, active_program, solve

R_M, U_MAX_M, CASES = 5.0, 2.5, 400


def case(rng: np.random.Generator, radius_m: float) -> tuple[Problem, Obstacles]:
    """One UAV at the edge of one to three hulls, or nearer than R to them, and where it would like to go."""
    count = int(rng.integers(1, 4))
    a_m = rng.uniform(-14, 14, (count, 2))
    b_m = a_m + rng.normal(0, 1.5, (count, 2)) * (rng.random((count, 1)) < 0.7)
    away_m = point_segment_distance_m(np.zeros(2), a_m, b_m)
    keep = away_m > radius_m + 0.5
    hulls = Obstacles(a_m[keep], b_m[keep], np.full(keep.sum(), radius_m), np.full(keep.sum(), R_M))
    angle = rng.uniform(0, 2 * np.pi)
    wish_m = rng.uniform(0.2, 1.0) * U_MAX_M * np.array([[np.cos(angle), np.sin(angle)]])
    return slot_problem(np.zeros((1, 2)), wish_m, np.array([R_M]), U_MAX_M, hulls), hulls


def best_step_m(problem: Problem) -> np.ndarray:
    """The optimum of the slot QP of one UAV, by geometry instead of by a solver."""
    room_m = np.maximum(problem.row_room_m - DELTA_M, 0.0)
    return nearest_step_m(problem.wish_step_m[0], problem.row_normal, -room_m)


def test_a_step_that_breaks_nothing_is_not_cancelled() -> None:
    """Of random UAVs near hulls fewer than one in a hundred lose over half of the step that is best for them."""
    rng, tried, lost = np.random.default_rng(0), 0, 0
    while tried < CASES:
        problem, _ = case(rng, float(rng.choice([0.0, 0.0, 2.5])))
        best_m = float(length_m(best_step_m(problem)))
        if not (problem.row_room_m == 0).any() or best_m < 1e-2:
            continue
        tried += 1
        solved = solve(problem, active_program(problem, np.arange(1)), Memory())
        flown_m = float(length_m(certify(problem, solved.step_m).waypoint_m - problem.position_m)[0])
        lost += flown_m < best_m / 2
    assert lost < CASES / 100


def inner(u: list[Fraction], p: list[Fraction], x: list[Fraction]) -> Fraction:
    """u.(p - x), exactly."""
    return sum((u[i] * (p[i] - x[i]) for i in range(2)), Fraction(0))


@pytest.mark.parametrize("spoil_m", [0.0, 1e-13, 1e-6, 1e-4, 0.3])
def test_no_published_step_comes_nearer_by_exact_arithmetic(spoil_m: float) -> None:
    """u.(p - x) >= 0 at both ends of every segment nearer than R, in fractions of the floats, without tolerance."""
    rng, moved = np.random.default_rng(1), 0
    for _ in range(CASES // 2):
        problem, hulls = case(rng, 0.0)
        shift_m = rng.uniform(-1000, 1000, 2)
        ends_m = hulls.a_m + shift_m, hulls.b_m + shift_m
        hulls = Obstacles(*ends_m, hulls.radius_m, hulls.keep_m)
        problem = slot_problem(shift_m[None], problem.wish_m + shift_m, np.array([R_M]), U_MAX_M, hulls)
        step_m = best_step_m(problem)[None] + rng.normal(0, 1, (1, 2)) * spoil_m
        waypoint_m = certify(problem, step_m).waypoint_m[0]
        p, w = ([Fraction(float(value)) for value in point] for point in (problem.position_m[0], waypoint_m))
        u = [w[0] - p[0], w[1] - p[1]]
        moved += any(u)
        near = point_segment_distance_m(problem.position_m[0], *ends_m) < 2 * R_M
        for a_m, b_m in zip(ends_m[0][near], ends_m[1][near], strict=True):
            assert inner(u, p, [Fraction(float(value)) for value in a_m]) >= 0
            assert inner(u, p, [Fraction(float(value)) for value in b_m]) >= 0
    assert moved > CASES / 8


def test_touching_discs_slide_along_each_other_and_never_overlap() -> None:
    """Two discs that touch, one of which wants past the other: it moves, and no residual brings them nearer."""
    rng = np.random.default_rng(2)
    for _ in range(300):
        angle = rng.uniform(0, 2 * np.pi)
        normal, along = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
        position_m = np.array([[0.0, 0.0], 2 * R_M * normal])
        wish_m = position_m + np.array([2.0 * along + normal, [0.0, 0.0]])
        problem = slot_problem(position_m, wish_m, np.full(2, R_M), U_MAX_M)
        # As a solver leaves it: along the row, but for its residual.
        flown_m = certify(problem, np.array([2.0 * along + 1e-5 * normal, [0.0, 0.0]])).waypoint_m - position_m
        assert length_m(flown_m[0]) > 1.9 or problem.room_m[0] > 1e-3
        assert (-dot(problem.normal, flown_m[problem.first]) <= np.maximum(problem.room_m, 0.0)).all()
