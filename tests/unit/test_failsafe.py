"""The failsafe: its limits in slots, the vehicle that lands, the head that drops a hull, old recordings."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from edc_swarm.agent.head import Head
from edc_swarm.agent.knowledge import Knowledge
from edc_swarm.agent.node import Effect, Land, Persist, Publish, Received, Tick, UavNode
from edc_swarm.agent.vehicle import Airframe, Promise, comes_too_late, first_airframe, first_promise
from edc_swarm.errors import MissionError
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.failsafe import Failsafe, failsafe_of
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.mission.validation import mission_from_dict
from edc_swarm.planner.interface import Plan, PlanRequest
from edc_swarm.protocol.admission import Admission
from edc_swarm.protocol.codec import decode, encode
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.keys import Keys
from edc_swarm.protocol.messages import Command, Event, Fix, Message, MissionMessage, Report, mission_message

SLOT_NS = 500_000_000
EPOCH_NS = 1_700_000_000_000_000_000
IDS = ("a", "b", "c", "d")
ROSTER = [
    RosterEntry(
        uav=uav, start_x_m=40.0 * k, start_y_m=0, target_x_m=40.0 * k, target_y_m=90, r_m=5, body_m=1, energy_j=1e5
    )
    for k, uav in enumerate(IDS)
]
LIMITS = {"failsafe": "land", "land_after_s": 3.0, "landing_s": 1.0}
WAIT, DESCENT = 6, 3
"""Six slots of waiting; one second to the ground is two slots, and a tick that is just not late makes them three."""
MISSION = mission_message(mission_from_dict({"uavs": 4, "roster": msgspec.to_builtins(ROSTER), **LIMITS}))
MISSION = msgspec.structs.replace(MISSION, epoch_ns=EPOCH_NS, tau_s=0.2, max_slots=200, gps_model="none")
ENTRY = ROSTER[0]


@pytest.mark.parametrize(
    ("fields", "limits"),
    [
        ({}, Failsafe(20, 21)),
        ({"landing_s": 0.0}, Failsafe(20, 1)),
        ({"landing_s": 0.0, "lag_slots": 1}, Failsafe(20, 2)),
        ({"landing_s": 0.4}, Failsafe(20, 2)),
        ({"landing_s": 0.38}, Failsafe(20, 1)),
        ({"landing_s": 0.38, "guard_s": 0.02}, Failsafe(20, 2)),
        ({"landing_s": 0.38, "land_after_s": 60.0}, Failsafe(120, 2)),
        ({"land_after_s": 10.1, "landing_s": 0.0}, Failsafe(21, 1)),
        ({"land_after_s": 0.1, "landing_s": 0.0}, Failsafe(6, 1)),
        ({"land_after_s": 0.1, "landing_s": 0.0, "lease_slots": 5}, Failsafe(9, 1)),
        (LIMITS, Failsafe(WAIT, DESCENT)),
        ({"failsafe": "hold"}, None),
    ],
)
def test_the_limits_in_slots(fields: dict[str, Any], limits: Failsafe | None) -> None:
    """Waits are rounded up, no shorter than a fail-over; late ticks, guards, slow clocks and lag lengthen a descent."""
    assert failsafe_of(mission_from_dict(fields)) == limits


def test_the_slots_of_a_landing() -> None:
    """A step may be accepted up to the slot of the landing; the airspace is free a descent later."""
    limits = Failsafe(WAIT, DESCENT)
    assert (limits.landing_slot(10), limits.free_slot(10), limits.slots) == (17, 20, 9)
    assert limits.landing_slot(-1) == WAIT


@pytest.mark.parametrize(
    "fields",
    [{"failsafe": "fall"}, {"land_after_s": 0.0}, {"land_after_s": -1.0}, {"landing_s": -0.1}, {"land_after_s": 1e9}],
)
def test_limits_that_nobody_can_mean(fields: dict[str, Any]) -> None:
    """They are refused by name."""
    with pytest.raises(MissionError, match=next(iter(fields))):
        mission_from_dict(fields)


def test_a_recording_without_the_field_is_of_uavs_that_held() -> None:
    """Missions land by default; a mission message of an older version did not know of it."""
    key = Keys(MISSION.name).mission
    assert Mission().failsafe == "land"
    said = msgspec.json.decode(encode(MISSION))
    assert decode(key, msgspec.json.encode(said)) == MISSION
    for name in ("failsafe", "land_after_s", "landing_s"):
        del said[name]
    old = decode(key, msgspec.json.encode(said))
    assert isinstance(old, MissionMessage)
    assert failsafe_of(old) is None


# --- the vehicle -----------------------------------------------------------------------------


def at(slot: float) -> int:
    """Wall nanoseconds of a moment in slots since the epoch."""
    return EPOCH_NS + round(slot * SLOT_NS)


def node(promise: Promise | None, airframe: Airframe | None = None) -> UavNode:
    """UAV a with this promise."""
    return UavNode(MISSION, "a", "a-1", promise, airframe or first_airframe(ENTRY))


def promised(stepped_slot: int, slot: int | None = None) -> Promise:
    """A promise to b in term 1 that was written in `slot` and says when the last step was accepted."""
    written = stepped_slot if slot is None else slot
    return msgspec.structs.replace(first_promise(ENTRY), slot=written, term=1, head="b", stepped_slot=stepped_slot)


def command(slot: int, to_y_m: float = 0.0) -> Command:
    """A step of b's term 1 for a."""
    return Command(
        head="b", uav="a", slot=slot, seq=slot, term=1, start_x_m=0, start_y_m=0, target_x_m=0, target_y_m=to_y_m
    )


