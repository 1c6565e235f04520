"""One UAV as a value: order of effects, late ticks, commands late, twice, of others."""

from __future__ import annotations

import sys
from typing import Any

import msgspec
import pytest

from edc_swarm.agent.flight import MAX_PENDING
from edc_swarm.agent.node import (
    Effect,
    Land,
    Listen,
    PeerGone,
    Persist,
    PlannerReady,
    Publish,
    Received,
    Tick,
    UavNode,
    WantPlanner,
)
from edc_swarm.agent.vehicle import Airframe, Promise, first_promise
from edc_swarm.geodesy import to_wgs84
from edc_swarm.protocol.messages import Command, Event, Fix, Message, Report, Truth
from tests import builders
from tests.builders import North, at, mission_message, row

IDS = ("a", "b", "c")
ROSTER = [
    msgspec.structs.replace(entry, energy_j=1e4 - k) for k, entry in enumerate(row(IDS, gap_m=40.0, north_m=90.0))
]
MISSION = mission_message(ROSTER, gps_model="none", standbys=1)


def node(uav: str = "b", slot: int = 4, term: int = 1, head: str = "a", **fields: Any) -> UavNode:
    """A UAV whose disk says that it grants `head` in `term`; no slot has begun yet in this life."""
    x_m = 40.0 * IDS.index(uav)
    promise = Promise(slot=slot, term=term, head=head, waypoint_x_m=x_m, waypoint_y_m=0.0)
    return builders.node(MISSION, uav, fields.pop("promise", promise), **fields)


def command(slot: int, uav: str = "b", **fields: Any) -> Command:
    """A metre north for UAV b from its start."""
    x_m = 40.0 * IDS.index(uav)
    return builders.command(uav, slot, (x_m, 0.0), (x_m, 1.0), **fields)


def report(slot: int, term: int = 1, head: str = "a", **fields: Any) -> Report:
    """A report that proves a quorum."""
    basis = {"grants": ["a", "b"], "heard": ["a", "b"], "standby": ["b"]}
    return builders.report(slot, term, head, **{**basis, **fields})


def fix(uav: str, slot: int, term: int = 1, head: str = "a", **fields: Any) -> Fix:
    """A fix at the start."""
    return builders.fix(uav, slot, (40.0 * IDS.index(uav), 0.0), term=term, head=head, **fields)


def said(effects: list[Effect], kind: type[Message]) -> list[Any]:
    """The messages of a kind among the effects."""
    return [effect.message for effect in effects if isinstance(effect, Publish) and isinstance(effect.message, kind)]


def flown(effects: list[Effect]) -> bool:
    """Return True if the slot that began in this step began with a command."""
    return bool(said(effects, Fix)[0].executing)


@pytest.mark.parametrize(("tick", "again"), [(6.0, 1), (6.04, 1), (6.12, 0)])
def test_an_overloaded_uav_sends_its_fix_once(tick: float, again: int) -> None:
    """Without a command it sends the fix again, unless its tick was later than a quarter of `tau_s`, 0.1 of a slot."""
    uav = node()
    uav.step(Tick(), at(5))
    (fix,) = said(uav.step(Tick(), at(tick)), Fix)
    assert not fix.executing
    assert len(said(uav.step(Tick(), at(6.21)), Fix)) == again


def test_the_promise_comes_first() -> None:
    """A slot begins with persist, truth, fix, in this order; the promise holds what the fix says."""
    effects = node().step(Tick(), at(5))
    assert isinstance(effects[0], Persist)
    assert [type(e.message) for e in effects if isinstance(e, Publish)] == [Truth, Fix]
    (found,) = said(effects, Fix)
    promise = effects[0].promise
    assert promise is not None
    assert (promise.slot, promise.term, promise.head) == (found.slot, found.term, found.head) == (5, 1, "a")
    assert (promise.waypoint_x_m, promise.waypoint_y_m) == (found.waypoint_x_m, found.waypoint_y_m)


def test_a_step_is_persisted_before_it_is_said() -> None:
    """The waypoint that is flown to is on disk first."""
    uav = node()
    uav.step(Tick(), at(5))
    uav.step(Received(command(6)), at(5.5))
    effects = uav.step(Tick(), at(6))
    assert flown(effects)
    assert isinstance(effects[0], Persist)
    assert effects[0].promise is not None
    assert effects[0].promise.waypoint_y_m == 1.0
    assert effects[0].airframe.y_m == 1.0


