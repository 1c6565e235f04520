"""The slot QP: its rows, its normals, its optimum against other solvers."""

from __future__ import annotations

import numpy as np
import pytest
import qpsolvers
import scipy.sparse

from edc_swarm.geometry import length_m
from edc_swarm.solver.hull_rows import Obstacles
from edc_swarm.solver.normals import DELTA_M
from edc_swarm.solver.slot_qp import Problem, slot_problem
from edc_swarm.solver.solution import Memory, active_program, keeps_every_row, solve

U_MAX_M = 2.5
R_M = 5.0


def scattered(seed: int, count: int, side_m: float) -> np.ndarray:
    """Points at least R apart."""
    rng = np.random.default_rng(seed)
    points = np.empty((0, 2))
    while len(points) < count:
        point = rng.uniform(0, side_m, 2)
        if not len(points) or length_m(points - point).min() >= 2 * R_M:
            points = np.vstack([points, point])
    return points


def crowded(seed: int, count: int = 25, side_m: float = 75.0) -> Problem:
    """A slot in which everybody wants to move at full speed in some direction."""
    position_m = scattered(seed, count, side_m)
    angle = np.random.default_rng([seed, 1]).uniform(0, 2 * np.pi, count)
    wish_m = position_m + U_MAX_M * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return slot_problem(position_m, wish_m, np.full(count, R_M), U_MAX_M)


