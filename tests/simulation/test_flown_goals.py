"""New goals in simulated missions: fail-over, restart and death between goal and arrival, and goals without end."""

from __future__ import annotations

from typing import Any

import pytest

from edc_swarm.analysis.guarantees.check import check
from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.validation import mission_from_dict
from edc_swarm.planner.registry import make_planner
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.messages import Message, mission_message
from edc_swarm.recording.model import Recording
from edc_swarm.simulation.simulator import Simulation


def flown(*faults: str, **fields: Any) -> Recording:
    """The recording of a simulated mission of four UAVs."""
    raw = {"uavs": 4, "seed": 2, "area_m2": 10_000.0, "r_m": 3.0, **fields, "fault": list(faults)}
    message, said = mission_message(complete_mission(mission_from_dict(raw))), list[Message]()
    Simulation(message, lambda: make_planner("edc", message), lambda _key, now, _ns: said.append(now)).run()
    return Recording.from_messages(said)


def statuses(recording: Recording) -> dict[str, str]:
    """The status of every guarantee."""
    return {result.guarantee: result.status for result in check(recording)}


@pytest.mark.parametrize("faults", [(), ("kill head @22",), ("restart u002 @20.1s", "restart head @12s")])
def test_a_uav_flies_where_it_is_sent(faults: tuple[str, ...]) -> None:
    """Point after point, over a fail-over or a restart; metrics count the way that it was sent."""
    recording = flown("goal u002 95,95 5,95 @20", *faults)
    metrics = compute_metrics(recording)
    last = [fix for fix in recording.fixes if fix.uav == "u002"][-1]
    assert statuses(recording) == dict.fromkeys(["G1", "G2", "G3", "G4", "G5", "G7", "G8"], "held")
    assert (last.arrived, last.course.goal, last.course.leg) == (True, 1, 1)
    assert (round(last.waypoint_x_m), round(last.waypoint_y_m)) == (5, 95)
    assert metrics.arrived == 4 - len(metrics.not_living)
    assert metrics.goals_reached == (metrics.arrived or 0) + 1, "u002 had been at its first target"
    planned_m = sum(entry.straight_m for entry in recording.mission.roster)
    assert (metrics.straight_m or 0.0) > planned_m + 50


def test_a_goal_for_a_dead_uav_is_given_up() -> None:
    """The operator says so, the others go on, and no guarantee breaks."""
    recording = flown("kill u002 @8", "goal u002 95,95 @20", "goal u003 5,5 @130")
    (event,) = [event for event in recording.events if event.kind == EventKind.GOAL_UNANSWERED]
    assert (event.slot, '"u002"' in event.detail) == (120, True)
    assert len([goal for goal in recording.goals if goal.uav == "u002"]) == 100
    assert "broken" not in statuses(recording).values()


def test_no_mission_ends_before_its_last_goal() -> None:
    """All have arrived long before slot 150, when the operator sends one of them elsewhere."""
    recording = flown("goal u002 95,95 @150")
    assert (compute_metrics(recording).slots or 0) > 151
    assert compute_metrics(recording).completed
    assert statuses(recording)["G7"] == "held"


def test_targets_that_overlap_are_not_judged() -> None:
    """Nobody can promise that two UAVs arrive at one place."""
    recording = flown("goal u001 50,50 @10", "goal u002 51,50 @10", max_slots=200)
    result = next(result for result in check(recording) if result.guarantee == "G7")
    assert result.status == "not-judged"
    assert "u001 and u002 overlap" in result.notes[0]


def test_a_lifelong_mission_never_rests() -> None:
    """Each UAV reaches goal after goal until `max_slots`, over the death of a process; G7 is held by goals reached."""
    recording = flown("kill u003 @20 for 3s", goals="lifelong", max_slots=240)
    metrics = compute_metrics(recording)
    reached = {fix.uav: fix.course.goal for fix in recording.fixes}
    assert all(goals >= 3 for goals in reached.values())
    assert metrics.goals_reached == sum(reached.values())
    assert (metrics.slots, metrics.completed, metrics.not_home) == (240, True, [])
    assert metrics.goals_per_minute == pytest.approx(metrics.goals_reached / 2)
    assert set(statuses(recording).values()) == {"held"}
