"""Plane geometry against brute force."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edc_swarm.geometry import (
    closest_approach_m,
    closest_points_of_segments,
    length_m,
    near_pairs,
    nearest_on_segment,
    rotated,
    segment_distance_m,
)

coordinates = st.integers(-8, 8).map(float)
points = st.tuples(coordinates, coordinates)
SHARES = np.linspace(0, 1, 801)[:, None]


@given(a=points, b=points, c=points, d=points)
def test_closest_approach_is_the_least_of_dense_samples(
    a: tuple[float, float], b: tuple[float, float], c: tuple[float, float], d: tuple[float, float]
) -> None:
    """Two linear motions, degenerate ones included, are never nearer than the exact answer."""
    first, second = a + SHARES * np.subtract(b, a), c + SHARES * np.subtract(d, c)
    sampled = length_m(first - second).min()
    exact = float(closest_approach_m(a, b, c, d))
    assert exact <= sampled + 1e-9
    assert sampled <= exact + 0.06


@given(a=points, b=points, c=points, d=points)
def test_segment_distance_is_the_least_over_both_segments(
    a: tuple[float, float], b: tuple[float, float], c: tuple[float, float], d: tuple[float, float]
) -> None:
    """The closest points lie on their segments, and no other pair of points is nearer."""
    on_first, on_second = closest_points_of_segments(a, b, c, d)
    assert length_m(on_first - nearest_on_segment(on_first, a, b)) == pytest.approx(0, abs=1e-9)
    assert length_m(on_second - nearest_on_segment(on_second, c, d)) == pytest.approx(0, abs=1e-9)
    exact = float(segment_distance_m(a, b, c, d))
    assert float(length_m(on_first - on_second)) == pytest.approx(exact)
    some = a + SHARES[::40] * np.subtract(b, a)
    sampled = length_m(some - nearest_on_segment(some, c, d)).min()
    assert exact <= sampled + 1e-9
    assert sampled <= exact + 0.6


@pytest.mark.parametrize("count", [0, 1, 2, 50, 121, 400])
@pytest.mark.parametrize("reach_m", [0.0, 3.0, 500.0])
def test_near_pairs_are_those_of_brute_force(count: int, reach_m: float) -> None:
    """Cells find every pair within reach, in lexicographic order, coincident points included."""
    points_m = np.random.default_rng(count).uniform(-40, 70, (count, 2))
    points_m[count // 2 :: 7] = points_m[: len(points_m[count // 2 :: 7])]
    i, j = near_pairs(points_m, reach_m)
    k, l_ = np.triu_indices(count, 1)
    near = length_m(points_m[k] - points_m[l_]) <= reach_m
    assert i.tolist() == k[near].tolist()
    assert j.tolist() == l_[near].tolist()


def test_rotation_is_counter_clockwise() -> None:
    """A quarter turn takes x to y."""
    assert rotated(np.array([1.0, 0.0]), np.array(0.0), np.array(1.0)) == pytest.approx([0.0, 1.0])
