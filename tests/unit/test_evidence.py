"""No guarantee holds on missing evidence, and no violation is reported that may only be missing messages."""

from __future__ import annotations

from collections.abc import Callable

import msgspec
import pytest

from edc_swarm.analysis.guarantees.check import check
from edc_swarm.protocol.messages import Command, Event, Fix, Message, MissionMessage, Report, Truth
from edc_swarm.recording.sequences import unknown_tails
from tests.unit.synthetic import change, close, flight, parallel, recorded

Keep = Callable[[Message], bool]

NEEDED: dict[type, set[str]] = {
    Fix: {"G1", "G2", "G3", "G4", "G5", "G7", "G8"},
    Truth: {"G3", "G4", "G5"},
    Command: {"G1", "G2", "G5"},
    Report: {"G1", "G5"},
    Event: {"G1", "G2", "G3", "G4", "G5", "G7", "G8"},
}


def statuses(messages: list[Message], run_end: dict[str, str] | None = None) -> dict[str, str]:
    """Return the status of every guarantee."""
    recording = recorded(messages)
    recording.run_end = run_end
    return {result.guarantee: result.status for result in check(recording)}


def require_no_word_without_evidence(messages: list[Message], needing: set[str]) -> None:
    """Assert that none of `needing` holds, and only G5 may be broken."""
    found = statuses(messages)
    assert {guarantee for guarantee, status in found.items() if status == "held"} & needing == set()
    assert {guarantee for guarantee, status in found.items() if status == "broken"} <= {"G5"}


@pytest.mark.parametrize("last_words", [True, False])
@pytest.mark.parametrize("kind", NEEDED)
def test_a_kind_that_is_missing_is_missed(kind: type, last_words: bool) -> None:
    """A missing kind of messages is noticed, with and without the publishers' `closed` events."""
    keep = [m for m in flight(parallel()) if not isinstance(m, kind) and (last_words or not isinstance(m, Event))]
    require_no_word_without_evidence(keep, NEEDED[kind])


@pytest.mark.parametrize("uav", ["u0", "u1", "u2"])
@pytest.mark.parametrize("kind", [Fix, Truth, Command])
def test_a_topic_that_is_missing_is_missed(kind: type, uav: str) -> None:
    """The missing messages of one kind by one UAV are noticed."""
    keep = [m for m in flight(parallel()) if not (isinstance(m, kind) and getattr(m, "uav", "") == uav)]
    require_no_word_without_evidence(keep, NEEDED[kind])


@pytest.mark.parametrize("slot", range(9))
def test_a_tail_that_is_missing_is_missed(slot: int) -> None:
    """A missing end is noticed, `closed` events included, for every order of the messages in the last slot."""
    whole = flight(parallel())
    for end, message in enumerate(whole):
        if getattr(message, "slot", -1) == slot:
            require_no_word_without_evidence(whole[:end], NEEDED[Event])


def test_only_fixes_prove_no_command_missing() -> None:
    """Commands that are not recorded may have been published."""
    keep: list[Message] = [m for m in flight(parallel()) if isinstance(m, Fix | MissionMessage)]
    require_no_word_without_evidence(keep, NEEDED[Event])


def test_a_command_of_a_killed_head_may_be_missing() -> None:
    """A killed head sent no last number; a command with a recorded number stays judged."""
    messages = flight(parallel())
    killed = Event(source="operator", sent_ns=messages[-1].sent_ns, slot=9, kind="fault", detail="kill u0 @4.4")
    messages = [m for m in messages if not isinstance(m, Event)]
    messages.append(killed)
    close(messages)
    messages = [m for m in messages if not (isinstance(m, Event) and m.source == "u0")]
    assert statuses(messages)["G2"] == "held"
    absent = [m for m in messages if not (isinstance(m, Command) and m.slot == 8)]
    absent = [m for m in absent if not (isinstance(m, Command) and m.slot == 9)]
    assert statuses(absent)["G2"] == "not-judged"
    change(messages, {"uav": "u1", "slot": 5}, Fix, command_seq=2)
    assert statuses(messages)["G2"] == "broken"


