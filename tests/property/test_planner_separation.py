"""G3: however the certified steps are flown, nobody overlaps; whatever the solver returned."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from edc_swarm.geometry import length_m, segment_distance_m
from edc_swarm.solver.certificate import certify
from edc_swarm.solver.hull_rows import Obstacles
from edc_swarm.solver.slot_qp import slot_problem
from edc_swarm.solver.solution import Memory, active_program, solve

TOLERANCE_M = 1e-9
seeds = st.integers(0, 2**32 - 1)


def swarm(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions and radii; neighbours often exactly R apart, sometimes a rounding error less."""
    r_m = rng.uniform(0.5, 6.0, count)
    points: list[np.ndarray] = [rng.uniform(-5, 5, 2)]
    while len(points) < count:
        k = len(points)
        base = int(rng.integers(k))
        angle = rng.uniform(0, 2 * np.pi)
        reach = (r_m[k] + r_m[base]) * rng.choice([1.0, 1.0 + 1e-15, 1.002, 1.1, 1.5])
        point = points[base] + reach * np.array([np.cos(angle), np.sin(angle)])
        gaps = length_m(np.array(points) - point) - r_m[:k] - r_m[k]
        if gaps.min() >= -1e-12:
            points.append(point)
    return np.array(points), r_m


def garbage(rng: np.random.Generator, shape: tuple[int, ...], u_max_m: float) -> np.ndarray:
    """What a broken solver might return."""
    steps = rng.normal(0, u_max_m * rng.choice([0.1, 1.0, 100.0]), shape)
    spoiled = rng.random(shape) < 0.05
    return np.where(spoiled, rng.choice([math.nan, math.inf, -math.inf, 1e300]), steps)


def least_gap_m(rng: np.random.Generator, start_m: np.ndarray, end_m: np.ndarray, r_m: np.ndarray) -> float:
    """Least gap over all pairs when each is anywhere on its own segment: corners and beyond."""
    k, l_ = np.triu_indices(len(r_m), 1)
    # Any two points of the two segments may coincide in time, so the sets' distance is the answer.
    exact = segment_distance_m(start_m[k], end_m[k], start_m[l_], end_m[l_]) - r_m[k] - r_m[l_]
    share = rng.random((50, len(r_m), 1)) ** rng.choice([0.1, 1.0, 10.0])
    flown = start_m + share * (end_m - start_m)
    sampled = length_m(flown[:, k] - flown[:, l_]) - r_m[k] - r_m[l_]
    assert sampled.min() >= exact.min() - 1e-9
    return float(exact.min())


@settings(max_examples=150, deadline=None)
@given(seed=seeds, count=st.integers(2, 12), broken=st.booleans())
def test_any_partial_execution_keeps_every_pair_apart(seed: int, count: int, broken: bool) -> None:
    """Each UAV anywhere on its own segment at any time: all discs stay disjoint."""
    rng = np.random.default_rng(seed)
    position_m, r_m = swarm(rng, count)
    u_max_m = float(rng.choice([0.01, 1.0, 2.5, 8.0]))
    wish_m = position_m + rng.normal(0, u_max_m / 2, position_m.shape)
    problem = slot_problem(position_m, wish_m, r_m, u_max_m)
    if broken:
        steps = garbage(rng, position_m.shape, u_max_m)
    else:
        steps = solve(problem, active_program(problem, np.arange(count)), Memory()).step_m
    waypoint_m = certify(problem, steps).waypoint_m
    assert least_gap_m(rng, position_m, waypoint_m, r_m) >= -TOLERANCE_M
    for (x, y), (px, py) in zip(waypoint_m.tolist(), position_m.tolist(), strict=True):
        assert math.hypot(x - px, y - py) <= u_max_m


@settings(max_examples=100, deadline=None)
@given(seed=seeds, count=st.integers(1, 8), hulls=st.integers(1, 4))
def test_nobody_comes_nearer_to_a_hidden_uav(seed: int, count: int, hulls: int) -> None:
    """Wherever in its hull a UAV hides, at R or more at first, every partial step keeps clear of it."""
    rng = np.random.default_rng(seed)
    position_m, r_m = swarm(rng, count)
    a_m = rng.uniform(-25, 25, (hulls, 2))
    b_m = a_m + rng.normal(0, 2, (hulls, 2)) * (rng.random((hulls, 1)) < 0.5)
    radius_m = rng.choice([0.0, 2.5, 10.0], hulls)
    keep_m = rng.uniform(0.5, 5, hulls)
    wish_m = position_m + rng.normal(0, 2.0, position_m.shape)
    problem = slot_problem(position_m, wish_m, r_m, 2.5, Obstacles(a_m, b_m, radius_m, keep_m))
    steps = garbage(rng, position_m.shape, 2.5) if seed % 2 else problem.wish_step_m
    waypoint_m = certify(problem, steps).waypoint_m
    hidden = a_m[:, None] + rng.random((hulls, 300, 1)) * (b_m - a_m)[:, None]
    turn = rng.uniform(0, 2 * np.pi, (hulls, 300))
    out = radius_m[:, None] * rng.choice([1.0, 0.7], (hulls, 300))
    hidden = hidden + out[..., None] * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    for k in range(count):
        before = length_m(position_m[k] - hidden) - keep_m[:, None] - r_m[k]
        after = segment_distance_m(position_m[k], waypoint_m[k], hidden, hidden) - keep_m[:, None] - r_m[k]
        possible = before >= 0
        assert after[possible].min(initial=0.0) >= -TOLERANCE_M


@settings(max_examples=100, deadline=None)
@given(seed=seeds, count=st.integers(2, 8))
def test_vehicles_up_to_a_slot_late_stay_apart(seed: int, count: int) -> None:
    """With previous positions, anybody may still be anywhere on the previous step as well."""
    rng = np.random.default_rng(seed)
    previous_m, r_m = swarm(rng, count)
    first = slot_problem(previous_m, previous_m, r_m, 2.5)
    position_m = certify(first, rng.normal(0, 2.0, previous_m.shape)).waypoint_m
    wish_m = position_m + rng.normal(0, 2.0, previous_m.shape)
    problem = slot_problem(position_m, wish_m, r_m, 2.5, None, previous_m)
    waypoint_m = certify(problem, problem.wish_step_m).waypoint_m
    k, l_ = np.triu_indices(count, 1)
    for a, b in ((previous_m, position_m), (position_m, waypoint_m)):
        for c, d in ((previous_m, position_m), (position_m, waypoint_m)):
            gap = segment_distance_m(a[k], b[k], c[l_], d[l_]) - r_m[k] - r_m[l_]
            assert gap.min() >= -TOLERANCE_M


@settings(max_examples=8, deadline=None)
@given(seed=seeds)
def test_touching_pairs_do_not_creep_together(seed: int) -> None:
    """Over many slots of pushing, rounding never adds up to an overlap."""
    rng = np.random.default_rng(seed)
    position_m, r_m = swarm(rng, 6)
    k, l_ = np.triu_indices(6, 1)
    for _ in range(40):
        wish_m = position_m + 0.3 * (position_m.mean(axis=0) - position_m) + rng.normal(0, 0.05, (6, 2))
        problem = slot_problem(position_m, wish_m, r_m, 2.5)
        steps = solve(problem, active_program(problem, np.arange(6)), Memory()).step_m
        position_m = certify(problem, steps).waypoint_m
        assert (length_m(position_m[k] - position_m[l_]) - r_m[k] - r_m[l_]).min() >= -TOLERANCE_M
