"""Admission of messages: one test line for each reason to reject one."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from edc_swarm.errors import MessageError
from edc_swarm.protocol.admission import Admission
from edc_swarm.protocol.messages import Event, Message
from tests.builders import command, fix, report, truth
from tests.unit.synthetic import EPOCH_NS, SLOT_NS, flight, mission_of, parallel

MISSION = mission_of(parallel(5), max_slots=50, sent_ns=EPOCH_NS - 1)
MISSION.roster[1] = msgspec.structs.replace(MISSION.roster[1], start_y_m=7.0)
UAVS = [entry.uav for entry in MISSION.roster]
NOW: dict[str, Any] = {"slot": 4, "sent_ns": EPOCH_NS + 4 * SLOT_NS}
FIX = fix("u1", waypoint_m=(12.0, 7.0), y_m=0.0, term=1, head="u0", **NOW)
TRUTH = truth("u1", **NOW)
COMMAND = command("u1", head="u0", **{**NOW, "slot": 5})
REPORT = report(head="u0", grants=UAVS[:3], heard=UAVS[:3], quorum=3, **NOW)
HULL = ("hull_ax_m", "hull_ay_m", "hull_bx_m", "hull_by_m", "hull_r_m")
EVENT = Event(source="operator", kind="fault", detail="kill u1 @5", sent_ns=EPOCH_NS)


def test_a_whole_mission_is_admitted() -> None:
    """Admission rejects no message of a faultless swarm."""
    admission = Admission(mission_of(parallel()))
    assert [admission.refusal(message) for message in flight(parallel())] == [None] * len(flight(parallel()))


@pytest.mark.parametrize(
    ("message", "changes", "reason"),
    [
        (FIX, {"uav": "zz"}, "no UAV zz in the roster"),
        (FIX, {"head": "zz"}, "no UAV zz in the roster"),
        (FIX, {"slot": 1051}, "slot 1051 is after the end"),
        (FIX, {"sent_ns": NOW["sent_ns"] - 1}, "sent before slot 4 began"),
        (FIX, {"term": 1 << 39}, "there is no term 549755813888"),
        (FIX, {"waypoint_y_m": 20.0}, "13 m from the start in slot 4"),
        (TRUTH, {"uav": "zz"}, "no UAV zz"),
        (COMMAND, {"head": "zz"}, "no UAV zz"),
        (COMMAND, {"uav": "zz"}, "no UAV zz"),
        (COMMAND, {"sent_ns": NOW["sent_ns"] - 1}, "sent before slot 4 began"),
        (COMMAND, {"term": 1 << 39}, "there is no term"),
        (REPORT, {"head": "zz"}, "no UAV zz"),
        (REPORT, {"grants": [*UAVS[:2], "zz"]}, "no UAV zz"),
        (REPORT, {"grants": ["u0", "u1", "u1"]}, "a UAV is named twice"),
        (REPORT, {"grants": UAVS[:2]}, "without a quorum"),
        (REPORT, {"grants": UAVS[:2], "quorum": 2}, "without a quorum"),
        (REPORT, {"grants": UAVS[:1], "quorum": 1, "status": "claim"}, "without a quorum"),
        (REPORT, {"quorum": 2}, "without a quorum"),
        (REPORT, {"grants": UAVS[1:4]}, "without a quorum"),
        (REPORT, {"successor": "zz", "next_term": 2}, "no UAV zz"),
        (REPORT, {"term": 1 << 39}, "there is no term"),
        (REPORT, {"next_term": 1 << 39}, "there is no term"),
        (REPORT, {"term": 2000 * 1050 + 1}, "there is no term"),
        (REPORT, {"heard": [*UAVS[:3], "zz"]}, "no UAV zz"),
        (REPORT, {"hull_uav": ["zz"], **{name: [1.0] for name in HULL}}, "no UAV zz"),
        (REPORT, {"standby": ["zz"]}, "no UAV zz"),
        (REPORT, {"unheard": ["zz"]}, "no UAV zz"),
        (REPORT, {"hull_uav": ["u4"], "hull_ax_m": [1.0]}, "lists of hulls differ in length"),
        (EVENT, {"source": "zz"}, "no UAV zz"),
        (EVENT, {"sent_ns": EPOCH_NS - 2}, "sent before the mission"),
        (EVENT, {"detail": "kill zz @5"}, "about a UAV of the roster"),
        (EVENT, {"detail": "nonsense"}, "a fault such as"),
    ],
)
def test_what_cannot_be_true_is_refused(message: Message, changes: dict[str, Any], reason: str) -> None:
    """The message is admitted; with one wrong field it is rejected, and the reason names the field."""
    admission = Admission(MISSION)
    assert admission.refusal(message) is None
    wrong = msgspec.structs.replace(message, **changes)
    assert reason in str(admission.refusal(wrong))
    with pytest.raises(MessageError, match=r"^key: "):
        admission.check("key", wrong)


def test_terms_may_grow_as_fast_as_any_election() -> None:
    """Up to the limit a term is believed, however many elections failed before."""
    assert Admission(MISSION).refusal(msgspec.structs.replace(REPORT, term=2000 * 1050)) is None


@pytest.mark.parametrize(
    ("message", "changes"),
    [
        (FIX, {"waypoint_y_m": 7.0 + 5 * 2.5}),
        (FIX, {"waypoint_y_m": 7.0 - 5 * 2.5 * (1 + 1e-7)}),
        (TRUTH, {"slot": 1050, "sent_ns": EPOCH_NS + 1050 * SLOT_NS}),
        (EVENT, {"sent_ns": EPOCH_NS - 1}),
    ],
)
def test_what_is_just_possible_is_believed(message: Message, changes: dict[str, Any]) -> None:
    """Full speed in every slot but for rounding, a clock that is far ahead, and what is said with the mission."""
    assert Admission(MISSION).refusal(msgspec.structs.replace(message, **changes)) is None


def test_a_report_without_a_plan_needs_no_quorum() -> None:
    """It claims nothing."""
    powerless = msgspec.structs.replace(REPORT, status="no-quorum", grants=[])
    assert Admission(MISSION).refusal(powerless) is None
