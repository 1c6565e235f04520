"""Energy of a mission as its recording shows it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from edc_swarm.analysis.columns import Columns
from edc_swarm.emulation.energy import compute_energy_j, full_speed_energy_j
from edc_swarm.mission.configuration import Mission
from edc_swarm.recording.model import Recording
from edc_swarm.recording.repeats import plans_of


def propulsion_j(columns: Columns, arrival: NDArray[np.int64], first: int) -> float:
    """Return the propulsion energy of all UAVs, each from the first commanded slot until it arrives or dies."""
    slot = np.arange(len(columns.step_m))[:, None]
    return float(np.sum(columns.slot_j[(slot >= first) & (slot <= arrival) & columns.alive]))


def compute_j(recording: Recording, columns: Columns) -> float | None:
    """Return the energy of all plans; None if there is no plan, or one without a measured time."""
    plans = len(plans_of(recording))
    if not plans or len(columns.plan_ms) < plans:
        return None
    return compute_energy_j(float(columns.plan_ms.sum()) / 1e3, recording.mission.head)


def straight_energy_j(mission: Mission) -> float:
    """Return the energy of all UAVs, each flying straight at full speed."""
    return sum(full_speed_energy_j(mission, entry) for entry in mission.roster)
