"""GPS error models: bounds, determinism, and what each model means."""

import math
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from edc_swarm.emulation.gps import CORRELATION_S, GpsReceiver
from edc_swarm.mission.field_types import GpsModel

MODELS = get_args(GpsModel)


def errors(receiver: GpsReceiver, count: int) -> list[tuple[float, float]]:
    """The first `count` errors of a receiver."""
    return [receiver.next_error_m() for _ in range(count)]


@given(model=st.sampled_from(MODELS), reach_m=st.floats(0, 20, allow_subnormal=False), seed=st.text(max_size=20))
def test_every_error_stays_in_reach(model: GpsModel, reach_m: float, seed: str) -> None:
    """The disc always holds the whole vehicle."""
    for error_m in errors(GpsReceiver(model, reach_m, 0.5, seed), 50):
        assert math.hypot(*error_m) <= reach_m * (1 + 1e-12)


@pytest.mark.parametrize("model", MODELS)
def test_the_first_fix_reports_the_roster_start(model: GpsModel) -> None:
    """The first error takes the true offset back exactly."""
    receiver = GpsReceiver(model, 4.75, 0.5, "3/u001/gps")
    offset_x_m, offset_y_m = receiver.true_offset_m
    assert receiver.next_error_m() == (-offset_x_m, -offset_y_m)


@pytest.mark.parametrize("model", MODELS)
def test_same_seed_same_errors(model: GpsModel) -> None:
    """A receiver depends on its arguments alone, also after a restart."""
    first, second = (errors(GpsReceiver(model, 4.75, 0.5, "0/u001/gps"), 20) for _ in range(2))
    assert first == second


def test_bias_never_changes_and_none_is_exact() -> None:
    """One error for ever, or none at all."""
    assert len(set(errors(GpsReceiver("bias", 4.75, 0.5, "s"), 10))) == 1
    assert set(errors(GpsReceiver("none", 4.75, 0.5, "s"), 10)) == {(0.0, 0.0)}


def test_white_errors_are_uniform_in_the_disc() -> None:
    """A quarter of the fixes lies in the inner half radius, and half on either side."""
    drawn = errors(GpsReceiver("white", 2.0, 0.5, "uniform"), 4000)
    inner = sum(math.hypot(*e) < 1.0 for e in drawn) / len(drawn)
    assert inner == pytest.approx(0.25, abs=0.03)
    assert sum(x > 0 for x, _ in drawn) / len(drawn) == pytest.approx(0.5, abs=0.03)


def test_gauss_markov_errors_are_correlated_over_their_time_constant() -> None:
    """Successive fixes are alike, and forgotten after several time constants."""
    drawn = [x for x, _ in errors(GpsReceiver("gauss-markov", 4.75, 0.5, "walk"), 40_000)]
    variance = sum(x * x for x in drawn) / len(drawn)

    def correlation(lag: int) -> float:
        return sum(a * b for a, b in zip(drawn, drawn[lag:], strict=False)) / len(drawn) / variance

    assert correlation(1) > 0.95
    assert abs(correlation(int(10 * CORRELATION_S))) < 0.2


def test_true_offset_belongs_to_the_start() -> None:
    """After the first fix the offset can no longer be asked for."""
    receiver = GpsReceiver("bias", 1.0, 0.5, "s")
    receiver.next_error_m()
    with pytest.raises(AssertionError):
        _ = receiver.true_offset_m
