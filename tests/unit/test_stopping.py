"""Braking lengths, and slots planned for UAVs that cannot stop at once: safe whoever hears which command."""

from __future__ import annotations

import math

import numpy as np
import pytest

from edc_swarm.geometry import Barriers, Floats, length_m, segment_distance_m
from edc_swarm.mission import braking
from edc_swarm.solver import certificate, slot_qp, solution, stopping
from edc_swarm.solver.barrier_rows import Airspace
from edc_swarm.solver.hull_rows import Obstacles
from edc_swarm.solver.stopping import Momentum

CHANGE_M, U_MAX_M, R_M = 0.5, 2.0, 1.0


def flown_m(step_m: float, change_m: float) -> float:
    """Return the length of the braking path, slot by slot."""
    total_m = 0.0
    while (step_m := step_m - change_m) > 0:
        total_m += step_m
    return total_m


@pytest.mark.parametrize("step_m", [0.0, 0.2, 0.5, 0.75, 1.0, 1.99, 2.0, 7.3])
def test_braking_length_is_the_sum_of_the_braking_steps(step_m: float) -> None:
    """The formulas, for one UAV and for arrays, agree with the slots that they stand for, and D has an inverse."""
    expected_m = flown_m(step_m, CHANGE_M)
    assert braking.braking_m(step_m, CHANGE_M) == pytest.approx(expected_m)
    length, change_m = np.array([step_m]), np.array([CHANGE_M])
    assert stopping.braking_m(length, change_m) == pytest.approx(expected_m)
    assert stopping.step_of(length + stopping.braking_m(length, change_m), change_m) == pytest.approx(step_m)
    assert expected_m <= step_m**2 / (2 * CHANGE_M) - step_m / 2 + CHANGE_M / 8 + 1e-12


def test_a_vehicle_without_inertia_stops_at_once() -> None:
    """An infinite step change leaves everything as it was, to the last bit."""
    assert braking.braked((1.0, 2.0), (3.0, 5.0), math.inf) == ((3.0, 5.0), (3.0, 5.0))
    assert braking.rest_point((1.0, 2.0), (3.1, 5.7), math.inf) == (3.1, 5.7)
    assert braking.reach_m(0.3, 7, 2.5, math.inf) == 7 * 2.5
    motion = _motion(np.array([[0.1, 0.7]]), np.array([[1.3, 0.2]]), math.inf)
    to_m = np.array([[0.3, 0.9]])
    assert (motion.rest_m == motion.position_m).all()
    assert (motion.braked_m == motion.position_m).all()
    assert (motion.stops_m(to_m) == motion.position_m + (to_m - motion.position_m)).all()


def test_braking_ends_at_the_rest_point() -> None:
    """Step by step the UAV comes to rest where the declared path ends."""
    state = (0.0, 0.0), (1.2, 0.9)
    rest_m = braking.rest_point(*state, 0.4)
    after = braking.braked(*state, 0.4, slots=10)
    assert after[0] == after[1]
    assert after[1] == pytest.approx(rest_m)
    assert braking.allows(*state, braking.braked(*state, 0.4)[1], 0.4)


@pytest.mark.parametrize("slots", [0, 1, 2, 3, 8])
def test_reach_bounds_what_a_uav_can_fly(slots: int) -> None:
    """No sequence of steps and braking leads farther; full acceleration leads just as far."""
    step_m, total_m = 0.7, 0.0
    for _ in range(slots):
        step_m = min(U_MAX_M, step_m + CHANGE_M)
        total_m += step_m
    total_m += flown_m(step_m, CHANGE_M) if slots else 0.0
    assert braking.reach_m(0.7, slots, U_MAX_M, CHANGE_M) == pytest.approx(total_m)


def _motion(position_m: Floats, last_m: Floats, change_m: float = CHANGE_M) -> Momentum:
    count = len(position_m)
    return Momentum(position_m, last_m, np.full(count, change_m), np.full(count, U_MAX_M))


def _least_gap_m(places_m: Floats) -> float:
    """Return the least distance of two UAVs' convex sets, given by their corners (c, n, 2): that of any two sides."""
    one, other = np.triu_indices(places_m.shape[1], 1)
    a, b = np.triu_indices(len(places_m), 1)
    ends_m = (
        places_m[a][:, None, one],
        places_m[b][:, None, one],
        places_m[a][None, :, other],
        places_m[b][None, :, other],
    )
    return float(segment_distance_m(*ends_m).min())


