"""The certificate on single cases; `tests/property` has the general promise."""

from __future__ import annotations

import math

import numpy as np
import pytest

from edc_swarm.solver.certificate import certify, least_gap_m, limited_waypoints
from edc_swarm.solver.slot_qp import Problem, slot_problem

U_MAX_M = 2.5


def pair(distance_m: float, wish_m: float) -> Problem:
    """Two UAVs on the x axis that want to approach by `wish_m` each."""
    position_m = np.array([[0.0, 0.0], [distance_m, 0.0]])
    return slot_problem(position_m, position_m + np.array([[wish_m, 0.0], [-wish_m, 0.0]]), np.full(2, 5.0), U_MAX_M)


def test_unsafe_steps_are_scaled_to_the_room() -> None:
    """Two that would meet are both scaled by the same share and end R apart, less a margin."""
    certified = certify(pair(12.0, 2.0), np.array([[2.0, 0.0], [-2.0, 0.0]]))
    assert certified.scaled.tolist() == [True, True]
    assert certified.waypoint_m[:, 0] == pytest.approx([1.0, 11.0], abs=1e-8)
    assert certified.waypoint_m[1, 0] - certified.waypoint_m[0, 0] >= 10.0


def test_safe_wishes_are_published_to_the_bit() -> None:
    """A step that is the preferred one ends exactly on the preferred floats."""
    position_m = np.array([[0.1, 0.2], [50.3, 0.7]])
    wish_m = np.array([[1.3, 0.7], [49.9, 0.1]])
    problem = slot_problem(position_m, wish_m, np.full(2, 5.0), U_MAX_M)
    certified = certify(problem, problem.wish_step_m)
    assert certified.waypoint_m.tolist() == wish_m.tolist()
    assert not certified.scaled.any()


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e300])
def test_garbage_holds(bad: float) -> None:
    """A UAV whose step is not a usable number holds; the other one flies."""
    certified = certify(pair(30.0, 2.0), np.array([[bad, 0.0], [-2.0, 0.0]]))
    assert certified.waypoint_m.tolist() == [[0.0, 0.0], [28.0, 0.0]]


def test_speed_limit_holds_in_floats() -> None:
    """No published step is longer than u_max by the very test that the UAV makes."""
    rng = np.random.default_rng(0)
    position_m = rng.uniform(-1e5, 1e5, (2000, 2))
    angle = rng.uniform(0, 2 * np.pi, 2000)
    wish_m = position_m + 100 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    waypoint_m = limited_waypoints(position_m, wish_m, U_MAX_M)
    lengths = [
        math.hypot(x - px, y - py) for (x, y), (px, py) in zip(waypoint_m.tolist(), position_m.tolist(), strict=True)
    ]
    assert max(lengths) <= U_MAX_M
    assert min(lengths) > U_MAX_M - 1e-8


def test_least_gap_is_that_of_the_worst_execution() -> None:
    """The reported gap counts only what is closed in, since either UAV may hold."""
    problem = pair(15.0, 1.0)
    assert least_gap_m(problem, problem.position_m + np.array([[1.0, 0.0], [1.0, 0.0]])) == pytest.approx(4.0)