def test_the_numbers_of_a_later_process_say_nothing_about_a_killed_head() -> None:
    """u0 is killed, comes back and leads again: its commands of the first life may be missing all the same."""
    messages = flight(parallel())
    later = [
        msgspec.structs.replace(m, instance="again", term=2, slot=m.slot + 20)
        for m in messages
        if isinstance(m, Command)
    ]
    killed = Event(source="operator", sent_ns=messages[-1].sent_ns, slot=9, kind="fault", detail="kill u0 @4.4", seq=1)
    said = [*(m for m in messages if not isinstance(m, Event)), killed, *later]
    close(said)
    said = [m for m in said if not (isinstance(m, Event) and m.source == "u0" and m.instance != "again")]
    assert statuses(said)["G2"] == "held"
    found = statuses([m for m in said if not (isinstance(m, Command) and m.slot >= 8 and m.instance != "again")])
    assert (found["G2"], found["G5"]) == ("not-judged", "not-judged")


def test_g5_counts_what_the_recorder_counted() -> None:
    """Fewer messages than `run_end` counts are a loss, even without a sequence gap."""
    messages = flight(parallel())
    assert statuses(messages, {"messages": str(len(messages))})["G5"] == "held"
    assert statuses(messages, {"messages": str(len(messages) + 1)})["G5"] == "broken"
    assert statuses(messages[:1], {"messages": "520"})["G5"] == "broken"


def test_the_recorder_s_last_word_is_the_end_of_its_file() -> None:
    """It publishes no `closed` event; of a torn recording nobody knows what else it said."""
    behind = Event(source="recorder", instance="r", kind="recorder-behind", detail="1.2 s and 0 messages behind")
    recording = recorded([*flight(parallel()), behind])
    assert unknown_tails(recording) == [("event/recorder", "r")]
    recording.run_end = {"dropped": "0"}
    assert unknown_tails(recording) == []


def test_unknown_topics_are_named_in_bounds() -> None:
    """Unknown topics are escaped, shortened, and limited in number."""
    recording = recorded(flight(parallel()))
    recording.unknown = {f"\x1b[31m{number}" + "x" * 500: 2 for number in range(9)} | {"/viz/uavs": 4}
    note = next(note for result in check(recording) for note in result.notes if "unknown topics" in note)
    assert note.startswith("unknown topics: 9 with 18 messages")
    assert note.isprintable()
    assert len(note) < 600


def test_a_step_that_two_heads_ordered_alike_is_judged_by_the_granted_one() -> None:
    """A restarted UAV did not report a step, and two rival heads sent bit-identical commands for it."""
    messages = flight(parallel())
    rivals = [
        Command(
            **{name: getattr(m, name) for name in m.__struct_fields__} | {"head": "u1", "instance": "i1", "term": 2}
        )
        for m in messages
        if isinstance(m, Command) and m.uav == "u2" and m.slot == 4
    ]
    first = next(i for i, m in enumerate(messages) if isinstance(m, Command))
    messages[first:first] = rivals
    messages = [m for m in messages if not (isinstance(m, Fix | Truth) and m.uav == "u2" and m.slot == 4)]
    messages = [m for m in messages if not isinstance(m, Event)]
    for slot in range(5, 9):
        for kind in (Fix, Truth):
            change(messages, {"uav": "u2", "slot": slot}, kind, instance="i2b", seq=slot - 5)
    close(messages)
    messages = [m for m in messages if getattr(m, "instance", "") != "i2" or not isinstance(m, Event)]
    g2 = next(result for result in check(recorded(messages)) if result.guarantee == "G2")
    assert [v for v in g2.violations if v.kind == "not-granted"] == []
