"""The broad phase misses no pair, compared with brute force over pairs, slots and instants."""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edc_swarm.analysis.separation import Encounters, closest_moment, encounters, least_gap_m, swept_encounters


@st.composite
def swarms(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Draw starts and ends (S, K, 2) and radii (K,), with some points at rest."""
    slots, count = draw(st.integers(1, 5)), draw(st.integers(2, 6))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    from_m = rng.uniform(0, 40, (slots, count, 2))
    to_m = from_m + rng.normal(0, draw(st.sampled_from([0.0, 1.0, 15.0])), (slots, count, 2))
    to_m[:, 0] = from_m[:, 0]
    return from_m, to_m, rng.uniform(0.1, 6, count)


def gap_m(from_m: np.ndarray, to_m: np.ndarray, radius_m: np.ndarray, slot: int, k: int, other: int) -> float:
    """Return the least gap of one pair in one slot, by the closed form for relative motion."""
    apart = from_m[slot, k] - from_m[slot, other]
    closing = to_m[slot, k] - to_m[slot, other] - apart
    squared = float(closing @ closing)
    share = min(1.0, max(0.0, -float(apart @ closing) / squared)) if squared else 0.0
    return math.hypot(*(apart + share * closing)) - float(radius_m[k] + radius_m[other])


@given(swarm=swarms(), below_m=st.floats(-3, 10))
def test_encounters_are_exactly_the_near_pairs(
    swarm: tuple[np.ndarray, np.ndarray, np.ndarray], below_m: float
) -> None:
    """Every pair below the limit is found with its exact gap, and no other."""
    from_m, to_m, radius_m = swarm
    met = encounters(from_m, to_m, radius_m, below_m)
    found = dict(
        zip(zip(met.slot.tolist(), met.first.tolist(), met.second.tolist(), strict=True), met.gap_m, strict=True)
    )
    for slot in range(len(from_m)):
        for k, other in combinations(range(len(radius_m)), 2):
            gap = gap_m(*swarm, slot, k, other)
            assert ((slot, k, other) in found) == (gap < below_m) or gap == pytest.approx(below_m, abs=1e-9)
            if (slot, k, other) in found:
                assert found[slot, k, other] == pytest.approx(gap, abs=1e-9)


@given(swarm=swarms())
def test_the_least_gap_is_the_least_of_all(swarm: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
    """The least gap of a mission is one number."""
    pairs = [
        gap_m(*swarm, slot, k, other)
        for slot in range(len(swarm[0]))
        for k, other in combinations(range(len(swarm[2])), 2)
    ]
    assert least_gap_m(*swarm) == pytest.approx(min(pairs), abs=1e-9)


@given(swarm=swarms())
def test_swept_ways_are_at_most_as_far_apart_as_joint_motions(
    swarm: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> None:
    """A pair that is safe for any uneven execution is safe for a simultaneous one."""
    met = set(_keys(encounters(*swarm, 0.0)))
    assert met <= set(_keys(swept_encounters(*swarm, 0.0)))


def test_unknown_positions_meet_nobody() -> None:
    """NaN is near nothing."""
    from_m = np.array([[[0.0, 0.0], [np.nan, np.nan], [9.0, 0.0]]])
    radius_m = np.ones(3)
    assert least_gap_m(from_m, from_m, radius_m) == pytest.approx(7.0)
    assert math.isnan(least_gap_m(from_m * np.nan, from_m, radius_m))
    assert math.isnan(least_gap_m(from_m[:, :1], from_m[:, :1], radius_m[:1]))
    assert len(encounters(from_m, from_m, radius_m, 99.0).slot) == 1


def test_the_closest_moment_is_where_the_motions_meet() -> None:
    """It is half-way through a head-on swap, and at the start for two points at rest."""
    from_m, to_m = np.array([[[0.0, 0.0], [4.0, 0.0]]]), np.array([[[4.0, 0.0], [0.0, 0.0]]])
    assert closest_moment(from_m, to_m, 0, 0, 1) == 0.5
    assert closest_moment(from_m, from_m, 0, 0, 1) == 0.0


def _keys(met: Encounters) -> list[tuple[int, int, int]]:
    return list(zip(met.slot.tolist(), met.first.tolist(), met.second.tolist(), strict=True))
