"""Reasons why a UAV is not home, planted one at a time, and no reason without evidence."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from edc_swarm.analysis.metrics import Metrics, compute_metrics
from edc_swarm.analysis.outcome import STUCK_SLOTS, NotHome
from edc_swarm.analysis.tables import MAX_NAMED, metric_rows
from edc_swarm.protocol.messages import Command, Event, Fix, Message, MissionMessage, Report, Truth
from tests.unit.synthetic import change, flight, parallel, recorded


def mission_in(messages: list[Message]) -> MissionMessage:
    """Return the mission, which is the first of all messages."""
    mission = messages[0]
    assert isinstance(mission, MissionMessage)
    return mission


def with_target(messages: list[Message], k: int, x_m: float, y_m: float) -> None:
    """Move the target of UAV `k`, without a change of its flight."""
    roster = list(mission_in(messages).roster)
    roster[k] = msgspec.structs.replace(roster[k], target_x_m=x_m, target_y_m=y_m)
    messages[0] = msgspec.structs.replace(mission_in(messages), roster=roster)


def without(messages: list[Message], uav: str, kinds: Any, after: int) -> list[Message]:
    """Remove the messages about `uav` in slots later than `after`, and its `closed` event."""
    return [
        m
        for m in messages
        if not (isinstance(m, kinds) and getattr(m, "uav", "") == uav and m.slot > after)
        and not (isinstance(m, Event) and m.source == uav and m.kind == "closed")
    ]


def metrics(messages: list[Message]) -> Metrics:
    """Return the metrics of the messages."""
    return compute_metrics(recorded(messages))


def only(messages: list[Message]) -> NotHome:
    """Return the one UAV that is not home."""
    found = metrics(messages)
    assert not found.completed
    (who,) = found.not_home
    assert found.arrived == found.uavs - 1
    return who


@pytest.fixture
def messages() -> list[Message]:
    """Return messages of three UAVs 12 m apart that fly north in slots 1 to 30; u2 ends 100 m before its target."""
    said = flight(parallel(steps=30))
    with_target(said, 2, 24.0, 160.0)
    return said


def end(slot: int, why: str) -> Event:
    """Return the operator's event at the end of the mission."""
    return Event(source="operator", slot=slot, kind="end", detail=why)


def test_everybody_home_is_completed() -> None:
    """No UAV is listed as not home."""
    found = metrics(flight(parallel()))
    assert (found.completed, found.arrived, found.not_home) == (True, 3, [])
    assert "not home" not in dict(metric_rows(found))


@pytest.mark.parametrize(
    ("why", "reason"),
    [
        ("max_slots", "ran out of slots"),
        ("interrupted", "the mission was interrupted"),
        ("failed", "the mission was broken off"),
        ("nobody moves", "the mission was stopped: nobody moves"),
        (None, "the record ends in slot 30"),
    ],
)
def test_who_was_on_its_way_has_the_mission_s_end_as_its_reason(
    messages: list[Message], why: str | None, reason: str
) -> None:
    """The reason is the detail of the event `end`, or that the record has none."""
    messages += [end(30, why)] if why is not None else []
    who = only(messages)
    assert (who.uav, who.cause, who.reason, who.away_m) == ("u2", "mission-ended", reason, pytest.approx(100.0))
    assert str(who) == f"u2: {reason}, 100.00 m from its target"


@pytest.mark.parametrize(
    ("event", "cause", "reason"),
    [
        (Event(source="u2", slot=12, kind="battery-empty"), "battery-empty", "battery empty since slot 12"),
        (
            Event(source="operator", slot=12, kind="fault", detail="kill u2 @12"),
            "killed",
            "dead since slot 12 (killed by a fault)",
        ),
        (
            Event(source="operator", slot=13, kind="fault", detail="freeze u2 @13"),
            "frozen",
            "dead since slot 13 (frozen by a fault)",
        ),
        (
            Event(source="operator", slot=12, kind="exited", detail="u2 was ended by SIGKILL"),
            "process-gone",
            "dead since slot 12 (its process was ended by SIGKILL)",
        ),
        (
            Event(source="operator", slot=28, kind="exited", detail="u2 has gone from the bus"),
            "process-gone",
            "dead since slot 13 (its process has gone from the bus)",
        ),
        (
            Event(source="operator", slot=12, kind="exited", detail="u21 was ended by SIGKILL"),
            "silent",
            "silent since slot 13 (frozen, cut off, or its process gone)",
        ),
        (
            Event(source="operator", slot=14, kind="fault", detail="heal @14"),
            "silent",
            "silent since slot 13 (frozen, cut off, or its process gone)",
        ),
        (
            Event(source="operator", slot=5, kind="fault", detail="freeze u2 @5 for 1"),
            "silent",
            "silent since slot 13 (frozen, cut off, or its process gone)",
        ),
    ],
)
def test_who_lives_no_more_is_dead_for_what_was_told(
    messages: list[Message], event: Event, cause: str, reason: str
) -> None:
    """The cause is the last event that ended its flight, not one of another UAV, nor one that it outlived."""
    said = without(messages, "u2", Fix | Truth, 12)
    change(said, {}, Report, heard=["u0", "u1"])
    who = only([*said, event])
    assert (who.cause, who.reason) == (cause, reason)


def test_whose_end_is_told_late_was_alive_while_its_head_heard_it(messages: list[Message]) -> None:
    """The record lacks its fixes after slot 12; its head heard it up to slot 20."""
    said = without(messages, "u2", Fix | Truth, 12)
    for slot in range(21, 31):
        change(said, {"slot": slot}, Report, heard=["u0", "u1"])
    gone = Event(source="operator", slot=28, kind="exited", detail="u2 has gone from the bus")
    assert (only([*said, gone]).slot, only([*said, gone]).cause) == (21, "process-gone")


