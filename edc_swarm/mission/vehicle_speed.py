"""The greatest speed that a vehicle allows."""

from __future__ import annotations

import msgspec

from edc_swarm.errors import MissionError
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.mission.vehicle_budget import budget_of, check_vehicles, vehicle_of

MOST_MPS = 200.0
SPEED_HALVINGS = 30


def greatest_speed_mps(mission: Mission, entry: RosterEntry) -> float | None:
    """Return the largest `v_max_mps` at which a UAV of this mission keeps its a_max, None if its disc is too small.

    The disc bounds no speed, as its budget depends on accelerations: it holds the tracking bound at any speed or at
    none. The speed is bounded by drag, which takes from the tilt that turns and gusts need; above it the plan's a_max
    falls (`budget_of`). Braking bounds no speed either: its path, v^2 / (2 a_max) - v dt / 2 long, is part of the space
    that a plan keeps free, not of the disc.
    """

    def fits(speed_mps: float) -> bool:
        alone = msgspec.structs.replace(entry, v_max_mps=speed_mps)
        fast = msgspec.structs.replace(mission, v_max_mps=speed_mps, roster=[alone])
        try:
            check_vehicles(fast)
        except MissionError:
            return False
        return budget_of(fast, alone).a_max_mps2 >= vehicle_of(fast, alone).a_max_mps2

    low_mps, high_mps = 0.01, MOST_MPS
    if not fits(low_mps):
        return None
    for _ in range(SPEED_HALVINGS):
        middle_mps = 0.5 * (low_mps + high_mps)
        low_mps, high_mps = (middle_mps, high_mps) if fits(middle_mps) else (low_mps, middle_mps)
    return low_mps
