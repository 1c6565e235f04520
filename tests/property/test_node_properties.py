"""Property: whatever a UAV hears, in whatever order and at whatever times, it keeps its promise."""

from __future__ import annotations

from typing import Any

import msgspec
from hypothesis import given, settings
from hypothesis import strategies as st

from edc_swarm.agent.node import (
    Disturbed,
    Effect,
    NodeEvent,
    PeerGone,
    Persist,
    PlannerReady,
    Publish,
    Received,
    Tick,
    UavNode,
)
from edc_swarm.agent.vehicle import Promise, first_airframe, first_promise
from edc_swarm.mission.faults import ChangeGps
from edc_swarm.mission.field_types import Criterion
from edc_swarm.protocol.codec import decode, encode
from edc_swarm.protocol.keys import Keys
from edc_swarm.protocol.messages import Command, Event, Fix, MissionMessage, Report
from tests.builders import EPOCH_NS, SLOT_NS, North, fix, mission_message, row

IDS = ("a", "b", "c")
ROSTER = row(IDS, gap_m=40.0, north_m=90.0, energy_j=2e3)
KEYS = Keys("m")


def mission(elect: Criterion, standbys: int, lease: int, lag: int) -> MissionMessage:
    """Three UAVs."""
    return mission_message(ROSTER, elect=elect, standbys=standbys, lease_slots=lease, lag_slots=lag)


# Small numbers, so that messages fit together now and then, and any others.
uavs = st.sampled_from([*IDS, "zz"])
heads = st.sampled_from([*IDS, "", "zz"])
slots = st.one_of(st.integers(-1, 14), st.integers(-1, (1 << 40) - 1))
terms = st.one_of(st.integers(0, 5), st.integers(0, (1 << 40) - 2))
metres = st.one_of(st.sampled_from([0.0, 1.0, 40.0, 80.0]), st.floats(allow_nan=False, allow_infinity=False))
names = st.lists(uavs, max_size=4)
fixes = st.builds(
    Fix, uav=uavs, slot=slots, term=terms, head=heads, suspects=st.booleans(), voter=st.booleans(), x_m=metres,
    y_m=metres, r_m=metres, waypoint_x_m=metres, waypoint_y_m=metres, energy_j=metres, response_ms=metres,
    seq=st.integers(0, 9), instance=st.sampled_from(["i", "j"]), sent_ns=st.integers(0, (1 << 63) - 1),
)  # fmt: skip
commands = st.builds(
    Command, head=st.sampled_from(IDS), uav=uavs, slot=slots, term=terms, start_x_m=metres, start_y_m=metres,
    target_x_m=metres, target_y_m=metres,
)  # fmt: skip
reports = st.builds(
    Report, head=st.sampled_from(IDS), slot=slots, term=terms, quorum=st.integers(-1, 4), grants=names, heard=names,
    status=st.sampled_from(["planned", "no-quorum", "claim"]), standby=names, successor=heads, next_term=terms,
    hull_uav=names, hull_ax_m=st.lists(metres), hull_ay_m=st.lists(metres), hull_bx_m=st.lists(metres),
    hull_by_m=st.lists(metres), hull_r_m=st.lists(metres),
)  # fmt: skip
others = st.sampled_from([Event(source="operator", kind="fault"), fix("a", 3)])
events: st.SearchStrategy[NodeEvent] = st.one_of(
    st.just(Tick()),
    st.builds(Received, fixes),
    st.builds(Received, commands),
    st.builds(Received, reports),
    st.builds(Received, others),
    st.builds(PeerGone, uavs),
    st.builds(
        Disturbed,
        st.builds(
            ChangeGps, target=st.just("a"), model=st.sampled_from(["none", "bias", "white", "gauss-markov", "outage"])
        ),
    ),
    st.just(PlannerReady(North())),
)
times = st.one_of(st.floats(0, 14), st.floats(-5, 100)).map(lambda slot: EPOCH_NS + round(slot * SLOT_NS))
missions = st.builds(
    mission, st.sampled_from(["energy", "response-time"]), st.integers(0, 3), st.integers(1, 3), st.integers(0, 1)
)


def _keeps_its_promise(before: Promise, after: Promise) -> None:
    assert after.slot >= before.slot
    assert after.term >= before.term
    if after.term == before.term:
        assert after.head == before.head
    if after.slot == before.slot:
        assert (after.waypoint_x_m, after.waypoint_y_m) == (before.waypoint_x_m, before.waypoint_y_m)