def test_no_geodesy_is_left_for_the_tick() -> None:
    """The node converts the position of the next fix when the command arrives, not when the slot begins."""
    uav = node()
    uav.step(Tick(), at(5))
    uav.step(Received(command(6, target_y_m=1.0625)), at(5.5))
    uav.step(Tick(), at(6))
    uav.step(Received(command(7, start_y_m=1.0625)), at(6.5))
    converted = to_wgs84.cache_info().misses
    (found,) = said(uav.step(Tick(), at(7)), Fix)
    assert found.y_m == 1.0625
    assert to_wgs84.cache_info().misses == converted


def test_a_new_grant_is_persisted_before_it_is_said() -> None:
    """Hearing proof of a newer term: persist, then the fix of the same slot again, then no more of the old."""
    uav = node()
    uav.step(Tick(), at(5))
    uav.step(Received(command(6)), at(5.2))
    effects = uav.step(Received(report(5, term=2, head="c", grants=["b", "c"])), at(5.3))
    assert [type(effect) for effect in effects][:2] == [Persist, Publish]
    assert (effects[0].promise.slot, effects[0].promise.term, effects[0].promise.head) == (5, 2, "c")  # type: ignore[union-attr]
    (again,) = said(effects, Fix)
    assert (again.slot, again.term, again.head) == (5, 2, "c")
    assert not flown(uav.step(Tick(), at(6))), "what the old head commanded is discarded"


@pytest.mark.parametrize(
    ("changes", "heard_at", "ticks_at", "is_flown"),
    [
        ({}, 5.99, 6.0, True),
        ({}, 5.99, 6.2, True),
        ({}, 5.99, 6.21, False),
        ({}, 6.0, 6.0, False),
        ({}, 6.1, 6.1, False),
        ({}, 5.99, 7.0, False),
        ({"term": 2}, 5.9, 6.0, False),
        ({"term": 0}, 5.9, 6.0, False),
        ({"head": "c"}, 5.9, 6.0, False),
        ({"slot": 7}, 5.9, 6.0, False),
        ({"slot": 5}, 5.9, 6.0, False),
        ({"start_y_m": 1e-12}, 5.9, 6.0, False),
        ({"target_y_m": 2.6}, 5.9, 6.0, False),
        ({"target_y_m": 2.5}, 5.9, 6.0, True),
        ({"target_y_m": 1e300}, 5.9, 6.0, False),
        ({"uav": "c"}, 5.9, 6.0, False),
    ],
)
def test_which_commands_are_flown(changes: dict[str, Any], heard_at: float, ticks_at: float, is_flown: bool) -> None:
    """Received before the slot, for it, from the head granted, from the waypoint, in reach, not late."""
    uav = node()
    uav.step(Tick(), at(5))
    effects = uav.step(Received(msgspec.structs.replace(command(6), **changes)), at(heard_at))
    effects = [*effects, *uav.step(Tick(), at(ticks_at))]
    assert any(found.executing for found in said(effects, Fix)) is is_flown


def test_a_command_is_flown_once() -> None:
    """A second copy, before or after the tick, moves nothing twice; nor does it after a restart."""
    uav = node()
    uav.step(Tick(), at(5))
    uav.step(Received(command(6)), at(5.5))
    uav.step(Received(command(6)), at(5.6))
    effects = uav.step(Tick(), at(6))
    promise = effects[0].promise  # type: ignore[union-attr]
    uav.step(Received(command(6)), at(6.1))
    assert said(uav.step(Tick(), at(7)), Fix)[0].waypoint_y_m == 1.0
    again = node(promise=promise)
    again.step(Received(command(6)), at(6.3))
    assert said(again.step(Tick(), at(6.4)), Fix) == [], "the slot on disk has begun already"
    assert not flown(again.step(Tick(), at(7)))


def test_late_ticks_are_counted() -> None:
    """More than a fifth of the slot is late; slots slept through are held, and hovered in."""
    uav = node()
    uav.step(Tick(), at(5))
    assert said(uav.step(Tick(), at(6.21)), Fix)[0].late_ticks == 1
    last = said(uav.step(Tick(), at(9)), Fix)[0]
    assert (last.slot, last.late_ticks, last.held_slots) == (9, 1, 5)


def test_a_clock_that_steps_back() -> None:
    """The slot never decreases, in this life or the next."""
    uav = node()
    uav.step(Tick(), at(8))
    assert uav.step(Tick(), at(6)) == []
    assert uav.slot == 8
    again = node(slot=8)
    assert said(again.step(Tick(), at(6)), Fix) == []
    assert said(again.step(Tick(), at(9)), Fix)[0].slot == 9


