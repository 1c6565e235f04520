"""The story of a recording tells what the messages show, with who is in the way, and nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest

from edc_swarm.analysis.story import Story, story_of
from edc_swarm.protocol.messages import Event, Fix, Message
from edc_swarm.recording.model import Recording
from edc_swarm.story.happening import STATES, Happening
from edc_swarm.story.teller import Storyteller
from tests.builders import at, command, entry, fix, hulls, mission_message, report, row
from tests.unit import synthetic

ROSTER = row("abc", 12.0, 40.0, energy_j=100.0)
MISSION = mission_message(ROSTER, failsafe="hold")
SLOTS = 20


def sent(uav: str, slot: int, x_m: float = 0.0, y_m: float = 0.0, **fields: Any) -> Fix:
    """Return the only fix of a slot, numbered by it."""
    basis = {"seq": slot, "sent_ns": at(slot), "instance": f"{uav}-1", "from_x_m": x_m, "from_y_m": y_m}
    return fix(uav, slot, (x_m, y_m), **{"energy_j": 90.0, **basis, **fields})


def flown(uav: str, slot: int, k: int) -> Fix:
    """Return a fix of a UAV that flies north."""
    return sent(uav, slot, 12.0 * k, 0.5 * slot + 0.5, from_y_m=0.5 * slot, executing=True)


def plans(slots: Sequence[int], **fields: Any) -> list[Message]:
    """Return reports with a quorum."""
    return [report(slot, grants=["a", "b"], **fields) for slot in slots]


def event(kind: str, slot: int, detail: str = "", source: str = "operator") -> Event:
    """Return an event."""
    return Event(source=source, slot=slot, kind=kind, detail=detail, sent_ns=at(slot))


def told(messages: Sequence[Message], mission: Any = MISSION) -> Story:
    """Return the story of these messages."""
    return story_of(Recording.from_messages([mission, *messages]))


def only(story: Story, kind: str) -> Happening:
    """Return the only happening of a kind."""
    (found,) = [happening for happening in story.happenings if happening.kind == kind]
    return found


def everyone(slots: Sequence[int], *without: str) -> list[Message]:
    """Return flights of all UAVs but some."""
    return [flown(uav, slot, k) for slot in slots for k, uav in enumerate("abc") if uav not in without]


def test_a_quiet_flight_is_take_off_and_term() -> None:
    """A mission in which nothing happens has nothing else to tell."""
    story = told([*everyone(range(SLOTS)), *plans(range(SLOTS))])
    assert sorted(happening.kind for happening in story.happenings) == ["take-off", "term"]
    assert only(story, "take-off").uavs == ["a", "b", "c"]
    assert set(b"".join(story.states)) == {STATES.index("flying")}


@pytest.mark.parametrize(
    ("detail", "kind", "words"),
    [("kill c @5", "dead", "killed"), ("freeze c @5", "frozen", "frozen"), ("heal @5", "silent", "no fix")],
)
def test_a_silence_has_the_cause_that_the_record_shows(detail: str, kind: str, words: str) -> None:
    """Without an event about the UAV its silence has no cause."""
    messages = [*everyone(range(SLOTS), "c"), *(flown("c", slot, 2) for slot in range(5)), *plans(range(SLOTS))]
    happening = only(told([*messages, event("fault", 5, detail)]), kind)
    assert (happening.uavs, happening.slot, happening.last_slot) == (["c"], 5, None)
    assert words in happening.detail


def test_what_follows_from_a_fault_stands_after_it() -> None:
    """In the slot of the fault a death has its time, and a claim and a term that at which they were sent."""
    ms = 10**6
    kills = [Event(source="operator", slot=5, kind="fault", detail=f"kill {x} @5", sent_ns=at(5) + ms) for x in "ac"]
    claim = report(5, 2, "b", status="claim", quorum=3, grants=["b", "d", "e"], sent_ns=at(5) + 2 * ms)
    term = [report(t, 2, "b", quorum=3, grants=["b", "d", "e"], sent_ns=at(t) + 3 * ms) for t in range(5, SLOTS)]
    fixes = [flown(uav, t, k) for k, uav in enumerate("abcde") for t in range(SLOTS if uav in "bde" else 5)]
    before = [report(t, quorum=3, grants=["a", "b", "c"]) for t in range(5)]
    mission = mission_message(row("abcde", 12.0, 40.0, energy_j=100.0), failsafe="hold")
    story = told([*fixes, *before, *kills, claim, *term], mission)
    assert [(each.kind, each.uavs, each.time_s) for each in story.happenings if each.slot == 5] == [
        ("fault", [], 2.501),
        ("fault", [], 2.501),
        ("dead", ["a", "c"], 2.501),
        ("claim", ["b"], 2.502),
        ("term", ["b"], 2.503),
    ]


@pytest.mark.parametrize(
    ("last", "fault", "slot", "time_s"),
    [
        (5, "kill c", 5, 2.7),
        (3, "kill c", 5, 2.7),
        (4, "kill c", 5, 2.7),
        (5, "kill c mid-step", 6, 3.0),
        (4, "kill c mid-step", 5, 2.7),
        (9, "kill c", 10, 5.0),
    ],
)
def test_slot_and_time_of_a_death_are_those_of_its_cause(last: int, fault: str, slot: int, time_s: float) -> None:
    """It is killed just after its fix, or the fix before is lost; a fault that is long over is no cause of time."""
    kill = Event(source="operator", slot=5, kind="fault", detail=f"{fault} @5", sent_ns=at(5) + 2 * 10**8)
    messages = [*everyone(range(SLOTS), "c"), *(flown("c", t, 2) for t in range(last + 1)), *plans(range(SLOTS))]
    story = told([*messages, kill])
    dead = only(story, "dead")
    assert (dead.slot, dead.time_s) == (slot, time_s)
    assert dead.detail.endswith("by a fault in slot 5")
    dead_slots = [t for t, states in enumerate(story.states) if STATES[states[2]] == "dead"]
    assert dead_slots == list(range(slot, SLOTS))


def test_a_fault_after_the_last_fix_keeps_its_slot() -> None:
    """A story ends with the last slot that has a fix, and tells there what comes after."""
    messages = [*everyone(range(6), "c"), *(flown("c", t, 2) for t in range(4)), *plans(range(6))]
    dead = only(told([*messages, event("fault", 6, "kill c @6")]), "dead")
    assert (dead.slot, dead.time_s, dead.detail) == (6, 3.0, "killed by a fault in slot 6")


@pytest.mark.parametrize(("late_s", "time_s"), [(-60.0, 2.5), (60.0, 3.0)])
def test_a_claim_is_told_in_its_slot_whatever_the_claimants_clock_says(late_s: float, time_s: float) -> None:
    """Clocks of hosts differ, and a fault can put one wrong."""
    claim = report(5, 2, "b", status="claim", grants=["b", "c"], sent_ns=at(5) + int(late_s * 1e9))
    assert only(told([*everyone(range(SLOTS)), *plans(range(5)), claim]), "claim").time_s == time_s


def test_a_process_that_leaves_the_bus_is_told_before_it_is_silent() -> None:
    """By the UAV's name, and as no more than that: its process, its host or its link may be gone."""
    messages = [*everyone(range(SLOTS), "c"), *(flown("c", slot, 2) for slot in range(6)), *plans(range(SLOTS))]
    story = told([*messages, event("off-bus", 5, "c"), event("off-bus", 5, "recorder")])
    first, other = (each for each in story.happenings if each.kind == "notice")
    assert (first.uavs, first.words) == (["c"], "c: has left the bus: its process, its host or its link")
    assert other.words.startswith("recorder has left the bus")
    assert (first.slot, only(story, "silent").slot) == (5, 6)


