"""Property: nothing that decodes makes a UAV raise, whatever state it is in, nor move a term without a quorum."""

from __future__ import annotations

import math
from typing import Any, cast

import msgspec
from hypothesis import given, settings
from hypothesis import strategies as st

from edc_swarm.agent.node import PeerGone, PlannerReady, Publish, Received, Tick, UavNode
from edc_swarm.agent.vehicle import first_airframe, first_promise
from edc_swarm.errors import MessageError
from edc_swarm.planner.registry import make_planner
from edc_swarm.protocol.admission import Admission
from edc_swarm.protocol.codec import decode, encode
from edc_swarm.protocol.keys import Keys
from edc_swarm.protocol.messages import Command, Event, Message, MissionMessage, Report
from tests.builders import EPOCH_NS, SLOT_NS, North, command, fix, mission_message, report, row, truth

IDS = ("a", "b", "c")
ROSTER = row(IDS, gap_m=40.0, north_m=90.0, energy_j=2e6)
MISSION = mission_message(ROSTER)
KEYS = Keys("m")
EDC = make_planner("edc", MISSION)

numbers = st.sampled_from(
    [0, 1, 2, -1, 5, 40, 0.5, -0.0, 1e7, -1e7, 1e12, 5e-324, (1 << 40) - 1, 1 << 40, (1 << 53) - 1, 1 << 63, 1e308]
)
texts = st.sampled_from(
    [*IDS, "", "zz", "*", "a/b", "planned", "claim", "failed", "operator", "fault", "kill a @1", "m", "x" * 70]
)
plain = st.recursive(
    st.one_of(numbers, texts, st.booleans(), st.none(), st.lists(texts, max_size=4), st.lists(numbers, max_size=4)),
    lambda inner: st.one_of(st.lists(inner, max_size=2), st.dictionaries(texts, inner, max_size=2)),
    max_leaves=4,
)
slots = st.integers(-1, 12)


def _sane(slot: int, term: int, uav: str) -> list[Message]:
    """A message of every kind, all well formed."""
    stamp: dict[str, Any] = {"slot": slot, "sent_ns": EPOCH_NS + max(slot, 0) * SLOT_NS + 1}
    return [
        fix(uav, waypoint_m=(1.0, 1.0), term=term, head="b", **stamp),
        truth(uav, from_m=(1.0, 1.0), to_m=(1.0, 1.0), **stamp),
        command("a", target_m=(0.0, 1.0), head=uav, term=term, **stamp),
        report(head=uav, term=term, grants=list(IDS), **stamp),
        Event(source=uav, kind="fault", **stamp),
        MISSION,
    ]


@st.composite
def _hostile(draw: st.DrawFn) -> Message | None:
    """A message with some of its fields replaced by anything, if it still decodes."""
    message: Message = draw(st.sampled_from(_sane(draw(slots), draw(st.integers(0, 5)), draw(st.sampled_from(IDS)))))
    raw = msgspec.to_builtins(message)
    names = [name for name in raw if name not in {"uav", "head", "source"} or draw(st.booleans())]
    changed = {name: draw(plain) for name in draw(st.lists(st.sampled_from(names), max_size=3))}
    try:
        return decode(KEYS.of(message), msgspec.json.encode({**raw, **changed}))
    except MessageError:
        return None


hostile = _hostile().filter(lambda message: message is not None).map(lambda message: cast("Message", message))
said = st.one_of(hostile.map(Received), st.builds(PeerGone, texts))
story = st.lists(st.tuples(st.one_of(st.just(Tick()), said), st.floats(-1, 12)), min_size=4, max_size=30)


@settings(max_examples=100, deadline=None)
@given(story, st.sampled_from(IDS), st.booleans())
def test_nothing_that_decodes_makes_a_step_raise(story: list[tuple[Any, float]], uav: str, leads: bool) -> None:
    """Judged or not; and what the UAV says about it is well formed itself."""
    entry = ROSTER[IDS.index(uav)]
    node = UavNode(MISSION, uav, "i", first_promise(entry), first_airframe(entry))
    node.step(PlannerReady(EDC if leads else North()), EPOCH_NS - 1)
    for event, slot in sorted(story, key=lambda each: each[1]):
        now_ns = EPOCH_NS + round(slot * SLOT_NS)
        effects = node.step(Tick(), now_ns)
        followers = _followers(node, math.floor(slot)) if leads else []
        for each in [*followers, event, Tick()]:
            effects += node.step(each, now_ns)
        for effect in effects:
            if isinstance(effect, Publish):
                key = KEYS.of(effect.message)
                assert decode(key, encode(effect.message)) == effect.message


def _followers(node: UavNode, slot: int) -> list[Received]:
    """Fixes by which all others grant what the UAV grants, so that it leads when it grants itself."""
    term, head = node.grant
    where: dict[str, Any] = {"slot": slot, "sent_ns": EPOCH_NS + slot * SLOT_NS, "x_m": 0.0, "y_m": 0.0}
    others = [entry for entry in ROSTER if entry.uav != node.uav and slot >= 0]
    starts = [(entry.uav, (entry.start_x_m, entry.start_y_m)) for entry in others]
    return [Received(fix(uav, waypoint_m=at_m, term=term, head=head, suspects=True, **where)) for uav, at_m in starts]


@settings(max_examples=200, deadline=None)
@given(st.lists(hostile, max_size=6))
def test_no_term_moves_on_anything_short_of_a_quorum(messages: list[Message]) -> None:
    """One liar under its own id, whatever it says in reports and commands, cannot make a UAV follow it."""
    entry = ROSTER[0]
    node = UavNode(MISSION, "a", "i", first_promise(entry), first_airframe(entry))
    node.step(Tick(), EPOCH_NS)
    for message in messages:
        if isinstance(message, Report | Command) and not (isinstance(message, Report) and _is_backed(message)):
            node.step(Received(message), EPOCH_NS + 1)
            assert node.grant == (0, "")


def _is_backed(report: Report) -> bool:
    return len(set(report.grants) & set(IDS)) >= MISSION.quorum


@settings(max_examples=200, deadline=None)
@given(hostile)
def test_what_is_admitted_is_about_the_mission(message: Message) -> None:
    """The judge never raises, and lets in nobody that is not in the roster."""
    if Admission(MISSION).refusal(message) is None and not isinstance(message, Event | MissionMessage):
        assert {getattr(message, name) for name in ("uav", "head") if hasattr(message, name)} <= {*IDS, ""}
        assert message.slot <= MISSION.max_slots + 1000