def test_a_frozen_uav_wakes_to_late_messages() -> None:
    """Messages queued during the freeze were not received in time: the slot begins first."""
    uav = node()
    uav.step(Tick(), at(5))
    effects = uav.step(Received(command(8)), at(8.05))
    assert not flown(effects)
    assert not any(found.executing for found in said(uav.step(Tick(), at(8.1)), Fix))


def test_the_battery_must_cover_the_step() -> None:
    """Less than the step takes: hold; nothing left: the end, said and persisted."""
    uav = node(energy_j=120.0)
    uav.step(Tick(), at(5))
    uav.step(Received(command(6)), at(5.5))
    effects = uav.step(Tick(), at(6))
    assert isinstance(effects[0], Persist)
    assert effects[0].airframe.y_m == 0.0
    assert isinstance(effects[-1], Land)
    assert [event.kind for event in said(effects, Event)] == ["battery-empty"]
    assert uav.ended
    assert uav.step(Tick(), at(7)) == []


def test_a_uav_without_memory_never_grants() -> None:
    """Without a promise there is no vote, no command, and no promise is written."""
    uav = UavNode(MISSION, "b", "b-2", None, Airframe(x_m=40.0, y_m=3.0, energy_j=9e3))
    effects = uav.step(Tick(), at(5))
    (found,) = said(effects, Fix)
    assert (found.voter, found.term, found.head, found.waypoint_y_m) == (False, 0, "", 3.0)
    assert effects[0].promise is None  # type: ignore[union-attr]
    for slot in range(5, 12):
        effects = uav.step(Received(report(slot)), at(slot + 0.3))
        effects += uav.step(Received(command(slot + 1, start_y_m=3.0, target_y_m=4.0, term=0, head="")), at(slot + 0.4))
        effects += uav.step(Tick(), at(slot + 1))
        assert all((f.term, f.head, f.executing) == (0, "", False) for f in said(effects, Fix))


def test_pending_commands_are_few() -> None:
    """A head cannot fill the memory with commands for slots to come."""
    uav = node()
    uav.step(Tick(), at(5))
    for slot in range(6, 100):
        uav.step(Received(command(slot, start_y_m=slot - 6.0, target_y_m=slot - 5.0)), at(5.5))
    assert [slot for slot in range(6, 100) if flown(uav.step(Tick(), at(slot)))] == list(range(6, 6 + MAX_PENDING))


# --- what may be lost ---------------------------------------------------------------------------


def test_a_fix_is_said_again_by_whom_no_command_has_reached() -> None:
    """Once, half of tau_s into a slot: the same place, slot and grant; no truth, since nothing has moved."""
    uav = node()
    first = said(uav.step(Tick(), at(5)), Fix)
    assert (len(first), uav.wakeup_ns(at(5))) == (1, at(6)), "the head did not know of this life in the slot before"
    (before,) = said(uav.step(Tick(), at(6)), Fix)
    assert uav.wakeup_ns(at(6)) == at(6.2)
    effects = uav.step(Tick(), at(6.2))
    (again,) = said(effects, Fix)
    assert again == msgspec.structs.replace(before, seq=before.seq + 1, energy_j=again.energy_j)
    assert isinstance(effects[0], Persist)
    assert said(effects, Truth) == []
    assert uav.wakeup_ns(at(6.2)) == at(7)
    assert said(uav.step(Tick(), at(6.3)), Fix) == []


def test_no_fix_is_said_again_without_need() -> None:
    """Not with a command to fly, not of a slot that is over, not while there is no head, not when all is over."""
    uav, alone, last = node(), node(term=0, head=""), node(energy_j=120.0)
    for one in (uav, alone, last):
        one.step(Tick(), at(5))
    uav.step(Received(command(6)), at(5.5))
    for one in (uav, alone, last):
        one.step(Tick(), at(6))
    assert [one.wakeup_ns(at(6)) for one in (uav, alone, last)] == [at(7)] * 3
    assert last.ended
    uav.step(Tick(), at(7))
    assert uav.wakeup_ns(at(7)) == at(7.2)
    (slept,) = said(uav.step(Tick(), at(8.5)), Fix)
    assert slept.slot == 8
    assert uav.wakeup_ns(at(8.5)) == at(9), "it has slept too long: the first one is late enough"


# --- the head ----------------------------------------------------------------------------------