def messages(effects: list[Effect]) -> list[Message]:
    """The messages of the effects."""
    return [effect.message for effect in effects if isinstance(effect, Publish)]


def begun(uav: UavNode, slot: int, order: Command | None = None) -> list[Effect]:
    """Let `slot` begin, with a command that came in time if there is one; return the effects of its tick."""
    uav.step(Tick(), at(slot - 0.5))
    if order is not None:
        uav.step(Received(order), at(slot - 0.4))
    return uav.step(Tick(), at(slot))


def test_a_uav_without_steps_lands_in_its_slot_and_not_before() -> None:
    """Nobody commands it: it says a fix in every slot until the wait is over, then that it lands, and ends."""
    uav = node(promised(10))
    for slot in range(11, 10 + WAIT + 1):
        assert any(isinstance(message, Fix) for message in messages(uav.step(Tick(), at(slot))))
    effects = uav.step(Tick(), at(10 + WAIT + 1))
    (event,) = [message for message in messages(effects) if isinstance(message, Event)]
    assert (event.kind, event.slot, event.detail) == (EventKind.LANDED, 17, "no accepted step since slot 10")
    assert not any(isinstance(message, Fix) for message in messages(effects))
    assert isinstance(effects[0], Persist)
    assert isinstance(effects[-1], Land)
    assert uav.ended
    assert uav.step(Received(command(18)), at(17.5)) == []
    assert uav.step(Tick(), at(18)) == []


def test_a_uav_that_has_never_stepped_says_so() -> None:
    """No slot is the last one with a step."""
    uav = node(first_promise(ENTRY))
    for slot in range(WAIT):
        uav.step(Tick(), at(slot))
    (event,) = [message for message in messages(uav.step(Tick(), at(WAIT))) if isinstance(message, Event)]
    assert (event.kind, event.detail) == (EventKind.LANDED, "no accepted step at all")


@pytest.mark.parametrize("to_y_m", [0.0, 2.0])
def test_a_step_in_the_last_slot_keeps_it_in_the_air(to_y_m: float) -> None:
    """A command to hold is a step too; the promise and the airframe then have its slot."""
    uav = node(promised(10))
    effects = begun(uav, 17, command(17, to_y_m))
    (written,) = [effect for effect in effects if isinstance(effect, Persist)]
    assert written.promise is not None
    assert (written.promise.stepped_slot, written.airframe.stepped_slot) == (17, 17)
    assert not uav.ended


@pytest.mark.parametrize("slot", [18, 19, 100])
def test_a_process_that_comes_back_too_late_stays_on_the_ground(slot: int) -> None:
    """Restarted or thawed, with a command for the very slot: its promise has expired."""
    uav = node(promised(10))
    effects = begun(uav, slot, command(slot, 2.0))
    assert uav.ended
    assert not any(isinstance(message, Fix) and message.executing for message in messages(effects))


def test_the_airframe_remembers_what_a_lost_promise_forgot() -> None:
    """A UAV without its promise lands by the last step of its vehicle."""
    uav = node(None, msgspec.structs.replace(first_airframe(ENTRY), stepped_slot=10))
    uav.step(Tick(), at(16))
    assert not uav.ended
    uav.step(Tick(), at(17))
    assert uav.ended


def test_a_step_that_is_written_after_the_landing_began() -> None:
    """The write accepts a step, so the vehicle refuses it, but not any other write."""
    before = msgspec.structs.replace(first_airframe(ENTRY), stepped_slot=10)
    step = msgspec.structs.replace(before, y_m=2.0, stepped_slot=11)
    assert not comes_too_late(step, before, MISSION, at(17.2))
    assert comes_too_late(step, before, MISSION, at(17.2) + 1)
    assert not comes_too_late(before, before, MISSION, at(100))
    assert not comes_too_late(step, before, msgspec.structs.replace(MISSION, failsafe="hold"), at(100))


# --- the head --------------------------------------------------------------------------------


class Holds:
    """A planner that lets everybody hold."""

    def plan(self, request: PlanRequest) -> Plan:
        """Return the places of the request."""
        return Plan([(float(x), float(y)) for x, y in request.position_m], "planned")


