"""The energy of propulsion of every UAV in every slot."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from edc_swarm.analysis.true_paths import TruePaths
from edc_swarm.emulation.energy import propulsion_power_w, propulsion_powers_w
from edc_swarm.mission.configuration import Mission

Floats = NDArray[np.float64]


def slot_energy_j(mission: Mission, step_m: Floats, paths: TruePaths | None) -> Floats:
    """Return the energy (S, K) of slots with steps of the lengths `step_m` (S, K).

    A UAV flies at constant speed between the slot's guards and hovers within them. A vehicle with inertia says itself
    what its true flight took, by air speed and acceleration; where no truth of it is, its step counts.
    """
    flown_s = mission.dt_s - 2 * mission.guard_s
    hovered_j = propulsion_power_w(0.0, mission.energy) * (mission.dt_s - flown_s)
    steady_j = propulsion_powers_w(step_m / flown_s, mission.energy) * flown_s + hovered_j
    return steady_j if paths is None else np.where(np.isnan(paths.propulsion_j), steady_j, paths.propulsion_j)