def test_missing_fixes_are_no_silence() -> None:
    """A UAV whose numbers show that the record lacks its fixes was not silent."""
    later = [flown("c", slot, 2) for slot in range(10, SLOTS)]
    messages = [*everyone(range(SLOTS), "c"), *(flown("c", slot, 2) for slot in range(5)), *plans(range(SLOTS))]
    story = told([*messages, *later])
    assert not {"silent", "dead", "back"} & {happening.kind for happening in story.happenings}
    assert only(story, "unknown").last_slot == 9
    assert {STATES[states[2]] for states in story.states[5:10]} == {"unknown"}
    renumbered = [fix(**{**_fields(each), "seq": each.seq - 5}) for each in later]
    assert only(told([*messages, *renumbered]), "back").slot == 10


def _fields(each: Fix) -> dict[str, Any]:
    fields = {name: getattr(each, name) for name in each.__struct_fields__}
    return {**fields, "waypoint_m": (fields.pop("waypoint_x_m"), fields.pop("waypoint_y_m"))}


def test_a_last_word_shows_that_fixes_are_missing() -> None:
    """`closed` with a later number takes a silence back."""
    messages = [*everyone(range(SLOTS), "c"), *(flown("c", slot, 2) for slot in range(5)), *plans(range(SLOTS))]
    word = Event(source="c", instance="c-1", slot=19, kind="closed", detail='{"swarm/m/uav/c/fix": 9}')
    assert only(told(messages), "silent").slot == 5
    assert only(told([*messages, word]), "unknown").slot == 5


