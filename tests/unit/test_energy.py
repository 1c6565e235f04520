"""Energy of flight and computation, and what a small process must not import."""

import subprocess
import sys

import numpy as np
import pytest

from edc_swarm.emulation.energy import compute_energy_j, propulsion_power_w, propulsion_powers_w
from edc_swarm.mission.power_models import EnergyModel, HeadModel

MODEL = EnergyModel()


def test_a_fleet_of_speeds_is_the_same_curve() -> None:
    """The array form is the scalar form, element by element."""
    speeds_mps = np.array([[0.0, 2.5], [5.0, 30.0]])
    expected = [[propulsion_power_w(v, MODEL) for v in row] for row in speeds_mps.tolist()]
    assert propulsion_powers_w(speeds_mps, MODEL) == pytest.approx(np.array(expected))


def test_computation_is_paid_by_the_second() -> None:
    """Energy grows with the processor time of the head."""
    assert compute_energy_j(3.0, HeadModel(p_active_w=5.0)) == pytest.approx(15.0)


def test_what_every_uav_imports_stays_free_of_numpy() -> None:
    """A UAV process pays for numpy only when it may have to plan."""
    modules = "emulation.energy geodesy emulation.gps recording.reader recording.writer protocol.gap_repair"
    code = f'import sys; [__import__(f"edc_swarm.{{m}}") for m in {modules.split()}]; sys.exit("numpy" in sys.modules)'
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
