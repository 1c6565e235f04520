"""The paper's optimisation problem, equation by equation (doi 10.1109/GLOCOM.2018.8647223)."""

from __future__ import annotations

import math

import numpy as np
import pytest

from edc_swarm.geometry import closest_approach_m, length_m
from edc_swarm.mission.configuration import Mission
from edc_swarm.planner.interface import PlanRequest
from edc_swarm.planner.paper import Paper, horizon_program, horizon_slots, solve_horizon
from edc_swarm.planner.registry import make_planner

U_MAX_M = 2.5


def circle(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """UAVs that swap places across a circle: all meet in the middle."""
    angle = np.arange(count) * 2 * np.pi / count
    start_m = 30 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return start_m, -start_m, np.full(count, 5.0)


def optimum(count: int, *, eliminate: bool) -> np.ndarray:
    """Positions (F + 1, count, 2) of the paper's optimum."""
    start_m, target_m, r_m = circle(count)
    program = horizon_program(start_m, target_m, r_m, U_MAX_M, eliminate=eliminate)
    path_m, _ = solve_horizon(program, start_m, target_m)
    assert path_m is not None
    return path_m


@pytest.mark.parametrize("count", [2, 3, 4, 5])
def test_convexification_is_vacuous(count: int) -> None:
    """Eq. 29-43 as printed: the optimum is the equally spaced straight line, and all pairs overlap."""
    start_m, target_m, r_m = circle(count)
    path_m = optimum(count, eliminate=False)
    share = np.linspace(0, 1, len(path_m))[:, None, None]
    assert path_m == pytest.approx(start_m + share * (target_m - start_m), abs=1e-5)
    k, l_ = np.triu_indices(count, 1)
    near_m = closest_approach_m(path_m[:-1, k], path_m[1:, k], path_m[:-1, l_], path_m[1:, l_])
    assert (near_m.min(axis=0) < r_m[k] + r_m[l_]).all()


@pytest.mark.parametrize("count", [2, 4])
def test_dotted_variables_change_nothing(count: int) -> None:
    """Leaving out the dotted variables with eq. 37-43 gives the same optimum."""
    assert optimum(count, eliminate=True) == pytest.approx(optimum(count, eliminate=False), abs=1e-5)


def test_dotted_variables_may_take_any_value_below() -> None:
    """Eq. 37-43 hold for whatever positions once the dotted variables are very negative."""
    start_m, target_m, r_m = circle(3)
    program = horizon_program(start_m, target_m, r_m, U_MAX_M, eliminate=False)
    size = 2 * 3 * program.horizon
    rng = np.random.default_rng(0)
    anywhere = np.concatenate([rng.normal(0, 30, 2 * size), np.full(program.blocks[-1].shape[1] - 2 * size, -1e3)])
    for block, upper in zip(program.blocks[3:], program.upper[3:], strict=True):
        assert (block @ anywhere[: block.shape[1]] <= upper).all()


def test_start_and_end_points() -> None:
    """Eq. 32-35: the plan begins at the start and ends at the target."""
    start_m, target_m, _ = circle(4)
    path_m = optimum(4, eliminate=True)
    assert path_m[0].tolist() == start_m.tolist()
    assert path_m[-1].tolist() == target_m.tolist()


def test_speed_limit() -> None:
    """Eq. 36 with the inner 16-gon: no planned step is longer than v_max dt."""
    path_m = optimum(5, eliminate=True)
    assert length_m(np.diff(path_m, axis=0)).max() <= U_MAX_M + 1e-6


def test_horizon() -> None:
    """F is 1.1 times the longest straight flight in slots, rounded up, and at least one slot."""
    assert horizon_slots(np.zeros((1, 2)), np.array([[60.0, 0.0]]), U_MAX_M) == 27
    assert horizon_slots(np.zeros((1, 2)), np.zeros((1, 2)), U_MAX_M) == 1


@pytest.mark.parametrize("count", [1, 3])
def test_planner_flies_the_plan_to_the_end(count: int) -> None:
    """One solution when taking office, then its waypoints, ending exactly at the targets."""
    start_m, target_m, r_m = circle(count)
    planner = make_planner("paper", Mission(uavs=count))
    position_m, states = start_m, []
    for slot in range(27):
        plan = planner.plan(PlanRequest(slot, range(count), position_m, target_m, r_m))
        position_m = np.array(plan.waypoint_m)
        states.append(plan.status)
    assert states == ["planned"] + ["no-qp-needed"] * 26
    assert position_m.tolist() == target_m.tolist()


def test_planner_solves_again_when_a_uav_is_off_its_plan() -> None:
    """A UAV that was held, or that vanished, makes the head solve anew."""
    start_m, target_m, r_m = circle(3)
    planner = make_planner("paper", Mission(uavs=3))
    planner.plan(PlanRequest(0, range(3), start_m, target_m, r_m))
    held = planner.plan(PlanRequest(1, range(3), start_m, target_m, r_m))
    assert held.status == "planned"
    assert held.iterations > 0
    fewer = planner.plan(PlanRequest(2, [0, 2], np.array(held.waypoint_m)[[0, 2]], target_m[[0, 2]], r_m[:2]))
    assert fewer.status == "planned"


def test_no_uavs() -> None:
    """Nobody to plan for: an empty plan."""
    assert Paper(Mission(), lambda: 0).plan(PlanRequest(0, [], [], [], [])).waypoint_m == []


def test_straight_is_the_paper_without_avoidance() -> None:
    """Planner "straight": everyone at full speed to the target, exactly there, discs overlapping."""
    start_m, target_m, r_m = circle(2)
    planner = make_planner("straight", Mission(uavs=2))
    position_m, gaps = start_m, []
    for slot in range(25):
        plan = planner.plan(PlanRequest(slot, range(2), position_m, target_m, r_m))
        step_m = length_m(np.array(plan.waypoint_m) - position_m)
        assert step_m == pytest.approx(np.full(2, min(U_MAX_M, 60.0 - slot * U_MAX_M)), abs=1e-9)
        position_m = np.array(plan.waypoint_m)
        gaps.append(plan.min_gap_m)
    assert position_m.tolist() == target_m.tolist()
    assert min(gaps) == pytest.approx(-10.0, abs=1e-6)
    assert math.isclose(gaps[-1], 50.0)
