"""Two heads that know each other's UAVs in part keep them apart, whatever each of them plans and whoever brakes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from edc_swarm.geometry import Floats, segment_distance_m
from edc_swarm.planner.interface import ForeignUav, Hull, PlanRequest
from edc_swarm.planner.request import checked_arrays
from edc_swarm.planner.safe import SafeSteps
from edc_swarm.solver import foreign_rows
from edc_swarm.solver.stopping import Momentum

U_MAX_M = 2.5
SCENES = 100

State = tuple[tuple[float, float], tuple[float, float]]
"""Position, and the position one slot earlier."""


def _ends_m(state: State, change_m: float) -> tuple[Floats, Floats]:
    """Return the ends of F: where the UAV was a slot ago, and where it rests if it brakes."""
    here_m, before_m = np.array(state[0]), np.array(state[1])
    momentum = Momentum(here_m[None], (here_m - before_m)[None], np.array([change_m]), np.array([U_MAX_M]))
    return before_m, momentum.rest_m[0]


def _place(rng: np.random.Generator, lags: bool) -> State:
    here_m = rng.uniform(0, 9, 2)
    angle, length_m = rng.uniform(0, math.tau), rng.uniform(0, U_MAX_M) if lags else 0.0
    step_m = length_m * np.array([math.cos(angle), math.sin(angle)])
    return (float(here_m[0]), float(here_m[1])), tuple((here_m - step_m).tolist())


def _hull(rng: np.random.Generator, index: int, state: State, change_m: float) -> Hull:
    """Return a hull that contains F, anywhere on its rim or inside."""
    from_m, rest_m = _ends_m(state, change_m)
    far_m = rng.uniform(0, 4)
    angle = rng.uniform(0, math.tau)
    shift_m = far_m * rng.choice([1.0, rng.uniform(0, 1)]) * np.array([math.cos(angle), math.sin(angle)])
    a, b = from_m + shift_m, rest_m + shift_m
    corners_m = float(a[0]), float(a[1]), float(b[0]), float(b[1])
    return Hull(index, *corners_m, float(np.hypot(*shift_m)) + 1e-12, 1.0)


def _planned(safe: SafeSteps, own: int, states: list[State], wish_m: Floats, heard: bool, hull: Hull) -> Floats:
    """Return the waypoint that the head of UAV `own` publishes."""
    other = 1 - own
    here_m, before_m = states[other]
    request = PlanRequest(
        slot=1,
        uav=[own],
        position_m=[states[own][0]],
        target_m=[states[own][0]],
        r_m=[1.0],
        previous_m=[states[own][1]],
        foreign=[ForeignUav(other, here_m, before_m, here_m, 0.0, 1.0)] if heard else [],
        foreign_hulls=[] if heard else [hull],
    )
    return np.array(safe.plan(checked_arrays(request), wish_m[None]).waypoint_m[0])


def _least_gap_m(rng: np.random.Generator, change_m: float, lags: bool) -> float | None:
    """Return the least distance of two UAVs beyond touching in a slot of a random scene; None if they touch before."""
    states = [_place(rng, lags) for _ in range(2)]
    ends_m = [_ends_m(state, change_m) for state in states]
    if float(segment_distance_m(*ends_m[0], *ends_m[1])) < 2.0:
        return None
    changes = [change_m] * 2 if math.isfinite(change_m) else None
    safe = SafeSteps([U_MAX_M] * 2, change_m=changes, lags=lags)
    ways = []
    for own in range(2):
        aim_m = np.array(states[1 - own][0]) if rng.random() < 0.7 else rng.uniform(0, 9, 2)
        way_m = aim_m - states[own][0]
        wish_m = states[own][0] + way_m * min(1.0, U_MAX_M / max(float(np.hypot(*way_m)), 1e-9))
        hull = _hull(rng, 1 - own, states[1 - own], change_m)
        waypoint_m = _planned(safe, own, states, wish_m, bool(rng.random() < 0.5), hull)
        stop_m = _ends_m(((float(waypoint_m[0]), float(waypoint_m[1])), states[own][0]), change_m)[1]
        # All that the UAV may fly: its last step and braking path, and the new step and the braking path after it.
        ways.append([ends_m[own], (np.array(states[own][0]), stop_m)])
    return min(float(segment_distance_m(*one, *two)) for one in ways[0] for two in ways[1]) - 2.0


@pytest.mark.parametrize(("change_m", "lags"), [(math.inf, False), (math.inf, True), (0.6, True)])
def test_every_mixture_of_heard_and_unheard_keeps_the_discs_apart(change_m: float, lags: bool) -> None:
    """Neither head knows the plan of the other, and each may know a fix or a hull."""
    rng = np.random.default_rng(7)
    gaps_m = [gap_m for _ in range(SCENES) if (gap_m := _least_gap_m(rng, change_m, lags)) is not None]
    assert len(gaps_m) > SCENES / 4
    assert min(gaps_m) >= -1e-9
    assert sum(gap_m < 0.5 for gap_m in gaps_m) > 5


def test_a_head_that_takes_the_whole_gap_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both heads take the whole gap."""
    rows = foreign_rows._heard_rows

    def whole(*args: Any) -> tuple[Any, ...]:
        which, normal, room_m, spare_m = rows(*args)
        return which, normal, 2 * room_m, spare_m

    monkeypatch.setattr(foreign_rows, "_heard_rows", whole)
    rng = np.random.default_rng(7)
    gaps_m = [gap_m for _ in range(SCENES) if (gap_m := _least_gap_m(rng, math.inf, False)) is not None]
    assert min(gaps_m) < -0.1


def test_a_hull_without_its_outermost_rays_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """The rows cover only the middle of the directions in which the hull is seen."""
    seen = foreign_rows._seen

    def narrow(*args: Any) -> tuple[Any, Any]:
        low, high = seen(*args)
        return (low + high) / 2, (low + high) / 2

    monkeypatch.setattr(foreign_rows, "_seen", narrow)
    rng = np.random.default_rng(7)
    gaps_m = [gap_m for _ in range(SCENES) if (gap_m := _least_gap_m(rng, math.inf, False)) is not None]
    assert min(gaps_m) < -1e-3


def test_both_heads_find_the_same_normal_to_the_last_bit() -> None:
    """The normals of the two heads are opposite, without any rounding."""
    rng = np.random.default_rng(3)
    for _ in range(200):
        states = [_place(rng, lags=True) for _ in range(2)]
        ends_m = [_ends_m(state, 0.6) for state in states]
        if float(segment_distance_m(*ends_m[0], *ends_m[1])) == 0:
            continue
        normals = []
        for own in range(2):
            places_m = np.array([ends_m[own][1], states[own][0], ends_m[own][0]])[:, None]
            from_m, rest_m = ends_m[1 - own]
            other = foreign_rows.Foreign(np.array([1 - own]), from_m[None], rest_m[None], np.ones(1))
            reach_m = np.array([50.0])
            normals.append(foreign_rows.foreign_rows(np.array([own]), places_m, np.ones(1), reach_m, other).normal)
        assert (normals[0] == -normals[1]).all()