def fix(uav: str, slot: int, term: int = 2, head: str = "a") -> Fix:
    """A fix at the start that grants a in term 2."""
    x_m = 40.0 * IDS.index(uav)
    return Fix(uav=uav, slot=slot, term=term, head=head, x_m=0, y_m=0, r_m=5, waypoint_x_m=x_m, waypoint_y_m=0)


class Swarm:
    """Head a of term 2, which hears b and c in every slot, and of d what it is told."""

    def __init__(self, mission: Mission = MISSION) -> None:
        self.knowledge = Knowledge(mission.roster)
        self.head = Head(mission, "a", 1, self.knowledge)
        self.head.take_office((2, "a"))

    def plan(self, slot: int) -> Report:
        """Return the report of a slot."""
        for uav in "abc":
            self.knowledge.hear_fix(fix(uav, slot), slot)
        return self.head.plan(slot, Holds()).report

    def first_without_hull(self, first: int) -> int:
        """Return the first slot whose plan has no hull of d."""
        for slot in range(first, 100):
            report = self.plan(slot)
            assert ("d" in report.hull_uav) != ("d" in report.landed)
            assert "d" in report.unheard
            if report.landed:
                return slot + 1
        raise AssertionError("the hull stays")


def test_a_hull_goes_when_the_last_commanded_step_is_old_enough() -> None:
    """(a) d is heard in slot 5 and commanded for slot 6, which it can have accepted."""
    swarm = Swarm()
    swarm.knowledge.hear_fix(fix("d", 5), 5)
    swarm.plan(5)
    assert swarm.first_without_hull(6) == 6 + WAIT + 1 + DESCENT


def test_without_a_command_the_fix_counts() -> None:
    """(a) d grants the head, which has not commanded it."""
    swarm = Swarm()
    swarm.knowledge.hear_fix(fix("d", 5), 5)
    assert swarm.first_without_hull(6) == 5 + WAIT + 1 + DESCENT


@pytest.mark.parametrize("heard", [None, fix("d", 1, term=1, head="d"), fix("d", 3, term=1, head="d")])
def test_an_older_head_may_have_commanded_until_the_first_quorum(heard: Fix | None) -> None:
    """(b) The first plan of the term is of slot 8, so an older one may be for slot 9, whatever was heard."""
    swarm = Swarm()
    if heard is not None:
        swarm.knowledge.hear_fix(heard, 8)
    assert swarm.first_without_hull(8) == 9 + WAIT + 1 + DESCENT


def test_a_uav_that_is_still_heard_keeps_its_hull() -> None:
    """(b) d grants an older head and is heard until slot 20."""
    swarm = Swarm()
    for slot in range(8, 21):
        swarm.knowledge.hear_fix(fix("d", slot, term=1, head="d"), slot)
        assert "d" in swarm.plan(slot).hull_uav
    assert swarm.first_without_hull(21) == 20 + WAIT + 1 + DESCENT


def test_a_newer_term_moves_nobody_who_has_landed() -> None:
    """(b) A fix of a higher term counts by its slot."""
    swarm = Swarm()
    swarm.plan(8)
    swarm.knowledge.hear_fix(fix("d", 12, term=3, head="d"), 12)
    assert swarm.first_without_hull(12) == 12 + WAIT + 1 + DESCENT


def test_later_heads_believe_a_report() -> None:
    """From the slot after the report, not before, and for good."""
    report = Report(
        head="b",
        slot=30,
        term=1,
        status="planned",
        heard=["a", "b", "c"],
        grants=["a", "b", "c"],
        quorum=3,
        landed=["d"],
    )
    swarm = Swarm()
    swarm.knowledge.hear_report(report)
    assert "d" in swarm.plan(28).hull_uav
    assert swarm.plan(29).hull_uav == ["d", "a"]
    assert swarm.plan(30).landed == ["d"]
    assert swarm.plan(31).landed == ["d"]


def test_with_hold_a_hull_stays() -> None:
    """No wait is long enough, and no report changes that."""
    swarm = Swarm(msgspec.structs.replace(MISSION, failsafe="hold"))
    swarm.knowledge.hear_report(Report(head="b", slot=3, term=1, status="planned", quorum=3, landed=["d"]))
    for slot in range(5, 90):
        assert swarm.plan(slot).hull_uav == ["d", "a"]


@pytest.mark.parametrize(("landed", "admitted"), [(["d"], True), (["z"], False), (["d", "d"], False)])
def test_only_uavs_of_the_roster_land(landed: list[str], admitted: bool) -> None:
    """A report that names anybody else, or one twice, is malformed."""
    report = Report(head="b", slot=3, term=1, status="no-quorum", quorum=3, landed=landed, sent_ns=at(3.1))
    assert (Admission(MISSION).refusal(report) is None) == admitted
