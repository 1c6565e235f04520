"""Propulsion power against the figures published with the model (Zeng, Xu, Zhang 2019)."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edc_swarm.emulation.energy import propulsion_power_w, propulsion_powers_w
from edc_swarm.mission.power_models import EnergyModel

MODEL = EnergyModel()
SPEEDS_MPS = np.linspace(0.05, 40, 8000)


def test_hovering_costs_the_sum_of_blade_and_induced_power() -> None:
    """At rest only the two hover terms remain."""
    assert propulsion_power_w(0.0, MODEL) == pytest.approx(79.86 + 88.63, abs=1e-12)


def test_cruising_at_the_default_speed_is_cheaper_than_hovering() -> None:
    """At 5 m/s the model gives 143.6 W."""
    assert propulsion_power_w(5.0, MODEL) == pytest.approx(143.6, abs=0.05)


def test_least_power_lies_at_ten_metres_per_second() -> None:
    """The bottom of the curve is 126 W at 10.2 m/s."""
    power_w = propulsion_powers_w(SPEEDS_MPS, MODEL)
    assert power_w.min() == pytest.approx(126.0, abs=0.1)
    assert SPEEDS_MPS[power_w.argmin()] == pytest.approx(10.2, abs=0.05)


def test_least_energy_per_metre_lies_at_eighteen_metres_per_second() -> None:
    """Range is longest at 18.3 m/s."""
    per_metre = propulsion_powers_w(SPEEDS_MPS, MODEL) / SPEEDS_MPS
    assert SPEEDS_MPS[per_metre.argmin()] == pytest.approx(18.3, abs=0.05)


@given(speed_mps=st.floats(0, 60))
def test_power_equals_the_printed_formula(speed_mps: float) -> None:
    """The rearranged induced term is the published one."""
    v, v0 = speed_mps, 4.03
    induced = 88.63 * math.sqrt(math.sqrt(1 + v**4 / (4 * v0**4)) - v**2 / (2 * v0**2))
    printed = 79.86 * (1 + 3 * v**2 / 120**2) + induced + 0.5 * 0.6 * 1.225 * 0.05 * 0.503 * v**3
    assert propulsion_power_w(speed_mps, MODEL) == pytest.approx(printed, rel=1e-9)
