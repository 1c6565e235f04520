"""Means, confidence intervals and power laws equal those of scipy."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy.stats

from edc_swarm.experiments.statistics import estimate, power_law


@pytest.mark.parametrize("count", [2, 5, 30])
def test_interval_is_student_t(count: int) -> None:
    """The interval equals scipy's for the same sample."""
    sample = np.random.default_rng(count).normal(3.0, 2.0, count)
    found = estimate(list(sample))
    low, high = scipy.stats.t.interval(0.95, count - 1, loc=sample.mean(), scale=scipy.stats.sem(sample))
    assert (found.runs, found.mean) == (count, pytest.approx(sample.mean()))
    assert (found.low, found.high) == (pytest.approx(low), pytest.approx(high))


def test_interval_covers_as_often_as_it_says() -> None:
    """Of 4000 intervals from samples of 6, 95 % contain the true mean, within three standard errors."""
    rng = np.random.default_rng(0)
    intervals = [estimate(list(rng.normal(1.0, 1.0, 6))) for _ in range(4000)]
    share = np.mean([found.low < 1.0 < found.high for found in intervals if found.low is not None and found.high])
    assert share == pytest.approx(0.95, abs=3 * math.sqrt(0.95 * 0.05 / 4000))


def test_one_run_has_no_interval() -> None:
    """A single run has no estimate of its spread."""
    assert (estimate([4.0]).low, estimate([4.0]).high) == (None, None)


def test_power_law_is_linear_regression_of_logarithms() -> None:
    """Exponent and its interval equal scipy's regression."""
    x = [10.0, 20.0, 30.0, 40.0, 50.0]
    y = [7.9, 31.0, 70.0, 130.0, 203.0]
    found = power_law(x, y)
    expected = scipy.stats.linregress(np.log(x), np.log(y))
    half = scipy.stats.t.ppf(0.975, 3) * expected.stderr
    assert found is not None
    assert found.exponent == pytest.approx(expected.slope)
    assert found.factor == pytest.approx(math.exp(expected.intercept))
    assert (found.low, found.high) == (pytest.approx(found.exponent - half), pytest.approx(found.exponent + half))


def test_power_law_needs_two_positive_points() -> None:
    """Zeroes have no logarithm, and one point has no slope."""
    assert power_law([10.0, 20.0], [0.0, 3.0]) is None
    assert power_law([0.0, 20.0], [1.0, 3.0]) is None
    assert power_law([10.0, 10.0], [1.0, 3.0]) is None
    exact = power_law([0.25, 0.5], [0.5, 1.0])
    assert exact is not None
    assert (exact.exponent, exact.factor, exact.low, exact.high) == (pytest.approx(1.0), pytest.approx(2.0), None, None)


@pytest.mark.parametrize(("successes", "runs"), [(0, 10), (3, 10), (10, 10), (1, 1), (29, 30)])
def test_a_share_of_runs_has_wilsons_interval(successes: int, runs: int) -> None:
    """It equals scipy's, and stays between 0 and 100 %."""
    found = estimate([100.0] * successes + [0.0] * (runs - successes), "share of runs")
    expected = scipy.stats.binomtest(successes, runs).proportion_ci(method="wilson")
    assert (found.low, found.high) == (pytest.approx(100 * expected.low), pytest.approx(100 * expected.high))
    assert found.mean == pytest.approx(100 * successes / runs)


def test_a_count_has_the_exact_interval_of_poisson() -> None:
    """Its ends are the means of which what was counted is in the tails; it never goes below 0."""
    found = estimate([0.0, 1.0, 0.0, 2.0], "count")
    assert found.low is not None
    assert found.high is not None
    assert scipy.stats.poisson.sf(2, 4 * found.low) == pytest.approx(0.025) or found.low == 0.0
    assert scipy.stats.poisson.cdf(3, 4 * found.high) <= 0.025 + 1e-9
    none = estimate([0.0] * 10, "count")
    assert (none.low, none.high) == (0.0, pytest.approx(0.3688879))
    wide = estimate([0.0, 100.0, 0.0, 100.0], "count")
    assert wide.high == pytest.approx(estimate([0.0, 100.0, 0.0, 100.0]).high)


def test_no_band_is_below_what_can_be() -> None:
    """The band of an amount ends at 0, that of per cent at 0 and 100, and that of a signed quantity nowhere."""
    spread = [0.0, 0.0, 0.0, 90.0]
    assert (estimate(spread).low or 0.0) < 0.0
    assert estimate(spread, "amount").low == 0.0
    high = estimate([100.0, 100.0, 100.0, 10.0], "per cent")
    assert (high.low or 0.0) > 0.0
    assert high.high == 100.0


def test_poisson_intervals_cover_as_often_as_they_say() -> None:
    """Of 2000 intervals of rare counts, at least 95 % contain the true mean, within three standard errors."""
    rng = np.random.default_rng(0)
    intervals = [estimate([float(n) for n in rng.poisson(0.3, 8)], "count") for _ in range(2000)]
    share = np.mean([(found.low or 0.0) <= 0.3 <= (found.high or 0.0) for found in intervals])
    assert share >= 0.95 - 3 * math.sqrt(0.95 * 0.05 / 2000)
