"""Replanning a recording gives its commands, and finds a changed one."""

from __future__ import annotations

import msgspec
import pytest

from edc_swarm.analysis.replanning import Replanned, replan
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.validation import mission_from_dict
from edc_swarm.planner.registry import make_planner
from edc_swarm.protocol.messages import Command, Message, mission_message
from edc_swarm.recording.model import Recording
from edc_swarm.simulation.simulator import Simulation


@pytest.fixture(scope="module")
def said() -> list[Message]:
    """Return a mission of five UAVs, one of which is cut off, so that its hull matters."""
    fields = {"name": "again", "uavs": 5, "area_m2": 2500.0, "max_slots": 30, "lag_slots": 1}
    mission = complete_mission(mission_from_dict({**fields, "fault": ["partition u003|rest @6 for 8"]}))
    message, messages = mission_message(mission), list[Message]()
    Simulation(message, lambda: make_planner("edc", message), lambda _key, now, _ns: messages.append(now)).run()
    return messages


def planned_again(messages: list[Message]) -> Replanned:
    """Return the result of replanning a record."""
    recording = Recording.from_messages(messages)
    return replan(recording, lambda: make_planner("edc", recording.mission))


def test_planning_again_gives_the_same_bits(said: list[Message]) -> None:
    """Fixes and reports contain the whole input of a planner, including hulls and previous waypoints."""
    result = planned_again(said)
    assert result.commands == sum(isinstance(message, Command) for message in said)
    assert (result.identical, result.skipped, result.differences) == (result.commands, 0, [])


def test_a_changed_command_is_found(said: list[Message]) -> None:
    """A change of one target by one centimetre is found."""
    at = next(i for i, m in enumerate(said) if isinstance(m, Command) and m.slot == 9)
    changed = said[at]
    assert isinstance(changed, Command)
    messages = [*said[:at], msgspec.structs.replace(changed, target_x_m=changed.target_x_m + 0.01), *said[at + 1 :]]
    (difference,) = planned_again(messages).differences
    assert (difference.slot, difference.uav) == (9, changed.uav)
    assert difference.off_m == pytest.approx(0.01)


def test_a_plan_without_its_report_is_no_plan(said: list[Message]) -> None:
    """An incomplete plan is counted as skipped."""
    gone = [m for m in said if not (isinstance(m, Command) and m.slot == 9 and m.uav == "u001")]
    result = planned_again(gone)
    assert result.skipped == 1
