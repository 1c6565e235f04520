"""Violations that end a promise for good, planted in faultless missions: landed UAVs, vehicles with inertia, goals."""

from __future__ import annotations

import pytest

from edc_swarm.analysis.guarantees.check import check
from edc_swarm.analysis.guarantees.verdict import GuaranteeResult
from edc_swarm.mission.failsafe import failsafe_of
from edc_swarm.mission.vehicle_model import VehicleModel
from edc_swarm.protocol.messages import Command, Fix, Message, MissionMessage, Truth
from tests.unit.synthetic import Path, change, flight, parallel, recorded, straight, whole

NOTHING_FLOWN = {"executing": False, "command_term": -1, "command_seq": -1}


def results(messages: list[Message]) -> dict[str, GuaranteeResult]:
    """Return the verdicts by guarantee."""
    return {result.guarantee: result for result in check(recorded(messages))}


def kinds(messages: list[Message], guarantee: str) -> list[tuple[str, int]]:
    """Return kind and slot of each violation of a guarantee."""
    return [(violation.kind, violation.slot) for violation in results(messages)[guarantee].violations]


def test_a_uav_that_still_speaks_or_flies_after_it_had_to_land_breaks_g2() -> None:
    """It lands `land_after_s` after its last accepted step, and nobody keeps clear of it any more."""
    paths = [straight((12.0 * k, 0.0), (12.0 * k, 16.0), 8, wait=9) for k in range(3)]
    messages = flight(paths, failsafe="land", land_after_s=2.0)
    for slot in range(1, 9):
        change(messages, {"uav": "u2", "slot": slot}, Fix, **NOTHING_FLOWN)
    mission = messages[0]
    assert isinstance(mission, MissionMessage)
    failsafe = failsafe_of(mission)
    assert failsafe is not None
    assert kinds(messages, "G2") == [("after-landing", failsafe.landing_slot(-1))]
    kept = (m for m in messages if not (isinstance(m, Command | Fix | Truth) and m.uav == "u2" and 0 < m.slot < 9))
    silent = whole(kept)
    assert kinds(silent, "G2")[0] == ("after-landing", 9)


@pytest.mark.parametrize(("steps_m", "slots"), [([0.5, 1.0, 1.5, 1.0, 0.5], []), ([0.5, 1.5, 1.0, 0.0], [2, 4])])
def test_a_step_that_changes_more_than_the_vehicle_can_breaks_g4(steps_m: list[float], slots: list[int]) -> None:
    """The step change is a_max dt^2, here 0.625 m, at the start, in flight and at the end."""
    path: Path = [(0.0, sum(steps_m[:slot])) for slot in range(len(steps_m) + 1)]
    messages = flight([path], vehicle=VehicleModel(model="multirotor", a_max_mps2=2.5))
    assert [slot for kind, slot in kinds(messages, "G4") if kind == "changes-too-fast"] == slots


def test_without_a_head_a_body_that_jumps_is_a_violation_all_the_same() -> None:
    """Local control promises no head and no hold, and excuses no UAV that moves without a step of its own."""
    messages = flight(parallel(), control="local")
    assert {name: results(messages)[name].status for name in ("G2", "G4")} == dict.fromkeys(
        ("G2", "G4"), "not-applicable"
    )
    change(messages, {"uav": "u2", "slot": 4}, Fix, **NOTHING_FLOWN)
    change(messages, {"uav": "u1", "slot": 5}, Truth, from_x_m=50.0)
    found = {kind for guarantee in ("G2", "G4") for kind, _ in kinds(messages, guarantee)}
    assert found == {"moved-without-command", "truth-moved", "truth-jumped", "truth-differs"}


def test_a_uav_of_a_lifelong_mission_that_reaches_no_goal_breaks_g7() -> None:
    """A mission that is too short for that is not judged."""
    for slots, status in ((300, "not-judged"), (700, "broken")):
        messages = flight([[(12.0 * k, 0.0)] * slots for k in range(3)], goals="lifelong", max_slots=slots)
        verdict = results(messages)["G7"]
        assert verdict.status == status, verdict
        assert [(v.kind, v.uavs) for v in verdict.violations] == [("no-goal", [f"u{k}"]) for k in range(3)] * (
            status == "broken"
        )