def test_a_fix_that_the_head_lacks_is_cut_off() -> None:
    """The record has the fixes; the reports do not."""
    messages = [*everyone(range(SLOTS)), *plans(range(5)), *plans(range(5, 12), unheard=["c"]), *plans(range(12, 20))]
    happening = only(told(messages), "cut-off")
    assert (happening.uavs, happening.slot, happening.last_slot) == (["c"], 5, 11)


def held(**fields: Any) -> list[Message]:
    """Return the fixes of a UAV that stays at its start, and the flights of the others."""
    return [*everyone(range(SLOTS), "a"), *(sent("a", slot, **fields) for slot in range(SLOTS))]


def test_a_hold_without_a_command_and_without_its_evidence() -> None:
    """A gap in the numbers of the commands makes the reason unknown."""
    messages = [*held(), *plans(range(SLOTS))]
    assert only(told(messages), "holding").reason == "no-command"
    late = [command("a", 15, seq=3, instance="b-1", sent_ns=at(14))]
    reasons = [each.reason for each in told([*messages, *late]).happenings if each.kind == "holding"]
    assert reasons == ["unknown", "no-command"]
    numbered = [command("a", 15, seq=0, instance="b-1", sent_ns=at(14))]
    assert only(told([*messages, *numbered]), "holding").reason == "no-command"
    assert only(told(held()), "holding").reason == "unknown", "no command and no report at all"
    last = '{"swarm/m/head/b/command/a":12}'
    word = Event(source="b", instance="b-1", slot=20, kind="closed", detail=last, sent_ns=at(20))
    assert only(told([*messages, word]), "holding").reason == "unknown", "all commands to it are missing"


def test_a_uav_without_any_fix_is_unknown() -> None:
    """Whatever else the record holds; a record of nothing tells so too."""
    story = told([*everyone(range(SLOTS), "c"), *plans(range(SLOTS))])
    assert [(each.kind, each.uavs) for each in story.happenings if "c" in each.uavs and each.kind != "take-off"] == [
        ("unknown", ["c"])
    ]
    assert {row[2] for row in story.states} == {STATES.index("unknown")}
    (nothing,) = told([]).happenings
    assert (nothing.kind, nothing.detail) == ("unknown", "the record holds no fix of it")


def test_a_command_that_is_not_flown() -> None:
    """It came too late, or the UAV refused it."""
    orders = [command("a", slot, target_m=(0, 1), seq=slot, instance="b-1") for slot in range(SLOTS)]
    assert only(told([*held(), *orders, *plans(range(SLOTS))]), "holding").reason == "not-flown"


@pytest.mark.parametrize(
    ("place_m", "alive", "reason"),
    [((0.0, 40.0), False, "covered"), ((0.0, 10.2), False, "blocked"), ((0.0, 10.2), True, "waiting")],
)
def test_a_commanded_hold_names_who_is_in_the_way(place_m: tuple[float, float], alive: bool, reason: str) -> None:
    """A dead UAV covers the target or blocks the way; a living one is waited for."""
    roster = [entry("a", (0, 0), (0, 40)), entry("b", (50, 0), (50, 40)), entry("c", place_m, (0, 80))]
    flying = [sent("b", slot, 50.0, 0.5 * slot + 0.5, from_y_m=0.5 * slot, executing=True) for slot in range(SLOTS)]
    still = [sent("c", slot, *place_m, executing=True) for slot in range(SLOTS if alive else 2)]
    here = [sent("a", slot, executing=True) for slot in range(SLOTS)]
    place = hulls({"c": (place_m, place_m, 0.0)}) if not alive else {}
    messages = [*flying, *still, *here, *plans(range(SLOTS), head="b", **place)]
    story = told(messages, mission_message(roster, failsafe="hold"))
    holds = [each for each in story.happenings if each.kind == "holding" and each.uavs == ["a"]]
    assert (holds[-1].reason, holds[-1].by) == (reason, "c")
    assert STATES[story.states[-1][0]] == ("beside" if reason == "beside" else "holding")


def test_a_cluster_without_a_head_is_named() -> None:
    """The other cluster still has one."""
    roster = [
        entry(uav, (12 * k, 0), (12 * k, 80), cluster="east" if uav == "c" else "west") for k, uav in enumerate("abc")
    ]
    east = [report(slot, head="c", grants=["c"], quorum=1) for slot in range(SLOTS)]
    messages = [*everyone(range(SLOTS)), *plans(range(5)), *east]
    story = told(messages, mission_message(roster, clusters=2))
    assert only(story, "no-head").detail == "no head plans for cluster west since slot 5; the last was a, term 1"