def _check(effects: list[Effect], disk: Promise | None, seqs: dict[str, int]) -> Promise | None:
    """What the effects of a step leave on disk; nothing is said that is not there yet."""
    for effect in effects:
        match effect:
            case Persist(promise, _):
                if disk is not None:
                    assert promise is not None
                    _keeps_its_promise(disk, promise)
                disk = promise
            case Publish(Fix() as fix):
                assert fix.voter is (disk is not None)
                if disk is not None:
                    assert (fix.slot, fix.term, fix.head) == (disk.slot, disk.term, disk.head)
                    assert (fix.waypoint_x_m, fix.waypoint_y_m) == (disk.waypoint_x_m, disk.waypoint_y_m)
            case Publish(Command() as command):
                assert disk is not None
                assert (command.term, command.head) == disk.grant
                assert command.slot == disk.slot + 1
            case Publish(Report(status="planned" | "no-qp-needed" | "failed") as report):
                assert disk is not None
                assert (report.term, report.head) == disk.grant
                assert len(set(report.heard)) >= 2
            case _:
                pass
        if isinstance(effect, Publish):
            key = KEYS.of(effect.message)
            assert effect.message.seq == seqs.get(key, -1) + 1
            seqs[key] = effect.message.seq
    return disk


@settings(max_examples=150, deadline=None)
@given(
    missions,
    st.sampled_from(IDS),
    st.booleans(),
    st.lists(st.tuples(events, times, st.integers(0, 9)), min_size=1, max_size=60),
)
def test_a_uav_keeps_its_promise(
    flown: MissionMessage, uav: str, remembers: bool, story: list[tuple[NodeEvent, int, int]]
) -> None:
    """No step raises, slot and term never decrease, no head changes within a term, persist comes first.

    Now and then the process is killed after a few effects of a step, and starts from its disk.
    """
    entry = ROSTER[IDS.index(uav)]
    disk = first_promise(entry) if remembers else None
    node, seqs = UavNode(flown, uav, "life-0", disk, first_airframe(entry)), dict[str, int]()
    plans: set[tuple[int, int]] = set()
    for life, (event, now_ns, fate) in enumerate(story, 1):
        effects = node.step(event, now_ns)
        if fate == 0:
            effects = effects[: life % (len(effects) + 1)]
        disk = _check(effects, disk, seqs)
        for effect in effects:
            if isinstance(effect, Publish) and isinstance(effect.message, Report) and effect.message.has_quorum:
                assert (effect.message.term, effect.message.slot) not in plans
                plans.add((effect.message.term, effect.message.slot))
        assert node.wakeup_ns(now_ns) >= min(now_ns, EPOCH_NS)
        if fate == 0:
            node, seqs = UavNode(flown, uav, f"life-{life}", disk, first_airframe(entry)), {}


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 2), st.floats(0, 1), st.floats(0, 1)), min_size=20, max_size=60))
def test_three_uavs_on_a_bad_bus(story: list[tuple[int, float, float]]) -> None:
    """Every message lost, doubled or late at will: one head per term, and what is said can be decoded."""
    flown = mission("energy", 1, 1, 0)
    nodes = {e.uav: UavNode(flown, e.uav, e.uav, first_promise(e), first_airframe(e)) for e in ROSTER}
    bus: list[Any] = []
    leaders: dict[int, str] = {}
    for node in nodes.values():
        node.step(PlannerReady(North()), EPOCH_NS - 1)
    for index, (who, chance, fraction) in enumerate(story):
        now_ns = EPOCH_NS + round((index / 4 + fraction / 8) * SLOT_NS)
        for uav, node in nodes.items():
            heard = bus[-12:] if chance > 0.3 else bus[who::3][-6:]
            heard_events: list[NodeEvent] = [Tick(), *(Received(message) for message in heard), Tick()]
            for event in heard_events:
                for effect in node.step(event, now_ns):
                    if isinstance(effect, Publish) and not isinstance(effect.message, Event):
                        message = effect.message
                        assert decode(KEYS.of(message), encode(message)) == message
                        if isinstance(message, Fix | Command | Report):
                            bus.append(msgspec.structs.replace(message, sent_ns=now_ns))
                        if isinstance(message, Report) and message.has_quorum:
                            assert leaders.setdefault(message.term, uav) == uav