def test_lost_memory_is_a_reason(messages: list[Message]) -> None:
    """A UAV without memory grants no head, so no head commands it."""
    for slot in range(20, 31):
        change(messages, {"uav": "u2", "slot": slot}, Fix, voter=False, executing=False)
    assert (only(messages).cause, only(messages).slot) == ("memory-lost", 20)


def test_fixes_that_the_record_lacks_are_unknown(messages: list[Message]) -> None:
    """If the head heard the UAV, or its `closed` event lists more fixes, the record lacks them."""
    heard = without(messages, "u2", Fix | Truth, 12)
    numbered = [m for m in messages if not (isinstance(m, Fix | Truth) and m.uav == "u2" and m.slot > 12)]
    change(numbered, {}, Report, heard=["u0", "u1"])
    for said in (heard, numbered):
        who = only(said)
        assert (who.cause, who.reason) == ("record-incomplete", "unknown: the record lacks its fixes after slot 12")
    cut = [m for m in messages if not (isinstance(m, Fix | Truth | Report | Command) and m.slot > 12)]
    assert {who.cause for who in metrics([*cut, end(30, "max_slots")]).not_home} == {"record-incomplete"}


def test_who_was_never_heard_is_unknown_even_where_it_began_at_its_target(messages: list[Message]) -> None:
    """The start in the mission is no evidence of the UAV's place."""
    with_target(messages, 2, 24.0, 0.0)
    said = without(messages, "u2", Fix | Truth | Command, -1)
    who = only(said)
    assert (who.cause, who.reason, who.away_m) == ("never-heard", "unknown: the record holds no fix of it", None)


def test_a_target_below_a_dead_uav_is_covered(messages: list[Message]) -> None:
    """A target is covered by the disc at a known place, or by the hull."""
    with_target(messages, 2, 20.0, 60.0)
    with_target(messages, 1, 12.0, 90.0)
    messages.append(Event(source="operator", slot=30, kind="fault", detail="kill u1 @30"))
    covered = metrics(messages).not_home[1]
    assert (covered.reason, covered.by) == ("target covered by u1's disc", "u1")
    with_target(messages, 2, 36.0, 60.0)
    change(messages, {"slot": 29}, Report, term=2)
    change(
        messages,
        {"slot": 30},
        Report,
        term=2,
        hull_uav=["u1"],
        hull_ax_m=[12.0],
        hull_ay_m=[60.0],
        hull_bx_m=[25.7],
        hull_by_m=[60.0],
        hull_r_m=[0.5],
    )
    assert metrics(messages).not_home[1].reason == "target covered by u1's hull"


def test_who_stands_before_a_hull_is_blocked_by_it() -> None:
    """A UAV is blocked if it is stuck within one step of touching a hull."""
    paths = parallel(steps=8)
    waits = [[*path, *[path[-1]] * STUCK_SLOTS] for path in paths]
    said = flight(waits)
    with_target(said, 2, 24.0, 160.0)
    with_target(said, 1, 12.0, 90.0)
    said.append(Event(source="operator", slot=28, kind="fault", detail="kill u1 @28"))
    who = metrics(said).not_home[1]
    assert (who.cause, who.reason, who.by) == ("blocked", "blocked by u1's disc since slot 9", "u1")
    with_target(said, 1, 12.0, 16.0)
    assert metrics(said).not_home[0].cause == "mission-ended"


def test_who_is_not_commanded_says_since_when(messages: list[Message]) -> None:
    """The reason says if no UAV was commanded; a command that was not flown has its own reason."""
    alone = [m for m in messages if not (isinstance(m, Command) and m.uav == "u2" and m.slot > 20)]
    assert (only(alone).cause, only(alone).reason) == ("not-commanded", "not commanded since slot 21")
    nobody = [m for m in messages if not (isinstance(m, Command) and m.slot > 20)]
    assert only(nobody).reason == "not commanded since slot 21: no UAV was"
    for slot in range(21, 31):
        change(messages, {"uav": "u2", "slot": slot}, Fix, executing=False)
    assert (only(messages).cause, only(messages).slot) == ("commands-not-flown", 21)


def test_a_long_list_is_cut_in_the_table_alone() -> None:
    """The metrics name all UAVs."""
    said = flight(parallel(uavs=MAX_NAMED + 2))
    for k in range(MAX_NAMED + 2):
        with_target(said, k, 12.0 * k, 160.0)
    found = metrics(said)
    assert len(found.not_home) == MAX_NAMED + 2
    assert dict(metric_rows(found))["not home"].endswith("; and 2 more")


@pytest.mark.parametrize(("radius_m", "cause", "by"), [(2.5, "held", "u1"), (1.5, "mission-ended", "")])
def test_who_is_within_a_hull_is_held_by_it(messages: list[Message], radius_m: float, cause: str, by: str) -> None:
    """No step leads away from it; beside it one does."""
    with_target(messages, 1, 12.0, 90.0)
    messages.append(Event(source="operator", slot=30, kind="fault", detail="kill u1 @30"))
    hull = {"hull_ax_m": [12.0], "hull_ay_m": [60.0], "hull_bx_m": [22.0], "hull_by_m": [60.0], "hull_r_m": [radius_m]}
    change(messages, {"slot": 30}, Report, hull_uav=["u1"], **hull)
    who = metrics(messages).not_home[1]
    assert (who.cause, who.by) == (cause, by)
    assert who.reason == "held by u1's hull" or not by