def leader() -> tuple[UavNode, North]:
    """UAV a, freshly granted by the others in term 2 at slot 5, not yet with a quorum."""
    uav, planner = node("a", head="c"), North()
    uav.step(PlannerReady(planner), at(4.9))
    uav.step(Tick(), at(5))
    for peer in ("b", "c"):
        uav.step(Received(fix(peer, 5, term=1, head="c", suspects=True)), at(5.01))
    uav.step(Received(fix("b", 5, term=2, head="a")), at(5.1))
    return uav, planner


def test_a_head_that_lands_does_not_wake_for_its_own_command() -> None:
    """It takes no step any more, so a wake-up for it would be followed by the next one at once, for ever."""
    uav, _ = leader()
    planned_ns = uav.wakeup_ns(at(5.5))
    uav.step(Tick(), planned_ns)
    assert uav.wakeup_ns(planned_ns) == planned_ns
    uav.ground([])
    assert uav.wakeup_ns(planned_ns) == at(6)


def test_a_head_plans_with_a_quorum_and_once() -> None:
    """Commands for the heard of this very slot, then the report; a later fix makes no second plan."""
    uav, planner = leader()
    assert uav.grant == (2, "a")
    effects = uav.step(Tick(), uav.wakeup_ns(at(5.5)))
    commands, (made,) = said(effects, Command), said(effects, Report)
    assert [(c.uav, c.slot, c.term, c.head) for c in commands] == [("a", 6, 2, "a"), ("b", 6, 2, "a")]
    assert (made.heard, made.unheard, made.slot, made.status) == (["a", "b"], ["c"], 5, "no-qp-needed")
    assert (made.hull_uav, made.hull_r_m) == (["c", "a"], [2.5, 0.0])
    kinds = [type(e.message) for e in effects if isinstance(e, Publish)]
    assert kinds.index(Report) > max(i for i, kind in enumerate(kinds) if kind is Command)
    uav.step(Received(fix("c", 5, term=2, head="a")), at(5.6))
    assert said(uav.step(Tick(), at(5.7)), Report) == []
    assert len(planner.requests) == 1
    assert flown(uav.step(Tick(), at(6))), "the head flies by its own commands"


def test_fixes_of_another_slot_or_grant_are_no_quorum() -> None:
    """Late, early and foreign grants do not count; at the end of the slot the head says that it was powerless."""
    uav, planner = leader()
    uav.step(Tick(), uav.wakeup_ns(at(5.5)))
    uav.step(Tick(), at(6))
    for found in (
        fix("b", 5, term=2, head="a", seq=9),
        fix("b", 7, term=2, head="a"),
        fix("c", 6, term=1, head="c"),
        fix("c", 6, term=2, head="a", voter=False),
    ):
        uav.step(Received(found), at(6.5))
    assert said(uav.step(Tick(), at(6.9)), Report) == []
    (powerless,) = said(uav.step(Tick(), at(7)), Report)
    assert (powerless.slot, powerless.status, powerless.heard, powerless.has_quorum) == (6, "no-quorum", ["a"], False)
    assert len(planner.requests) == 1


def test_a_restarted_head_is_barred_from_its_term() -> None:
    """With a quorum of grants in the term on its disk it still plans nothing."""
    uav, planner = node("a", term=2, head="a"), North()
    uav.step(PlannerReady(planner), at(4.9))
    uav.step(Tick(), at(5))
    for peer in ("b", "c"):
        uav.step(Received(fix(peer, 5, term=2, head="a")), at(5.1))
    assert said(uav.step(Tick(), at(5.6)), Report) == []
    assert said(uav.step(Tick(), at(6)), Report) == [], "nor is it powerless: it is no head"
    assert planner.requests == []


def test_an_overrun_is_not_flown_by_the_head_either() -> None:
    """A head whose plan was done after the slot began holds like everybody."""
    uav, _ = leader()
    uav.step(Tick(), uav.wakeup_ns(at(5.5)))
    assert not flown(uav.step(Tick(), at(6.01)))


def test_no_fix_waits_for_a_solver() -> None:
    """The tick that begins a slot does not plan, even with a quorum."""
    uav, planner = leader()
    uav.step(Tick(), uav.wakeup_ns(at(5.5)))
    for peer in ("b", "c"):
        uav.step(Received(fix(peer, 6, term=2, head="a")), at(5.9))
    effects = uav.step(Tick(), at(6))
    assert said(effects, Fix)
    assert said(effects, Command) == []
    assert uav.wakeup_ns(at(6)) == at(6)
    assert len(said(uav.step(Tick(), at(6)), Command)) == 3
    assert len(planner.requests) == 2