def test_no_head_a_claim_and_a_new_term() -> None:
    """The head's silence, the claim and the successor, each on its message."""
    claim = report(9, 2, "b", status="claim", grants=["b", "c"])
    messages = [*everyone(range(SLOTS)), *plans(range(5)), claim, *plans(range(10, 20), term=2, head="b")]
    story = told(messages)
    assert only(story, "no-head").slot == 5
    assert only(story, "no-head").last_slot == 9
    assert only(story, "no-head").detail == "no head plans since slot 5; the last was a, term 1"
    assert only(story, "claim").uavs == ["b"]
    assert only(story, "claim").detail == "claims term 2: 2 UAVs suspecting the head"
    first = only(told([*everyone(range(SLOTS)), report(1, 1, "b", status="claim", grants=["b"])]), "claim")
    assert first.detail == "claims term 1: 1 UAV without a head", "there was none to suspect"
    assert [happening.detail for happening in story.happenings if happening.kind == "term"] == [
        "leads term 1, granted by 2 of 3",
        "leads term 2 after a, granted by 2 of 3",
    ]


def test_an_unbacked_report_elects_nobody() -> None:
    """A plan without the grants of a quorum is no plan."""
    story = told([*everyone(range(SLOTS)), *(report(slot, grants=["a"]) for slot in range(SLOTS))])
    assert "term" not in {happening.kind for happening in story.happenings}


def test_battery_arrival_landing_and_overload() -> None:
    """Each on the UAV's own word."""
    messages = [*everyone(range(SLOTS), "a"), *plans(range(SLOTS))]
    messages += [flown("a", slot, 0) for slot in range(10)]
    messages += [sent("a", slot, 0, 40, arrived=True, energy_j=15, late_ticks=slot - 9) for slot in range(10, SLOTS)]
    messages += [event("landed", 12, "no step for 10 s", "c"), event("battery-empty", 12, "", "b")]
    story = told(messages)
    assert (only(story, "arrived").slot, only(story, "battery-low").slot) == (10, 10)
    assert only(story, "battery-empty").uavs == ["b"]
    gone = told([*everyone(range(SLOTS), "b"), *(flown("b", 0, 1),), event("battery-empty", 0, "", "b")])
    assert only(gone, "silent").words == "b: its battery is empty"
    assert (only(story, "landed").uavs, STATES[story.states[-1][2]]) == (["c"], "landed")
    assert (only(story, "overload").slot, only(story, "overload").last_slot) == (10, None)


def test_the_teller_tells_live_what_the_record_tells() -> None:
    """Slot by slot, with all messages of later slots heard already, the happenings are the same."""
    messages = [*everyone(range(SLOTS), "c"), *plans(range(SLOTS)), event("fault", 5, "kill c @5")]
    teller = Storyteller(MISSION)
    for message in messages:
        teller.hear(message)
    live = [happening.kind for slot in range(SLOTS) for happening in teller.close(slot)]
    assert sorted(live) == sorted(happening.kind for happening in told(messages).happenings)
    assert "dead" in live


@pytest.mark.parametrize(
    ("detail", "words"),
    [("completed", "completed"), ("max_slots", "out of slots"), ("stalled", "stalled: nothing could change any more")],
)
def test_the_end_is_told_in_words(detail: str, words: str) -> None:
    """The event has the name of a mission field for a mission that has run out of slots."""
    slots = range(SLOTS)
    story = told([*everyone(slots), *plans(slots), event("end", SLOTS, detail)])
    assert only(story, "end").words == words


@pytest.mark.parametrize(("apart_m", "kinds"), [(11.0, []), (6.0, ["overlap"]), (0.3, ["collision", "overlap"])])
def test_overlaps_and_collisions_are_told(apart_m: float, kinds: list[str]) -> None:
    """Each pair once, in its first slot; discs of 5 m and bodies of 0.25 m that fly beside each other."""
    tracks = [synthetic.straight((0, y_m), (9, y_m), 10) for y_m in (0.0, apart_m)]
    story = story_of(synthetic.recorded(synthetic.flight(tracks)))
    found = [each for each in story.happenings if each.kind in {"overlap", "collision"}]
    assert sorted(each.kind for each in found) == kinds
    assert all((len(each.uavs), each.slot, each.level) == (2, 0, "warning") for each in found)
