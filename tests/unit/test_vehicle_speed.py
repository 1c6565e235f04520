"""The greatest speed that a vehicle allows."""

from __future__ import annotations

import pytest

from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.mission.validation import mission_from_dict
from edc_swarm.mission.vehicle_budget import budget_of
from edc_swarm.mission.vehicle_speed import greatest_speed_mps


def _greatest(r_m: float, mean_mps: float = 0.0) -> float | None:
    entry = RosterEntry(
        uav="u001", start_x_m=0, start_y_m=0, target_x_m=9, target_y_m=0, r_m=r_m, body_m=0.25, energy_j=1e5
    )
    fields = {"uavs": 1, "r_m": r_m, "gps_m": 1.0, "vehicle": {"model": "arducopter"}, "wind": {"mean_mps": mean_mps}}
    mission = mission_from_dict(fields)
    assert budget_of(mission, entry).gps_m == 1.0
    return greatest_speed_mps(mission, entry)


def test_wind_and_drag_bound_the_speed() -> None:
    """Each m/s of wind takes an m/s of speed; the disc bounds the tracking error, and thus allows any speed or none."""
    calm_mps = _greatest(3.0)
    assert calm_mps is not None
    assert calm_mps == pytest.approx(12.8, abs=0.1)
    assert _greatest(3.0, 4.0) == pytest.approx(calm_mps - 4.0, abs=0.01)
    assert _greatest(5.0) == pytest.approx(calm_mps)
    assert _greatest(1.5) is None
