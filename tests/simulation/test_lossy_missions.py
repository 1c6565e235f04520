"""Missions on networks that lose most messages: with repetition a head is elected and all guarantees hold."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from edc_swarm.analysis.guarantees.check import check
from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.validation import mission_from_dict
from edc_swarm.planner.registry import make_planner
from edc_swarm.protocol.messages import Message, MissionMessage, mission_message
from edc_swarm.recording.model import Recording
from edc_swarm.recording.repeats import plans_of, said_once
from edc_swarm.simulation.simulator import Simulation

FIELDS = {"uavs": 6, "area_m2": 3600.0, "seed": 4}


def flown(**fields: Any) -> list[Message]:
    """All messages of a simulated mission."""
    mission = mission_message(complete_mission(mission_from_dict({**FIELDS, **fields})))
    said: list[Message] = []
    planner = make_planner("edc", mission)
    Simulation(mission, lambda: planner, lambda _key, message, _ns: said.append(message)).run()
    return said


@pytest.mark.parametrize(
    "link",
    [{"loss": 0.7}, {"loss": 0.9}, {"burst_enter": 0.233, "burst_leave": 0.1, "burst_loss": 1.0}],
)
def test_a_swarm_flies_although_most_messages_are_lost(link: dict[str, float]) -> None:
    """A head is elected, everyone gets home, and a repeat is no gap, no second plan and no second measurement."""
    recording = Recording.from_messages(flown(link=[link], resends=40))
    metrics = compute_metrics(recording)
    assert metrics.completed
    assert metrics.potential_collisions == 0
    assert [result for result in check(recording) if result.broken] == []
    once = list(said_once(recording.commands))
    assert len(recording.commands) > 2 * len(once)
    assert len({(c.uav, c.slot, c.term) for c in once}) == len(once)
    assert len(plans_of(recording)) == len({(r.term, r.slot) for r in plans_of(recording)})


def test_without_repetition_it_does_not() -> None:
    """The mission above needs repetition: with each message said once nobody commands anybody at 90 %."""
    recording = Recording.from_messages(flown(link=[{"loss": 0.9}], resends=0, max_slots=60))
    assert not compute_metrics(recording).completed


def test_without_loss_repetition_changes_nothing() -> None:
    """Every message is the same but for the mission, which states the budget."""
    said, without = (
        [msgspec.json.encode(message) for message in flown(resends=resends) if not isinstance(message, MissionMessage)]
        for resends in (40, 0)
    )
    assert said == without
