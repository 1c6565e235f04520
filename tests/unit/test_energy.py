"""Energy of a slot, of messages and of computation, and the battery."""

import subprocess
import sys

import pytest

from edc_swarm.config import EnergyModel, HeadModel
from edc_swarm.energy import Battery, compute_energy_j, flight_energy_j, propulsion_power_w, radio_energy_j

MODEL = EnergyModel()


def test_a_slot_is_flown_at_constant_speed() -> None:
    """2.5 m in half a second is half a second of power at 5 m/s."""
    assert flight_energy_j(2.5, 0.5, MODEL) == pytest.approx(0.5 * propulsion_power_w(5.0, MODEL))


def test_standing_still_is_hovering() -> None:
    """A slot without motion costs hover power."""
    assert flight_energy_j(0.0, 2.0, MODEL) == pytest.approx(2 * propulsion_power_w(0.0, MODEL))


def test_radio_and_computation_are_proportional() -> None:
    """Energy grows with messages and with processor seconds."""
    assert radio_energy_j(200, MODEL) == pytest.approx(1.0)
    assert compute_energy_j(3.0, HeadModel(p_active_w=5.0)) == pytest.approx(15.0)


def test_battery_covers_what_it_holds_and_never_goes_negative() -> None:
    """A battery refuses a step it cannot complete and ends empty."""
    battery = Battery(10.0)
    assert battery.covers(10.0)
    assert not battery.covers(10.1)
    battery.drain(4.0)
    assert battery.energy_j == 6.0
    battery.drain(7.0)
    assert battery.energy_j == 0.0
    assert battery.empty


def test_what_every_uav_imports_stays_free_of_numpy() -> None:
    """A UAV process pays for numpy only when it may have to plan."""
    code = "import sys, edc_swarm.energy, edc_swarm.geodesy, edc_swarm.gps; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
