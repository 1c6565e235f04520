"""Local control: every UAV plans its own steps from the fixes that it has heard."""

from __future__ import annotations

from typing import Any

import pytest

from edc_swarm.agent.local import LocalControl
from edc_swarm.analysis.guarantees.check import check
from edc_swarm.analysis.guarantees.verdict import GuaranteeResult
from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.analysis.tables import metric_rows
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import complete_mission
from edc_swarm.planner.registry import make_planner
from edc_swarm.protocol.messages import Fix, Message, mission_message
from edc_swarm.recording.model import Recording
from edc_swarm.simulation.simulator import Simulation, SimulationEnd
from tests.builders import entry, mission

HEAD_ON = [
    entry("a", (0.0, 0.0), (60.0, 0.0), v_max_mps=5.0, energy_j=1e6),
    entry("b", (60.0, 0.4), (0.0, 0.4), v_max_mps=5.0, energy_j=1e6),
]


def flown(whole: Mission) -> tuple[Recording, SimulationEnd]:
    """Fly a mission and return what was said."""
    message, said = mission_message(complete_mission(whole)), list[Message]()
    end = Simulation(message, lambda: make_planner(message.planner, message), lambda _k, m, _t: said.append(m)).run()
    return Recording.from_messages(said), end


def verdicts(recording: Recording) -> dict[str, GuaranteeResult]:
    """Return the verdicts by guarantee."""
    return {result.guarantee: result for result in check(recording)}


@pytest.mark.parametrize("planner", ["orca", "bvc", "cbf"])
def test_a_swarm_without_a_head_arrives_and_says_what_is_not_promised(planner: str) -> None:
    """Its only messages about flight are fixes, one a slot; a delay or a lost fix moves nobody into another."""
    whole = mission(HEAD_ON, planner=planner, control="local")
    recording, end = flown(whole)
    assert end.completed
    assert recording.commands == recording.reports == []
    assert len(recording.fixes) == len(HEAD_ON) * end.slots
    found = verdicts(recording)
    assert {name: result.status for name, result in found.items()} == {
        "G1": "not-applicable",
        "G2": "not-applicable",
        "G3": "held",
        "G4": "not-applicable",
        "G5": "held",
        "G7": "not-applicable",
        "G8": "not-applicable",
    }
    assert all(result.notes for name, result in found.items() if name != "G5")
    metrics = compute_metrics(recording)
    assert metrics.completed
    assert metrics.slots_missed == 0
    rows = dict(metric_rows(metrics))
    assert rows["heads"].startswith("none: control is local")
    assert not rows.keys() & {"plan time", "fix to command", "age of fixes", "age of commands"}
    assert metrics.makespan_s is not None


def test_who_dies_without_a_head_takes_no_verdict_with_it() -> None:
    """Steps of their own are no messages: none is missing, and all motion is known but for the last word."""
    recording, _ = flown(mission(HEAD_ON, planner="bvc", control="local", fault=["kill a @4"]))
    found = verdicts(recording)
    assert found["G3"].status == "held", found["G3"].notes
    assert found["G5"].words == "held, up to the last recorded message of a", found["G5"].notes


def test_a_uav_knows_only_what_it_has_heard() -> None:
    """Two that cannot hear each other and meet head-on collide: a UAV that read fixes it never heard would not."""
    cut = mission(HEAD_ON, planner="bvc", control="local", fault=["partition a|b @0"])
    g3 = verdicts(flown(cut)[0])["G3"]
    assert g3.broken
    assert g3.violations[0].uavs == ["a", "b"]
    assert "measured, not promised: control is local" in g3.notes


def test_the_defect_of_reading_what_was_not_heard_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """With all fixes in everybody's hands the two pass each other, so the test above would fail."""
    everyone: dict[str, Fix] = {}
    true_neighbour = LocalControl._neighbour

    def all_knowing(self: Any, other: Any, slot: int) -> Any:
        known = self._knowledge
        everyone.update({uav: fix for uav, fix in known.newest.items() if uav == self._uav})
        known.newest.update({uav: fix for uav, fix in everyone.items() if uav != self._uav})
        return true_neighbour(self, other, slot)

    monkeypatch.setattr(LocalControl, "_neighbour", all_knowing)
    cut = mission(HEAD_ON, planner="bvc", control="local", fault=["partition a|b @0"])
    assert not verdicts(flown(cut)[0])["G3"].broken


def test_a_swarm_without_a_head_that_stands_still_has_stalled() -> None:
    """Nobody waits for `max_slots`: a target that another UAV, which died there before, covers for good."""
    roster = [*HEAD_ON[:1], entry("b", (60.0, 0.0), (60.0, 30.0), energy_j=1e6)]
    dead = mission(roster, planner="cbf", control="local", fault=["kill b @0"], failsafe="hold", max_slots=900)
    recording, end = flown(dead)
    assert end.slots < 900
    assert not verdicts(recording)["G3"].broken