def every_row(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """All three rows of all pairs, dense, straight from the formulas."""
    rows, bounds = [], []
    for k, l_, n, room in zip(problem.first, problem.second, problem.normal, problem.room_m, strict=True):
        for move_k, move_l in ((1, 0), (0, 1), (1, 1)):
            row = np.zeros((len(problem.position_m), 2))
            row[k] = -n * move_k
            row[l_] = n * move_l
            rows.append(row.ravel())
            bounds.append(max(room - DELTA_M, 0.0))
    return np.array(rows), np.array(bounds)


@pytest.mark.parametrize("solver", ["clarabel", "piqp", "daqp"])
@pytest.mark.parametrize("seed", range(3))
def test_optimum_is_that_of_other_solvers_on_all_rows(solver: str, seed: int) -> None:
    """OSQP on the rows that can be active finds the optimum that another solver finds on all rows."""
    problem = crowded(seed)
    rows, bounds = every_row(problem)
    size = rows.shape[1]
    dense = solver == "daqp"
    theirs = qpsolvers.solve_qp(
        2 * np.eye(size) if dense else scipy.sparse.csc_matrix(2 * np.eye(size)),
        -2 * problem.wish_step_m.ravel(),
        rows if dense else scipy.sparse.csc_matrix(rows),
        bounds,
        solver=solver,
    )
    ours = solve(problem, active_program(problem, np.arange(len(problem.position_m))), Memory())
    assert theirs is not None
    assert ours.status == "planned"
    assert not keeps_every_row(problem)
    assert ours.step_m.ravel() == pytest.approx(theirs, abs=2e-3)


def test_residuals_are_handed_out_and_small() -> None:
    """The reported primal residual is the true violation of the program's rows, to the tolerance."""
    problem = crowded(4)
    program = active_program(problem, np.arange(25))
    solution = solve(problem, program, Memory())
    violation = (program.matrix @ solution.step_m[program.uav].ravel() - program.bound_m).max()
    assert violation <= 1e-4 + 1e-9
    assert 0 <= solution.primal_residual_m <= 1e-4
    assert 0 <= solution.dual_residual_m <= 1e-4
    assert solution.iterations > 0


def test_warm_start_keeps_duals_by_pair() -> None:
    """Solving the same slot again from the remembered duals takes fewer iterations."""
    problem = crowded(5)
    memory = Memory()
    program = active_program(problem, np.arange(25) + 7)
    cold = solve(problem, program, memory)
    assert (np.diff(memory.key) > 0).all()
    assert memory.dual.max() > 0
    warm = solve(problem, program, memory)
    assert warm.iterations < cold.iterations
    assert memory.recall(np.array([-1, 10**12])) == pytest.approx([0, 0])


def test_optimal_steps_are_no_longer_than_wished() -> None:
    """|u_k| <= |v_k| at the optimum, which is why the QP needs no speed constraint."""
    problem = crowded(6)
    solution = solve(problem, active_program(problem, np.arange(25)), Memory())
    assert (length_m(solution.step_m) <= length_m(problem.wish_step_m) + 1e-3).all()


def test_normals_are_valid_and_symmetric_pairs_use_the_line_of_centres() -> None:
    """Every normal is a unit vector with room; a head-on pair gets the line of centres."""
    problem = crowded(7)
    assert length_m(problem.normal) == pytest.approx(np.ones(len(problem.normal)))
    apart = problem.position_m[problem.first] - problem.position_m[problem.second]
    free = length_m(apart) >= 2 * R_M + DELTA_M
    assert (problem.room_m[free] >= DELTA_M - 1e-9).all()
    head_on = slot_problem(
        np.array([[0.0, 0.0], [12.0, 0.0]]), np.array([[2.0, 0.0], [10.0, 0.0]]), np.full(2, R_M), U_MAX_M
    )
    assert head_on.normal[0] == pytest.approx([-1.0, 0.0])
    assert head_on.room_m[0] == pytest.approx(2.0)


def test_the_best_normal_lets_two_pass_that_the_line_of_centres_would_stop() -> None:
    """Passing side by side needs a normal off the line of centres, and gets it."""
    position_m = np.array([[0.0, 0.0], [3.0, 11.0]])
    wish_m = position_m + np.array([[2.4, 0.3], [-2.4, -0.3]])
    problem = slot_problem(position_m, wish_m, np.full(2, R_M), U_MAX_M)
    assert keeps_every_row(problem)
    centre = (position_m[0] - position_m[1]) / length_m(position_m[0] - position_m[1])
    assert abs(problem.normal[0] @ centre) < 1 - 1e-6
    closing = -centre @ (wish_m - position_m)[0] + centre @ (wish_m - position_m)[1]
    assert closing > length_m(position_m[0] - position_m[1]) - 2 * R_M - DELTA_M


@pytest.mark.parametrize("distance_m", [10.0, 10.0 - 1e-12, 9.0, 0.0])
def test_touching_or_overlapping_pairs_may_not_close_in(distance_m: float) -> None:
    """At R or under it the normal is d/|d| and nobody closes in; nothing crashes."""
    position_m = np.array([[0.0, 0.0], [distance_m, 0.0]])
    problem = slot_problem(position_m, position_m + np.array([[1.0, 0.0], [-1.0, 0.0]]), np.full(2, R_M), U_MAX_M)
    solution = solve(problem, active_program(problem, np.arange(2)), Memory())
    first, second = problem.closing_m(solution.step_m)
    assert first[0] + second[0] < 1e-3


def test_far_pairs_are_left_out() -> None:
    """Pairs that cannot touch within the slot have no rows."""
    position_m = np.array([[0.0, 0.0], [2 * R_M + 2 * U_MAX_M + DELTA_M, 0.0]])
    problem = slot_problem(position_m, position_m, np.full(2, R_M), U_MAX_M)
    assert len(problem.first) == 0


def test_hull_rows_outside_near_and_inside() -> None:
    """Beyond R: one row along the nearest point's normal; nearer: two rows without room; inside: hold."""
    ball = Obstacles(np.array([[0.0, 0.0]]), np.array([[4.0, 0.0]]), np.array([3.0]), np.array([5.0]))
    position_m = np.array([[4.0, 14.0], [2.0, 9.0], [1.0, 2.0]])
    problem = slot_problem(position_m, position_m, np.full(3, R_M), U_MAX_M, ball)
    assert problem.row_uav.tolist() == [0, 1, 1]
    assert problem.row_normal[0] == pytest.approx([0, 1])
    assert problem.row_room_m == pytest.approx([1.0, 0.0, 0.0])
    assert problem.frozen.tolist() == [False, False, True]


def test_steps_allowed_near_a_hull_come_nearer_to_none_of_its_points() -> None:
    """The two rows of a UAV nearer than R are the polar cone of the hull, no more and no less."""
    hull = Obstacles(np.array([[0.0, 0.0]]), np.array([[4.0, 1.0]]), np.array([3.0]), np.array([5.0]))
    position_m = np.array([[2.0, 8.0]])
    problem = slot_problem(position_m, position_m, np.full(1, R_M), U_MAX_M, hull)
    share, turn = np.meshgrid(np.linspace(0, 1, 60), np.linspace(0, 2 * np.pi, 240))
    inside = np.stack([4.0 * share, share], axis=-1) + 3.0 * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    for angle in np.linspace(0, 2 * np.pi, 181):
        step = np.array([np.cos(angle), np.sin(angle)])
        allowed = (problem.row_normal @ step).min()
        nearer = ((position_m[0] - inside) @ step).min() / 8
        if abs(allowed) > 0.02:
            assert (allowed > 0) == (nearer > 0)


def test_late_vehicles_widen_the_pair_to_their_previous_steps() -> None:
    """With previous positions the room is that of the worst end points of both previous steps."""
    position_m = np.array([[0.0, 0.0], [14.0, 0.0]])
    previous_m = np.array([[1.0, 0.0], [13.0, 0.0]])
    problem = slot_problem(position_m, position_m, np.full(2, R_M), U_MAX_M, None, previous_m)
    assert problem.room_m[0] == pytest.approx(2.0)
    assert problem.normal[0] == pytest.approx([-1.0, 0.0])
