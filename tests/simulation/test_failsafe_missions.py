"""Whole missions with and without the failsafe: who gets home, who lands, who waits beside a covered target."""

from __future__ import annotations

from typing import Any

import pytest

from edc_swarm.agent.head import Head
from edc_swarm.analysis.guarantees.check import check
from edc_swarm.analysis.guarantees.progress import PROGRESS
from edc_swarm.analysis.metrics import Metrics, compute_metrics
from edc_swarm.analysis.tables import metric_rows
from edc_swarm.mission.failsafe import failsafe_of
from edc_swarm.mission.prospect import COMPLETED, NOBODY_LEFT
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.validation import mission_from_dict
from edc_swarm.planner.registry import make_planner
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.messages import Message, MissionMessage, mission_message
from edc_swarm.recording.model import Recording
from edc_swarm.simulation.simulator import Simulation, SimulationEnd

LAND = {"failsafe": "land", "land_after_s": 4.0, "landing_s": 2.0}
HOLD = {"failsafe": "hold"}


def simulated(fields: dict[str, Any]) -> tuple[MissionMessage, Recording, SimulationEnd, Metrics]:
    """Simulate a mission."""
    message = mission_message(complete_mission(mission_from_dict(fields)))
    said: list[Message] = []
    simulation = Simulation(
        message, lambda: make_planner(message.planner, message), lambda _key, said_now, _ns: said.append(said_now)
    )
    end = simulation.run()
    recording = Recording.from_messages(said)
    return message, recording, end, compute_metrics(recording)


def flown(fields: dict[str, Any]) -> tuple[MissionMessage, Recording, SimulationEnd, Metrics]:
    """Simulate a mission, in which no guarantee may break."""
    message, recording, end, metrics = simulated(fields)
    assert [str(found) for result in check(recording) for found in result.violations] == []
    assert all(result.judged for result in check(recording)), [result.notes for result in check(recording)]
    return message, recording, end, metrics


def covered(**failsafe: Any) -> dict[str, Any]:
    """Four UAVs; u2 dies on its way, on the target of u1, which arrives there later."""
    places = [("u1", 0, 0, 40, 0), ("u2", 40, 22, 40, -22), ("u3", 0, 40, 10, 40), ("u4", 40, 60, 30, 60)]
    roster = [
        {"uav": uav, "start_x_m": x, "start_y_m": y, "target_x_m": to_x, "target_y_m": to_y}
        | {"r_m": 5, "body_m": 0.25, "energy_j": energy_j}
        for (uav, x, y, to_x, to_y), energy_j in zip(places, (6e4, 5e4, 9e4, 8e4), strict=True)
    ]
    return {"roster": roster, "fault": ["kill u2 @4.3s"], **failsafe}


def test_a_dead_uav_that_landed_keeps_nobody_away() -> None:
    """u1 waits until u2's airspace is free, and flies there."""
    message, recording, end, found = flown(covered(**LAND))
    assert end.reason == COMPLETED
    assert [(who.uav, who.cause) for who in found.not_home] == [("u2", "killed")]
    (landing,) = found.landed
    failsafe = failsafe_of(message)
    assert failsafe is not None
    assert (landing.uav, landing.told) == ("u2", False)
    assert 0 <= landing.stepped_slot - end.stepped_slot["u2"] <= 1, "a step that it can have accepted counts"
    assert (landing.slot, landing.free_slot) == (landing.stepped_slot + 9, failsafe.free_slot(landing.stepped_slot))
    first = min(report.slot for report in recording.reports if "u2" in report.landed)
    assert landing.free_slot <= first + 1 <= landing.free_slot + 1
    assert abs(landing.x_m - 40) < 1e-9
    assert "derived from its promise" in dict(metric_rows(found))["landed"]
    assert end.slots > landing.free_slot


def test_with_hold_it_waits_beside_its_target() -> None:
    """u1 has not arrived, stands still out of u2's disc, and the mission ends when it has waited."""
    _, _, end, found = flown(covered(**HOLD))
    assert end.reason == COMPLETED
    assert [(who.uav, who.cause) for who in found.not_home] == [("u1", "beside"), ("u2", "killed")]
    assert (found.beside, found.landed, found.arrived, found.completed) == (["u1"], [], 2, False)
    assert found.not_home[0].reason.startswith("waits beside its target: target covered by u2's")
    assert "beside their targets, which stay covered: u1" in dict(metric_rows(found))["arrived"]


def test_a_uav_that_is_cut_off_lands_and_is_named() -> None:
    """It lives, says so, and is not home; the others are."""
    fields = {"seed": 3, "uavs": 6, "area_m2": 6000.0, "fault": ["partition u003|rest @3s"], **LAND}
    _, recording, _, found = flown(fields)
    (event,) = [event for event in recording.events if event.kind == EventKind.LANDED]
    assert event.source == "u003"
    assert [(landing.uav, landing.told, landing.slot) for landing in found.landed] == [("u003", True, event.slot)]
    (who,) = found.not_home
    assert (who.uav, who.cause, who.slot) == ("u003", "landed", event.slot)
    assert "u003" in found.not_living


def test_a_uav_that_is_cut_off_at_its_target_lands_at_home() -> None:
    """A UAV that starts at its target and hears nobody for long: on the ground, and home."""
    fields = covered(**LAND)
    fields["roster"][2] |= {"target_x_m": 0, "target_y_m": 40}
    _, _, _, found = flown({**fields, "fault": ["partition u3|rest @1s"]})
    assert [landing.uav for landing in found.landed] == ["u3"]
    assert found.not_home == []
    assert found.completed


@pytest.mark.parametrize("fault", ["kill u003 @3s for 20", "freeze u003 @3s for 10", "freeze u003 mid-step @3s for 10"])
def test_a_process_that_comes_back_after_the_landing(fault: str) -> None:
    """It stays on the ground, and says so."""
    _, recording, end, found = flown({"seed": 3, "uavs": 6, "area_m2": 6000.0, "fault": [fault], **LAND})
    assert [landing.uav for landing in found.landed] == ["u003"]
    assert end.stepped_slot["u003"] <= 7
    assert max(fix.slot for fix in recording.fixes if fix.uav == "u003") < 14


def test_a_swarm_that_lands_without_a_fault_breaks_progress(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody leads although all hear each other. That landed UAVs cover the targets of others excuses nobody."""
    monkeypatch.setattr(Head, "has_quorum", lambda *_: False)
    _, recording, _, found = simulated({"seed": 3, "uavs": 6, "area_m2": 6000.0, **LAND})
    assert len(found.landed) == 6
    (result,) = [result for result in check(recording) if result.guarantee == PROGRESS]
    assert len(result.violations) == 6


def test_a_swarm_without_any_head_lands_as_a_whole() -> None:
    """Halves that cannot hear each other have no quorum."""
    _, _, end, found = flown({"seed": 3, "uavs": 6, "area_m2": 6000.0, "fault": ["partition halves @3s"], **LAND})
    assert end.reason == NOBODY_LEFT
    assert len(found.landed) == 6
    assert all(landing.told for landing in found.landed)