def test_wishes() -> None:
    """A UAV on duty without a head, or a standby, listens to all fixes and wants a planner, once; others do not."""
    assert node("c", promise=first_promise(ROSTER[2])).wishes() == [Listen(True), WantPlanner()]
    uav = node("c")
    first = uav.step(Tick(), at(5))
    assert Listen(True) in first
    assert WantPlanner(rehearsed=False) in first, "all wait for it: a plan would take its whole duty"
    assert Listen(False) in uav.step(Received(report(5)), at(5.3))
    named = uav.step(Received(report(5, standby=["c"])), at(5.4))
    assert Listen(True) in named
    assert not any(isinstance(effect, WantPlanner) for effect in named)
    follower = node("c", promise=Promise(slot=4, term=1, head="a", waypoint_x_m=0.0, waypoint_y_m=0.0))
    follower.step(Received(report(5)), at(5.3))
    assert WantPlanner() in follower.step(Received(report(5, standby=["c"])), at(5.4))


def test_a_token_that_vanishes_is_a_hint() -> None:
    """The head's token makes a UAV suspect at once, and say so; another's does not."""
    uav = node("c")
    uav.step(Tick(), at(5))
    uav.step(Received(report(5)), at(5.1))
    assert uav.step(PeerGone("b"), at(5.2)) == []
    (found,) = said(uav.step(PeerGone("a"), at(5.2)), Fix)
    assert (found.suspects, found.term, found.head) == (True, 1, "a")


def test_a_clock_ahead_is_reported_once() -> None:
    """A fix stamped later than now is worth a warning, the first time."""
    uav = node()
    uav.step(Tick(), at(5))
    ahead = fix("c", 5, sent_ns=at(5.2))
    assert [e.kind for e in said(uav.step(Received(ahead), at(5.1)), Event)] == ["clock-offset"]
    assert said(uav.step(Received(ahead), at(5.1)), Event) == []


def test_the_first_command_of_a_slot_is_the_one() -> None:
    """A head plans a slot once: what comes later in its name is not from that plan."""
    uav = node()
    uav.step(Tick(), at(5.1))
    for target_y_m in (1.0, 2.0):
        uav.step(Received(command(6, target_y_m=target_y_m)), at(5.2))
    (said_at_6,) = said(uav.step(Tick(), at(6.0)), Fix)
    assert (said_at_6.executing, said_at_6.waypoint_y_m) == (True, 1.0)


@pytest.mark.parametrize(
    ("changes", "believed"),
    [
        ({}, True),
        ({"grants": ["c"]}, False),
        ({"grants": ["c"], "quorum": 1}, False),
        ({"quorum": 1}, False),
        ({"grants": ["a", "b"]}, False),
        ({"grants": ["c", "c"]}, False),
        ({"grants": ["c", "zz"]}, False),
        ({"status": "no-quorum"}, False),
    ],
)
def test_a_newer_term_is_believed_on_proof_alone(changes: dict[str, Any], believed: bool) -> None:
    """Grants of a quorum of the mission's roster, the head's own among them, whatever a report says is enough."""
    uav = node()
    uav.step(Tick(), at(5.1))
    uav.step(Received(report(5, term=9, head="c", **{"grants": ["b", "c"], **changes})), at(5.2))
    assert uav.grant == ((9, "c") if believed else (1, "a"))


def test_a_claim_needs_a_quorum_by_the_missions_count() -> None:
    """Even of a UAV that suspects its head."""
    uav = node()
    uav.step(Tick(), at(5.1))
    uav.step(PeerGone("a"), at(5.15))
    uav.step(Received(report(5, term=9, head="c", status="claim", grants=["c"], quorum=1)), at(5.2))
    assert uav.grant == (1, "a")
    uav.step(Received(report(5, term=9, head="c", status="claim", grants=["b", "c"])), at(5.2))
    assert uav.grant == (9, "c")


def test_strangers_leave_no_trace() -> None:
    """Neither their clocks nor their comings and goings are noted, however many they are."""
    uav = node()
    uav.step(Tick(), at(5.1))
    for number in range(100):
        name = f"x{number}"
        held = sys.getrefcount(name)
        assert uav.step(Received(msgspec.structs.replace(fix("a", 5), uav=name, sent_ns=at(50))), at(5.2)) == []
        assert uav.step(PeerGone(name), at(5.2)) == []
        assert sys.getrefcount(name) == held, "somebody keeps the name"
