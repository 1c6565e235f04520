"""Every living UAV whose target is free gets home while heads are killed."""

from __future__ import annotations

from typing import Any

import pytest

from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.validation import mission_from_dict
from edc_swarm.planner.registry import make_planner
from edc_swarm.protocol.messages import mission_message
from edc_swarm.simulation.simulator import Simulation


@pytest.mark.parametrize(
    "fields",
    [
        # A target beside the hull of a dead head, but within a disc about the hull's middle.
        {"seed": 7006, "fault": ["kill head @7.049s"], "max_slots": 120},
        # One nearer than R to the hull of a dead head, with another one in its way out.
        {
            "uavs": 20,
            "area_m2": 20_000.0,
            "fault": ["kill head @10", "freeze head @25 for 5s"],
            "link": [{"loss": 0.05, "jitter_ms": 40.0}],
            "max_slots": 200,
        },
    ],
)
def test_living_uavs_with_free_targets_get_home(fields: dict[str, Any]) -> None:
    """Both waited until their batteries were empty, when guidance saw discs instead of hulls."""
    mission = mission_message(complete_mission(mission_from_dict(fields)))
    end = Simulation(mission, lambda: make_planner("edc", mission), lambda *_: None).run()
    assert end.completed
    assert end.slots < mission.max_slots / 2