@pytest.mark.parametrize("lags", [False, True])
@pytest.mark.parametrize("seed", range(2))
def test_any_mixture_of_heard_and_unheard_commands_is_safe(seed: int, lags: bool) -> None:
    """A crowd with random wishes, in which each UAV misses commands at random, keeps all declared paths apart.

    Also apart are the triangles that a curve between two steps stays in. Every step is one that the vehicle can fly,
    the barrier is never crossed, and garbage from a solver is braking.
    """
    rng = np.random.default_rng(seed)
    side = np.arange(4) * 2.6
    position_m = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2)
    previous_m, r_m, duals = position_m.copy(), np.full(len(position_m), R_M), solution.Memory()
    wall = Barriers(
        np.array([[-3.0, -30.0]]), np.array([[-3.0, 30.0]]), np.zeros(1), np.ones(1, dtype=bool), np.array([[1.0, 0]]),
        np.zeros(1, np.int64), np.ones(1, dtype=bool),
    )  # fmt: skip
    airspace, moved_m = Airspace.of(wall, R_M, 4 * U_MAX_M * 3), 0.0
    for slot in range(30):
        motion = _motion(position_m, position_m - previous_m)
        drift_m = 6 * np.array([math.cos(slot / 5), math.sin(slot / 5)]) * rng.choice([-1, 1], (len(r_m), 1))
        wish_m = motion.towards_m(position_m + drift_m + rng.normal(0, 2, position_m.shape))
        problem = slot_qp.moving_problem(motion, wish_m, r_m, None, previous_m if lags else None, airspace)
        solved = solution.solve(problem, solution.active_program(problem, np.arange(len(r_m))), duals)
        waypoint_m = certificate.certify(problem, solved.step_m).waypoint_m
        assert certificate.least_gap_m(problem, waypoint_m) >= -1e-9
        garbage_m = certificate.certify(problem, np.full_like(position_m, np.nan)).waypoint_m
        assert garbage_m == pytest.approx(motion.braked_m)
        places = [position_m, motion.rest_m, motion.stops_m(waypoint_m), *([previous_m] if lags else [])]
        corners_m = np.stack(places)
        assert corners_m[..., 0].min() >= -3.0 + R_M - 1e-9
        assert _least_gap_m(corners_m) >= 2 * R_M - 1e-9
        change_m = length_m(waypoint_m - position_m - (position_m - previous_m))
        assert change_m.max() <= CHANGE_M * (1 + 1e-9) + 1e-9
        heard = rng.random(len(r_m)) < 0.8
        moved_m += float(length_m(waypoint_m - position_m).sum())
        previous_m, position_m = position_m, np.where(heard[:, None], waypoint_m, motion.braked_m)
    assert moved_m > 30 * len(r_m) * 0.05, "the crowd hardly moved, so the test proves little"


@pytest.mark.parametrize("lags", [False, True])
def test_near_a_hull_a_uav_brakes_or_leaves(lags: bool) -> None:
    """Nearer than R to a hull, no part of a declared path is nearer to any of its points than the position was."""
    rng = np.random.default_rng(7)
    checked = 0
    for _ in range(150):
        position_m, last_m = rng.uniform(-4, 4, (1, 2)), rng.uniform(-1.2, 1.2, (1, 2))
        previous_m = position_m - last_m
        hull = Obstacles(np.zeros((1, 2)), np.array([[1.5, 0.0]]), np.array([0.5]), np.array([R_M]))
        motion = _motion(position_m, last_m)
        wish_m = motion.towards_m(position_m + rng.normal(0, 2, (1, 2)))
        problem = slot_qp.moving_problem(motion, wish_m, np.array([R_M]), hull, previous_m if lags else None)
        waypoint_m = certificate.certify(problem, problem.wish_step_m).waypoint_m
        if np.allclose(waypoint_m, motion.braked_m, atol=1e-9):
            continue
        checked += 1
        stop_m = motion.stops_m(waypoint_m)
        turn = rng.uniform(0, math.tau, 400)
        inside_m = rng.uniform(0, 1, (400, 1)) * [[1.5, 0]] + 0.5 * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        starts_m = [position_m[0], *([previous_m[0]] if lags else [])]
        safe = np.min([length_m(inside_m - start_m) for start_m in starts_m], axis=0) >= 2 * R_M
        path_m = position_m + np.linspace(0, 1, 50)[:, None] * (stop_m - position_m)
        away_m = length_m(path_m[:, None] - inside_m[safe][None])
        assert away_m.min(initial=np.inf) >= 2 * R_M - 1e-9
    assert checked > 25
