"""Each checker finds one fault planted in a faultless mission, with its place and time."""

from __future__ import annotations

import math
from itertools import chain, pairwise
from typing import Any

import msgspec
import numpy as np
import pytest
from msgspec import convert

from edc_swarm.analysis import tracks
from edc_swarm.analysis.guarantees.check import check
from edc_swarm.analysis.guarantees.completeness import MAX_GARBAGE_NOTES, check_no_loss
from edc_swarm.analysis.guarantees.evidence import gather
from edc_swarm.analysis.guarantees.verdict import GuaranteeResult, Violation, headline
from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.errors import RecordingError
from edc_swarm.mission.link import Link
from edc_swarm.mission.zone import Zone
from edc_swarm.protocol.messages import Command, Event, Fix, Message, MissionMessage, Report, Truth
from edc_swarm.recording.model import Garbage
from tests.unit.synthetic import (
    EPOCH_NS,
    OFFSET_M,
    SLOT_NS,
    at,
    change,
    close,
    flight,
    parallel,
    recorded,
    straight,
    whole,
)

NOTHING_FLOWN = {"executing": False, "command_term": -1, "command_seq": -1}
ALL = ("G1", "G2", "G3", "G4", "G5", "G7")


@pytest.fixture
def messages() -> list[Message]:
    """Return the messages of three UAVs that fly north side by side, with head u0."""
    return flight(parallel())


def results(messages: list[Message]) -> dict[str, GuaranteeResult]:
    """Return the verdicts by guarantee."""
    return {result.guarantee: result for result in check(recorded(messages))}


def broken(messages: list[Message]) -> set[str]:
    """Return the broken guarantees."""
    return {guarantee for guarantee, result in results(messages).items() if result.broken}


def found(messages: list[Message], guarantee: str, kind: str) -> Violation:
    """Return the first violation of that kind."""
    return next(v for v in results(messages)[guarantee].violations if v.kind == kind)


def drop(messages: list[Message], kind: type, **fields: object) -> None:
    """Remove every message with these field values from the record."""
    messages[:] = [
        m
        for m in messages
        if not (type(m) is kind and all(getattr(m, name) == value for name, value in fields.items()))
    ]


def test_a_faultless_mission_holds_every_guarantee(messages: list[Message]) -> None:
    """A faultless mission has no violation."""
    found = {guarantee: result.status for guarantee, result in results(messages).items()}
    assert found == {**dict.fromkeys(ALL, "held"), "G8": "not-applicable"}
    assert all(not result.notes for result in results(messages).values() if result.guarantee != "G8")


def test_an_empty_record_proves_nothing() -> None:
    """An empty record gives no verdict and no violation."""
    zone = {"kind": "exclusion", "centre": [99, 99], "radius_m": 1.0}
    found = results(flight(parallel())[:1]) | {"G8": results(zoned(**zone)[:1])["G8"]}
    assert {result.status for result in found.values()} == {"not-judged"}


# --- G1 --------------------------------------------------------------------------------------


def test_g1_finds_two_heads_of_one_term(messages: list[Message]) -> None:
    """A second head's commands in the same term are a violation."""
    template = next(m for m in messages if isinstance(m, Command) and m.slot == 5)
    messages.append(msgspec.structs.replace(template, head="u1", instance="i9", seq=0, uav="u1"))
    violation = found(messages, "G1", "two-heads")
    assert violation.uavs == ["u0", "u1"]
    assert violation.slot == 4


def test_g1_finds_a_plan_without_a_quorum(messages: list[Message]) -> None:
    """The quorum follows from the mission's roster, not from the report."""
    change(messages, {"slot": 3}, Report, grants=["u0"], quorum=1)
    assert found(messages, "G1", "no-quorum").slot == 3


def test_g1_finds_grants_that_no_fix_gives(messages: list[Message]) -> None:
    """A grant in a report needs a fix of that slot; a UAV without memory grants nothing, retransmitted or not."""
    change(messages, {"uav": "u2", "slot": 3}, Fix, voter=False)
    for _ in range(2):
        violation = found(messages, "G1", "grant-without-fix")
        assert (violation.slot, violation.uavs) == (3, ["u2"])
        messages.append(next(m for m in messages if isinstance(m, Fix) and m.uav == "u2"))


def test_g1_finds_commands_to_the_unheard(messages: list[Message]) -> None:
    """Only a UAV whose fix grants the term may be commanded."""
    change(messages, {"uav": "u2", "slot": 3}, Fix, term=0, head="")
    violation = found(messages, "G1", "command-to-unheard")
    assert (violation.slot, violation.uavs) == (4, ["u2"])


def test_g1_finds_commands_without_report_or_quorum(messages: list[Message]) -> None:
    """The fixes judge a head that dies before it sends its report."""
    drop(messages, Report, slot=7)
    assert "G1" not in broken(messages)
    messages[:] = [
        msgspec.structs.replace(m, term=50, head="u2") if isinstance(m, Fix) and m.slot == 7 and m.uav != "u3" else m
        for m in messages
    ]
    assert found(messages, "G1", "no-quorum").slot == 7


def test_g1_does_not_miss_grants_that_the_record_has_lost(messages: list[Message]) -> None:
    """A message that is missing from the record breaks G5, not G1."""
    for uav in ("u1", "u2"):
        drop(messages, Fix, uav=uav, slot=7)
    assert "G1" not in broken(messages)
    assert "G5" in broken(messages)


def test_g1_finds_a_second_plan(messages: list[Message]) -> None:
    """A head may plan once per term and slot."""
    report = next(m for m in messages if isinstance(m, Report) and m.slot == 2)
    command = next(m for m in messages if isinstance(m, Command) and m.slot == 6)
    messages += [
        msgspec.structs.replace(report, seq=99),
        msgspec.structs.replace(command, seq=99, target_y_m=0.0),
    ]
    slots = {v.slot for v in results(messages)["G1"].violations if v.kind == "planned-twice"}
    assert slots == {2, 6}


def test_g1_finds_a_term_that_goes_down(messages: list[Message]) -> None:
    """The term of a UAV never decreases."""
    change(messages, {"uav": "u1", "slot": 4}, Fix, term=0, head="")
    violation = found(messages, "G1", "term-decreased")
    assert (violation.slot, violation.uavs) == (4, ["u1"])


def test_g1_finds_a_changed_grant(messages: list[Message]) -> None:
    """A UAV never changes the head that it granted in a term."""
    change(messages, {"uav": "u1", "slot": 4}, Fix, head="u2")
    kinds = [(v.kind, v.slot) for v in results(messages)["G1"].violations if v.uavs == ["u1"]]
    assert ("grant-changed", 4) in kinds
    for slot in range(4, 9):
        change(messages, {"uav": "u1", "slot": slot}, Fix, head="u2")
    changes = [v.slot for v in results(messages)["G1"].violations if v.kind == "grant-changed"]
    assert changes == [4]


def test_g1_believes_no_grant_of_a_uav_without_memory(messages: list[Message]) -> None:
    """A UAV without memory reports term 0, which is no decrease."""
    change(messages, {"uav": "u2", "slot": 8}, Fix, voter=False, term=0, head="")
    assert {v.kind for v in results(messages)["G1"].violations} == {"grant-without-fix", "command-to-unheard"}


# --- G2 --------------------------------------------------------------------------------------


def test_g2_finds_an_unpublished_command(messages: list[Message]) -> None:
    """An executed command must be in the record."""
    change(messages, {"uav": "u1", "slot": 3}, Fix, command_seq=77)
    violation = found(messages, "G2", "no-such-command")
    assert (violation.slot, violation.uavs) == (3, ["u1"])


def test_g2_finds_a_command_of_another_slot(messages: list[Message]) -> None:
    """A UAV that executes the command of an earlier slot executes it twice."""
    change(messages, {"uav": "u1", "slot": 4}, Fix, command_seq=2)
    violation = found(messages, "G2", "other-slot")
    assert (violation.slot, violation.uavs) == (4, ["u1"])
    assert "slot 3" in violation.text


def test_g2_finds_a_command_of_a_head_not_granted(messages: list[Message]) -> None:
    """The term and the head of a command are those of the grant."""
    for slot in range(20):
        change(messages, {"uav": "u1", "slot": slot}, Fix, term=1, head="u2")
    violation = found(messages, "G2", "not-granted")
    assert (violation.slot, violation.uavs) == (1, ["u1"])


def test_g2_finds_a_command_of_a_term_already_left(messages: list[Message]) -> None:
    """A newer grant before the tick discards the pending command; one within the slot does not."""
    change(messages, {"uav": "u1", "slot": 3}, Fix, term=2, head="u2")
    violations = [v for v in results(messages)["G2"].violations if v.kind == "not-granted"]
    assert [(v.slot, v.uavs) for v in violations] == [(slot, ["u1"]) for slot in range(4, 9)]


def test_g2_accepts_the_handover_slot() -> None:
    """A UAV flies the command of the old term in the slot whose fix grants the new one."""
    messages = flight(parallel(steps=3))
    for k in range(3):
        change(messages, {"uav": f"u{k}", "slot": 3}, Fix, term=2, head="u1")
    drop(messages, Report, slot=3)
    messages[:] = [m for m in messages if not (isinstance(m, Command | Event) and m.slot in {-1, 4})]
    close(messages)
    assert results(messages)["G2"].status == "held"


def test_g2_finds_a_late_command(messages: list[Message]) -> None:
    """A head sends a command before its slot begins."""
    change(messages, {"uav": "u1", "slot": 5}, Command, sent_ns=EPOCH_NS + 5 * SLOT_NS + 3_000_000)
    violation = found(messages, "G2", "late")
    assert (violation.slot, violation.uavs) == (5, ["u1"])
    assert "3.0 ms" in violation.text


@pytest.mark.parametrize(("after_ns", "status"), [(100_000_000, "held"), (100_000_001, "broken")])
def test_g2_allows_for_the_clocks_of_sender_and_receiver(after_ns: int, status: str) -> None:
    """The clocks of sender and receiver may each be off by the guard, which is mission time."""
    messages = flight(parallel(), dt_s=1.0, time_scale=2.0, guard_s=0.1)
    change(messages, {"uav": "u1", "slot": 5}, Command, sent_ns=EPOCH_NS + 5 * SLOT_NS + after_ns)
    assert results(messages)["G2"].status == status


def test_g2_finds_a_start_elsewhere(messages: list[Message]) -> None:
    """A step starts exactly at the UAV's waypoint."""
    change(messages, {"uav": "u1", "slot": 5}, Command, start_y_m=8.0 + 1e-12)
    violation = found(messages, "G2", "other-start")
    assert (violation.slot, violation.uavs) == (5, ["u1"])


def test_g2_finds_a_target_elsewhere(messages: list[Message]) -> None:
    """A step ends exactly at the commanded point."""
    change(messages, {"uav": "u1", "slot": 5}, Command, target_y_m=9.5)
    violation = found(messages, "G2", "other-target")
    assert (violation.slot, violation.value_m) == (5, pytest.approx(0.5))


def test_g2_finds_a_step_too_long() -> None:
    """No step is longer than u_max."""
    messages = flight([straight((0, 0), (0, 9), 3)])
    assert found(messages, "G2", "too-long").value_m == pytest.approx(3.0)


def test_g2_finds_a_truth_that_goes_its_own_way(messages: list[Message]) -> None:
    """The true position moves by the same vector as the disc."""
    change(messages, {"uav": "u1", "slot": 5}, Truth, to_y_m=10.0 + OFFSET_M[1] + 1e-6)
    violation = found(messages, "G2", "truth-differs")
    assert (violation.slot, violation.value_m) == (5, pytest.approx(1e-6, rel=1e-3))


def test_g2_finds_execution_without_memory(messages: list[Message]) -> None:
    """A UAV that lost its promise executes no command."""
    change(messages, {"uav": "u1", "slot": 5}, Fix, voter=False)
    assert found(messages, "G2", "without-memory").slot == 5


def test_a_fix_sent_again_in_its_slot_is_normal(messages: list[Message]) -> None:
    """A retransmitted fix with another suspicion reports the same step once more."""
    fix = next(m for m in messages if isinstance(m, Fix) and m.uav == "u1" and m.slot == 8)
    position = messages.index(fix)
    messages.insert(position + 1, msgspec.structs.replace(fix, suspects=True, seq=9))
    detail = '{"uav/u1/fix":9,"uav/u1/truth":8}'
    change(messages, {"instance": "i1"}, Event, detail=detail)
    assert broken(messages) == set()
    change(messages, {"uav": "u1", "slot": 8}, Fix, command_seq=77)
    assert [v.kind for v in results(messages)["G2"].violations] == ["no-such-command"]


def test_of_two_commands_with_one_number_the_one_obeyed_is_judged(messages: list[Message]) -> None:
    """A restarted head counts its commands from 0 again, so two commands can have one number."""
    command = next(m for m in messages if isinstance(m, Command) and m.uav == "u1" and m.slot == 5)
    rival = msgspec.structs.replace(command, instance="i0b", target_y_m=command.start_y_m)
    messages.insert(messages.index(command), rival)
    assert not results(messages)["G2"].broken


# --- a hole in the record ---------------------------------------------------------------------


def detour_with_a_hole() -> list[Message]:
    """Return messages of u0 flying round u1, without those of slots 2 to 6; the straight line would meet u1."""
    corners = [(0.0, 0.0), (0.0, 40.0), (60.0, 40.0), (60.0, 0.0)]
    legs = [straight(a, b, 3)[:-1] for a, b in pairwise(corners)]
    messages = flight([[*chain(*legs), corners[-1]], [(30.0, 20.0)] * 10], v_max_mps=100.0)
    return [m for m in messages if not 2 <= getattr(m, "slot", 0) <= 6]


def test_nobody_is_accused_of_what_the_record_has_lost() -> None:
    """A frozen recorder breaks G5 and nothing else, and no metric counts a collision."""
    messages = detour_with_a_hole()
    assert broken(messages) == {"G5"}
    metrics = compute_metrics(recorded(messages))
    assert (metrics.potential_collisions, metrics.true_collisions, metrics.min_disc_gap_m) == (None, None, None)


def test_a_command_that_the_record_has_lost_was_published(messages: list[Message]) -> None:
    """A command whose number is in a sequence gap was published; one with a number beyond every gap was not."""
    drop(messages, Command, uav="u1", seq=4)
    assert broken(messages) == {"G5"}
    for uav, slot, seq in (("u1", 5, 400), ("u1", 8, 2), ("u2", 8, 4)):
        wrong = list(messages)
        change(wrong, {"uav": uav, "slot": slot}, Fix, command_seq=seq)
        assert broken(wrong) == {"G2", "G5"}


def test_a_jump_is_found_where_nothing_was_lost() -> None:
    """A slot without a fix and without a sequence gap counts as silence of the UAV."""
    messages = detour_with_a_hole()
    for slot in range(7, 10):
        for kind in (Fix, Truth):
            change(messages, {"uav": "u0", "slot": slot}, kind, seq=slot - 5)
    assert {"G3", "G4"} <= broken(messages)


def test_around_a_hole_everything_is_judged() -> None:
    """Discs that overlap just before or just after a gap are found."""
    for slot in (1, 7):
        messages = detour_with_a_hole()
        change(messages, {"uav": "u0", "slot": slot}, Fix, waypoint_x_m=30.0, waypoint_y_m=25.0)
        assert "G3" in broken(messages)


# --- silent steps: accepted, then nothing said ------------------------------------------------


def died_in_slot_4() -> list[Message]:
    """Return messages of u2 that accepts its step of slot 4, dies before its fix, and holds from slot 6 on."""
    paths = parallel()
    paths[2] = [*paths[2][:5], *[paths[2][4]] * 10]
    messages = flight(paths)
    for slot in (4, 5):
        drop(messages, Fix, uav="u2", slot=slot)
        drop(messages, Truth, uav="u2", slot=slot)
    for slot in range(6, 20):
        instance = {"instance": "i2b", "seq": slot - 6}
        change(messages, {"uav": "u2", "slot": slot}, Fix, executing=False, command_term=-1, command_seq=-1, **instance)
        change(messages, {"uav": "u2", "slot": slot}, Truth, **instance)
    drop(messages, Event, instance="i2")
    close_successor(messages)
    return messages


def close_successor(messages: list[Message]) -> None:
    """Add the `closed` event of the process that followed u2's first one, which sent none."""
    close(messages)
    drop(messages, Event, instance="i2")


def test_a_step_accepted_in_silence_is_found_in_the_commands() -> None:
    """The next fix shows that the step was flown, and the command explains it."""
    messages = died_in_slot_4()
    change(messages, {"uav": "u2", "slot": 6}, Command, target_y_m=9.0)
    verdicts = results(messages)
    assert verdicts["G2"].status == "held"
    assert verdicts["G4"].status == "held"


def test_a_step_accepted_in_silence_needs_a_command() -> None:
    """A move without any command is a violation; where the numbers show that a command is missing it is none."""
    messages = died_in_slot_4()
    drop(messages, Command, uav="u2", slot=4)
    assert broken(messages) == {"G5"}
    violation = found(whole(messages), "G4", "moved-without-command")
    assert (violation.slot, violation.uavs, violation.value_m) == (6, ["u2"], pytest.approx(2.0))


def test_a_silent_step_must_obey_the_grant_too() -> None:
    """A step without a fix must obey the UAV's grant."""
    messages = died_in_slot_4()
    change(messages, {"uav": "u2", "slot": 3}, Fix, term=2, head="u1")
    assert [(v.slot, v.uavs) for v in results(messages)["G2"].violations if v.kind == "not-granted"] == [(4, ["u2"])]


def test_a_silent_step_is_judged_by_what_was_granted_before_it() -> None:
    """A newer grant after a step changes nothing; without any fix there is no grant."""
    messages = died_in_slot_4()
    for slot in range(6, 20):
        change(messages, {"uav": "u2", "slot": slot}, Fix, term=2, head="u1")
    assert results(messages)["G2"].held
    for slot in range(4):
        drop(messages, Fix, uav="u2", slot=slot)
        drop(messages, Truth, uav="u2", slot=slot)
    assert {v.slot for v in results(messages)["G2"].violations if v.kind == "not-granted"} == {1, 2, 3, 4}


def test_a_silent_step_must_be_valid_too() -> None:
    """A step without a fix is invalid if its command was sent too late."""
    messages = died_in_slot_4()
    change(messages, {"uav": "u2", "slot": 4}, Command, sent_ns=EPOCH_NS + 4 * SLOT_NS + 1)
    assert found(messages, "G2", "late").slot == 4


def test_the_truth_tells_of_a_last_step() -> None:
    """A UAV with an empty battery publishes a truth without a fix; the truth decides which of two commands it flew."""
    messages = flight(parallel())
    for slot in range(4, 20):
        drop(messages, Fix, uav="u2", slot=slot)
    for slot in range(5, 20):
        drop(messages, Truth, uav="u2", slot=slot)
    command = next(m for m in messages if isinstance(m, Command) and m.uav == "u2" and m.slot == 4)
    messages.insert(1, msgspec.structs.replace(command, target_y_m=6.5, head="u1", instance="i1", seq=0))
    drop(messages, Event)
    close(messages)
    verdicts = results(messages)
    assert not verdicts["G2"].broken
    assert verdicts["G4"].status == "held"
    drop(messages, Command, uav="u2", slot=4)
    assert found(messages, "G4", "truth-moved").slot == 4


def forgot_after_slot_4(back: int) -> list[Message]:
    """Return messages of u2 that accepts its step of slot 4, dies unheard, and has no memory from slot `back` on."""
    paths = parallel()
    paths[2] = [*paths[2][:5], *[paths[2][4]] * 10]
    messages = flight(paths)
    for slot in range(4, back):
        drop(messages, Fix, uav="u2", slot=slot)
        drop(messages, Truth, uav="u2", slot=slot)
    (x_m, y_m), (ox_m, oy_m) = paths[2][4], OFFSET_M
    here = {"from_x_m": x_m + ox_m, "from_y_m": y_m + oy_m, "to_x_m": x_m + ox_m, "to_y_m": y_m + oy_m}
    for slot in range(back, 20):
        instance = {"instance": "i2b", "seq": slot - back}
        change(messages, {"uav": "u2", "slot": slot}, Fix, **NOTHING_FLOWN, **instance, voter=False, term=0, head="")
        change(messages, {"uav": "u2", "slot": slot}, Truth, **here, **instance)
    drop(messages, Event, instance="i2")
    close_successor(messages)
    messages[:] = [m for m in messages if not (isinstance(m, Command) and m.uav == "u2" and m.slot > 5)]
    return messages


@pytest.mark.parametrize("back", [4, 5, 6])
def test_the_truth_tells_of_a_step_that_was_forgotten(back: int) -> None:
    """After a loss of memory the truth is one commanded step further, so the disc has moved by that step."""
    messages = forgot_after_slot_4(back)
    verdicts = results(messages)
    assert [verdicts[guarantee].where for guarantee in ("G2", "G3", "G4")] == [[], [], []]
    drop(messages, Command, uav="u2", slot=4)
    assert "G4" in broken(messages)


def test_one_and_the_same_process_cannot_forget_a_step() -> None:
    """Without a restart, a jump of the truth is a violation."""
    messages = forgot_after_slot_4(back=4)
    change(messages, {"uav": "u2", "instance": "i2b"}, Truth, instance="i2")
    assert found(messages, "G4", "truth-jumped").slot == 4


def test_two_truths_of_one_slot_are_one_motion(messages: list[Message]) -> None:
    """A UAV reports its step, dies, and returns in the same slot without memory, holding."""
    truth = next(m for m in messages if isinstance(m, Truth) and m.uav == "u2" and m.slot == 8)
    held = {"from_x_m": truth.to_x_m, "from_y_m": truth.to_y_m, "instance": "i2b", "seq": 0}
    messages.append(msgspec.structs.replace(truth, **held))
    close(messages)
    assert results(messages)["G2"].held
    assert results(messages)["G4"].held
    drop(messages, Truth, instance="i2b")
    messages.append(truth)
    messages[-1] = msgspec.structs.replace(truth, **{**held, "to_x_m": truth.to_x_m + 0.5})
    assert found(messages, "G2", "truth-differs").value_m == pytest.approx(0.5)


def test_a_truth_that_was_still_to_be_said_is_no_lie(messages: list[Message]) -> None:
    """A UAV reports its step and dies before its truth; its successor starts at the end of that step."""
    truth = next(m for m in messages if isinstance(m, Truth) and m.uav == "u2" and m.slot == 8)
    there = {"from_x_m": truth.to_x_m, "from_y_m": truth.to_y_m, "instance": "i2b", "seq": 0}
    messages[messages.index(truth)] = msgspec.structs.replace(truth, **there)
    drop(messages, Event, instance="i2")
    close_successor(messages)
    assert results(messages)["G2"].held
    assert results(messages)["G4"].held
    elsewhere = {"from_x_m": truth.to_x_m + 0.5, "to_x_m": truth.to_x_m + 0.5}
    change(messages, {"uav": "u2", "instance": "i2b"}, Truth, **elsewhere)
    assert found(messages, "G4", "truth-jumped").value_m == pytest.approx(0.5)


# --- G3 --------------------------------------------------------------------------------------


def test_g3_finds_discs_that_overlap_between_slot_ends() -> None:
    """Two UAVs that swap places within a slot are apart at both ends of it."""
    paths = [
        straight((0, 0), (12, 0), 1),
        straight((12, 0.4), (0, 0.4), 1),
        straight((100, 0), (100, 1), 1),
    ]
    messages = flight(paths, planner="straight", v_max_mps=30.0)
    violation = found(messages, "G3", "overlap")
    assert (violation.slot, violation.uavs) == (1, ["u0", "u1"])
    assert violation.time_s == pytest.approx(0.75)
    assert violation.value_m == pytest.approx(9.6)
    assert found(messages, "G3", "true-collision").value_m == pytest.approx(0.1)


def test_g3_counts_slots_of_an_overlap_once_per_pair() -> None:
    """Each pair is one violation, with its first slot and its greatest depth."""
    messages = flight([straight((0, 0), (0, 20), 10), straight((9, 20), (9, 0), 10)], planner="straight")
    overlaps = [v for v in results(messages)["G3"].violations if v.kind == "overlap"]
    assert len(overlaps) == 1
    assert overlaps[0].value_m == pytest.approx(1.0)
    assert overlaps[0].slot == 4
    assert "slots in all" in overlaps[0].text


def test_g3_tells_every_pair_once() -> None:
    """Three overlapping UAVs are three pairs, and an overlap is not reported as uneven too."""
    messages = flight([[point] * 2 for point in ((0.0, 0.0), (9.0, 0.0), (4.0, 8.0))])
    pairs = [(v.kind, *v.uavs) for v in results(messages)["G3"].violations]
    assert pairs == [("overlap", "u0", "u1"), ("overlap", "u0", "u2"), ("overlap", "u1", "u2")]
    assert compute_metrics(recorded(messages)).potential_collisions == len(pairs)


def test_discs_that_touch_are_disjoint(messages: list[Message]) -> None:
    """A gap of 0 between discs or bodies is no overlap, in G3 and in the metrics."""
    messages = flight([[(0.0, 0.0)] * 2, [(10.0, 0.0)] * 2])
    change(messages, {"uav": "u0"}, Truth, from_x_m=4.75, from_y_m=0.0, to_x_m=4.75, to_y_m=0.0)
    change(messages, {"uav": "u1"}, Truth, from_x_m=5.25, from_y_m=0.0, to_x_m=5.25, to_y_m=0.0)
    assert results(messages)["G3"].status == "held"
    metrics = compute_metrics(recorded(messages))
    assert (metrics.potential_collisions, metrics.true_collisions) == (0, 0)


def test_g3_finds_a_body_that_leaves_its_disc(messages: list[Message]) -> None:
    """The whole body must be in the disc, and the first slot outside is reported."""
    for slot in range(3, 20):
        change(messages, {"uav": "u2", "slot": slot}, Truth, to_x_m=24.0 + 4.8, to_y_m=at(parallel()[2], slot)[1])
    violation = found(messages, "G3", "outside-disc")
    assert (violation.slot, violation.uavs, violation.value_m) == (3, ["u2"], pytest.approx(0.05))


def test_g3_covers_the_dead_where_they_are() -> None:
    """A silent UAV still counts as an obstacle."""
    messages = flight([straight((0, 0), (30, 0), 15), [(20, 0), (20, 0)]], planner="straight")
    for slot in range(2, 30):
        drop(messages, Fix, uav="u1", slot=slot)
        drop(messages, Truth, uav="u1", slot=slot)
    drop(messages, Event)
    close(messages)
    assert found(messages, "G3", "overlap").slot == 6


def test_g3_finds_ways_that_are_only_safe_when_flown_together() -> None:
    """With `edc`, steps must be safe for any uneven execution."""
    paths = [straight((0, 0), (0.4, 0), 1), straight((10.5, 0), (12.5, 0), 1)]
    assert "G3" not in broken(flight(paths))
    crossing = [straight((0, 0), (8, 0), 1), straight((10.5, 0), (18.5, 0), 1)]
    fast: dict[str, Any] = {"v_max_mps": 20.0}
    violation = found(flight(crossing, **fast), "G3", "uneven")
    assert (violation.slot, violation.uavs, violation.value_m) == (1, ["u0", "u1"], pytest.approx(7.5))
    assert "G3" not in broken(flight(crossing, planner="straight", **fast))


def test_g3_with_lag_looks_one_slot_back() -> None:
    """With `lag_slots` a UAV may still fly the step of the previous slot."""
    paths = [straight((0, 0), (2, 0), 1, wait=2), straight((10.5, 0), (14, 0), 2, wait=1)]
    assert "G3" not in broken(flight(paths, lag_slots=0, v_max_mps=4.0))
    for order in (paths, paths[::-1]):
        violation = found(flight(order, lag_slots=1, v_max_mps=4.0), "G3", "uneven")
        assert (violation.slot, violation.uavs, violation.value_m) == (2, ["u0", "u1"], pytest.approx(1.5))
    crossing = [straight((0, 0), (8, 0), 1), straight((10.5, 0), (18.5, 0), 1), [(0.0, 50.0)] * 4]
    assert found(flight(crossing, lag_slots=1, v_max_mps=20.0), "G3", "uneven").slot == 1


def test_g3_finds_bodies_that_meet(messages: list[Message]) -> None:
    """True positions are judged by the radii of the bodies, at every instant."""
    for slot in range(20):
        fix = at(parallel()[0], slot)
        change(messages, {"uav": "u1", "slot": slot}, Truth, from_x_m=0.9, from_y_m=fix[1], to_x_m=0.9, to_y_m=fix[1])
    violation = found(messages, "G3", "true-collision")
    assert (violation.slot, violation.uavs) == (0, ["u0", "u1"])
    assert found(messages, "G3", "outside-disc").uavs == ["u1"]


# --- G4 --------------------------------------------------------------------------------------


def test_g4_finds_a_move_without_a_command(messages: list[Message]) -> None:
    """A UAV that reports a hold stays exactly at its waypoint."""
    change(messages, {"uav": "u2", "slot": 6}, Fix, executing=False, command_term=-1, command_seq=-1)
    violation = found(messages, "G4", "moved-without-command")
    assert (violation.slot, violation.uavs, violation.value_m) == (6, ["u2"], pytest.approx(2.0))
    assert found(messages, "G4", "truth-moved").slot == 6
    change(messages, {"uav": "u2", "slot": 6}, Fix, waypoint_y_m=10.0 + 1e-12)
    assert found(messages, "G4", "moved-without-command").value_m == pytest.approx(1e-12, rel=1e-2)


def test_g4_finds_a_truth_that_jumps_between_slots(messages: list[Message]) -> None:
    """The true position at the end of a slot is that at the start of the next one."""
    for slot, expected in ((6, [6, 7]), (0, [1, 6, 7])):
        change(messages, {"uav": "u2", "slot": slot}, Truth, from_x_m=24.5 + 1e-3, to_x_m=24.5 + 1e-3)
        assert [v.slot for v in results(messages)["G4"].violations if v.kind == "truth-jumped"] == expected


def test_g4_trusts_no_waypoint_of_a_uav_without_memory(messages: list[Message]) -> None:
    """The disc of a UAV without memory stays at its last place, for any waypoint in its fixes."""
    for slot in range(9, 20):
        drop(messages, Fix, uav="u2", slot=slot)
    last = next(m for m in messages if isinstance(m, Fix) and m.uav == "u2" and m.slot == 8)
    lost = msgspec.structs.replace(
        last, instance="i2b", seq=0, slot=9, voter=False, executing=False, waypoint_x_m=0.0, waypoint_y_m=0.0
    )
    messages.append(lost)
    close(messages)
    verdicts = results(messages)
    assert verdicts["G3"].held
    assert verdicts["G4"].held


# --- G5 --------------------------------------------------------------------------------------


def test_g5_finds_a_hole(messages: list[Message]) -> None:
    """A sequence gap breaks G5, and the other verdicts note it."""
    drop(messages, Fix, uav="u1", slot=3)
    result = results(messages)["G5"]
    assert [v.text for v in result.violations] == ["uav/u1/fix of i1: messages 3 to 3 are missing (1)"]
    assert any("gaps" in note for note in results(messages)["G1"].notes)


def test_g5_finds_a_missing_beginning_and_end(messages: list[Message]) -> None:
    """A stream starts at number 0 and ends at the number in the `closed` event."""
    drop(messages, Truth, uav="u1", slot=0)
    drop(messages, Truth, uav="u2", slot=8)
    texts = results(messages)["G5"].where
    assert texts == [
        "uav/u1/truth of i1: messages 0 to 0 are missing (1)",
        "uav/u2/truth of i2: messages 8 to 8 are missing (1)",
    ]


def test_g5_finds_a_stream_that_is_missing_altogether(messages: list[Message]) -> None:
    """A key without any recorded message is missed by the `closed` event of its publisher."""
    messages[:] = [m for m in messages if not (isinstance(m, Truth) and m.uav == "u1")]
    assert "messages 0 to 8" in results(messages)["G5"].where[0]


def test_g5_finds_a_duplicate(messages: list[Message]) -> None:
    """A number that is recorded twice breaks G5."""
    first = next(m for m in messages if isinstance(m, Fix))
    messages.append(msgspec.structs.replace(first, x_m=first.x_m + 1.0))
    assert results(messages)["G5"].violations[0].kind == "duplicate"


def test_g5_names_unknown_tails(messages: list[Message]) -> None:
    """Without a `closed` event G5 is not judged, unless the publisher was killed."""
    drop(messages, Event, instance="i2")
    result = results(messages)["G5"]
    assert result.status == "not-judged"
    assert result.notes[0] == "no `closed` event of u2, and no recorded fault that ended it"
    note = result.notes[1]
    killed = Event(source="operator", sent_ns=EPOCH_NS + 9 * SLOT_NS, slot=9, kind="fault", detail="kill u2 @9", seq=0)
    drop(messages, Event, instance="")
    messages = [*messages, msgspec.structs.replace(killed, kind="closed", detail='{"mission":0}', seq=1)]
    assert results([*messages, killed])["G5"].notes == [note]
    assert results([*messages, killed])["G5"].words == "held, up to the last recorded message of u2"
    assert headline(list(results([*messages, killed]).values())).endswith(" (G5 up to the last recorded message of u2)")
    assert note.startswith("end unknown: the last messages on uav/u2/fix and 1 more may be missing")
    assert note.endswith("of i2")
    drop(messages, Truth, uav="u2")
    drop(messages, Event, instance="")
    words = "end unknown: the last messages on "
    notes = [note.removeprefix(words).split(" may be missing")[0] for note in results(messages)["G5"].notes[1:]]
    assert notes == ["mission", "uav/u2/fix", "the record ends at slot 8, without the end of the mission"]


@pytest.mark.parametrize(("slot", "status"), [(0, "held"), (9, "not-judged")])
def test_g5_does_not_hold_up_to_a_message_that_nobody_has(messages: list[Message], slot: int, status: str) -> None:
    """A UAV that lived for nine slots before its kill has spoken; one that was killed at the start may not have."""
    drop(messages, Event, instance="i2")
    drop(messages, Event, instance="")
    messages = [m for m in messages if not isinstance(m, (Fix, Truth)) or m.uav != "u2"]
    change(messages, {}, Report, grants=["u0", "u1"])
    at_ns = EPOCH_NS + slot * SLOT_NS
    killed = Event(source="operator", sent_ns=at_ns, slot=slot, kind="fault", detail=f"kill u2 @{slot}", seq=0)
    closed = msgspec.structs.replace(killed, kind="closed", detail='{"mission":0}', seq=1)
    result = results([*messages, killed, closed])["G5"]
    assert result.status == status
    if status == "not-judged":
        assert result.notes[0] == "no message of a process of u2 that lived for so long that it has spoken"


def test_g5_says_of_which_process_the_end_is_cut(messages: list[Message]) -> None:
    """u2 is killed and started again: what its first process said last is cut, not what its second one said."""
    at_ns = EPOCH_NS + 9 * SLOT_NS
    last = next(m for m in reversed(messages) if isinstance(m, Fix) and m.uav == "u2")
    holds = {"executing": False, "command_term": -1, "command_seq": -1}
    again = msgspec.structs.replace(last, instance="i2b", seq=0, slot=9, sent_ns=at_ns + 2_000_000, **holds)
    messages += [
        Event(source="operator", instance="op", sent_ns=at_ns, slot=9, kind="fault", detail="restart u2 @9", seq=0),
        again,
        Event(source="operator", instance="op", sent_ns=again.sent_ns + 1, slot=9, kind="closed", detail="{}", seq=1),
    ]
    close(messages)
    drop(messages, Event, instance="i2")
    assert results(messages)["G5"].words == "held, up to the last recorded message of each killed process of u2"


def test_g5_reports_what_cannot_be_read(messages: list[Message]) -> None:
    """A torn file breaks G5."""
    recording = recorded(messages)
    recording.problems.append("torn: 3 bytes are unreadable")
    result = next(r for r in check(recording) if r.guarantee == "G5")
    assert [v.kind for v in result.violations] == ["unreadable"]


def test_g5_excuses_what_was_dropped_and_is_there_again(messages: list[Message]) -> None:
    """Dropped messages are a note if every stream is complete by its numbers."""
    recording = recorded(messages)
    recording.run_end = {"dropped": "7"}
    result = next(r for r in check(recording) if r.guarantee == "G5")
    assert result.held
    assert "the recorder dropped 7 messages" in result.notes[0]


@pytest.mark.parametrize(("kind", "fields"), [(Event, {"instance": "i2"}), (Fix, {"seq": 2})], ids=["tail", "gap"])
def test_g5_reports_what_was_dropped_and_cannot_be_proved(
    messages: list[Message], kind: type, fields: dict[str, Any]
) -> None:
    """Dropped messages break G5 if a `closed` event or a message is missing."""
    drop(messages, kind, **fields)
    recording = recorded(messages)
    recording.run_end = {"dropped": "7"}
    result = next(r for r in check(recording) if r.guarantee == "G5")
    assert "dropped" in [v.kind for v in result.violations]


def test_g5_notes_what_is_no_message(messages: list[Message]) -> None:
    """Garbage is noted by topic and reason, within a limit, with the number of foreign messages left out."""
    recording = recorded(messages)
    recording.garbage += [Garbage("/a", 0, "torn"), Garbage("/b", 0, "torn"), Garbage("/a", 0, "torn")]
    recording.run_end = {"foreign_left_out": "7"}
    left_out = "left out: 7 messages on foreign keys"
    kinds = ["not a message: /a (torn), 2 times", "not a message: /b (torn)"]
    assert check_no_loss(gather(recording)).notes == [*kinds, left_out]
    recording.garbage += [Garbage(f"/{number}", 0, "torn") for number in range(MAX_GARBAGE_NOTES - 2)]
    assert len(check_no_loss(gather(recording)).notes) == MAX_GARBAGE_NOTES + 1
    recording.garbage.append(Garbage("/c", 0, "torn"))
    notes = check_no_loss(gather(recording)).notes
    recording.run_end = None
    assert check_no_loss(gather(recording)).status == "held"
    assert compute_metrics(recording).fetched is None
    assert notes[MAX_GARBAGE_NOTES:] == [left_out, f"not messages: {MAX_GARBAGE_NOTES + 2} in all, 21 kinds of them"]


# --- G7 --------------------------------------------------------------------------------------


LIMIT = 201
"""Slots after which G7 judges the missions below: 200, and one for a way that is a step long."""


def unfinished(slots: int = LIMIT, **fields: Any) -> list[Message]:
    """Return messages of u2 that stops half-way, in a record of `slots` slots."""
    paths = [[*path, *[path[-1]] * (slots - len(path))] for path in parallel()]
    messages = flight(paths, **{"v_max_mps": 1e4, "max_slots": 1000, **fields})
    mission = messages[0]
    assert isinstance(mission, MissionMessage)
    far = msgspec.structs.replace(mission.roster[2], target_y_m=40.0)
    messages[0] = msgspec.structs.replace(mission, roster=[*mission.roster[:2], far])
    return messages


def progress(messages: list[Message]) -> GuaranteeResult:
    """Return the verdict on G7."""
    return results(messages)["G7"]


def ended(detail: str, source: str = "operator") -> Event:
    """Return the event that ends a mission."""
    return Event(source=source, slot=8, kind="end", detail=detail)


def test_g7_finds_who_has_not_arrived() -> None:
    """Every living UAV is at its target within the limit."""
    violation = found(unfinished(), "G7", "not-arrived")
    assert (violation.slot, violation.uavs, violation.value_m) == (LIMIT - 1, ["u2"], pytest.approx(24.0))


def test_g7_needs_a_record_that_is_long_enough() -> None:
    """A record that ends before the limit proves nothing, for any `max_slots`."""
    for max_slots, given in ((1000, ""), (5, " (max_slots = 5 was given)")):
        result = progress(unfinished(LIMIT - 1, max_slots=max_slots))
        assert (result.status, result.notes) == ("not-judged", [f"stopped after 200 slots{given}, before slot 201"])
        assert progress(unfinished(LIMIT, max_slots=max_slots)).status == "broken"
    bare = unfinished()
    drop(bare, Fix)
    assert (progress(bare).status, progress(bare).notes[-1]) == ("not-judged", "the record has no fixes")


@pytest.mark.parametrize(
    ("fields", "settled"),
    [
        ({"fault": ["partition halves @2 for 3"]}, 5),
        ({"fault": ["partition halves @2", "heal @1", "heal @4"]}, 4),
        ({"fault": ["freeze u0 @2 for 2s"]}, 6),
        ({"fault": ["gps u1 white @3"]}, 3),
        ({"link": [Link(loss=0.9, end_s=3.0)]}, 6),
    ],
)
def test_g7_counts_anew_from_the_last_fault(fields: dict[str, object], settled: int) -> None:
    """The limit starts at the end of the last fault."""
    assert progress(unfinished(LIMIT + settled - 1, **fields)).status == "not-judged"
    assert progress(unfinished(LIMIT + settled, **fields)).status == "broken"


def test_g7_counts_from_the_faults_that_were_told() -> None:
    """Faults in events count too, also if the mission did not announce them or they came late."""
    told = Event(source="operator", slot=6, kind="fault", detail="link *>* loss 0.5 @6 for 1")
    for slots, status in ((LIMIT + 6, "not-judged"), (LIMIT + 7, "broken")):
        for planned in ([], ["link *>* loss 0.5 @6 for 1"]):
            assert progress([*unfinished(slots, fault=planned), told]).status == status
    late = Event(source="operator", slot=9, kind="fault", detail="gps u1 white @6")
    for slots, status in ((LIMIT + 9, "not-judged"), (LIMIT + 10, "broken")):
        assert progress([*unfinished(slots, fault=["gps u1 white @6"]), late]).status == status


def test_g7_judges_a_stalled_mission_as_it_stands() -> None:
    """A stalled mission is judged as it stands, by the operator's event only."""
    for event, status in (
        (ended("stalled"), "broken"),
        (ended("max_slots"), "not-judged"),
        (ended("stalled", source="u1"), "not-judged"),
    ):
        assert progress([*unfinished(20, fault=["gps u1 white @1"]), event]).status == status


def test_g7_judges_a_lossy_network_after_a_longer_limit() -> None:
    """With half of the messages lost for good, a third of the commands come in time."""
    for fields in ({"link": [Link(loss=0.5)]}, {"fault": ["link *>* loss 0.5 @0"]}):
        for slots, status in ((3 * LIMIT - 1, "not-judged"), (3 * LIMIT, "broken")):
            assert progress(unfinished(slots, **fields)).status == status


@pytest.mark.parametrize(
    ("fields", "why"),
    [
        ({"link": [Link(loss=0.9)]}, "the link *>* loses or delays 90 % of its messages for good"),
        ({"fault": ["slow u0 900 @2"]}, "'slow u0 900 @1s' leaves no time for a plan, for good"),
        ({"fault": ["partition u2>rest @2"]}, "'partition u2>rest @1s' never heals, and cuts off some links of a side"),
    ],
)
def test_g7_promises_nothing_after_some_faults_for_good(fields: dict[str, Any], why: str) -> None:
    """The verdict names such faults if they happened; a UAV that arrived anyway counts as arrived."""
    result = progress(unfinished(**fields))
    assert (result.status, result.notes[0][: len(why)]) == ("not-applicable", why)
    assert progress(flight(parallel(), **fields)).status == "held"
    late = [text.replace("@2", "@900") for text in fields.get("fault", [])]
    if late:
        assert progress(unfinished(fault=late)).status == "not-judged"


def test_g7_takes_faults_as_they_were_told() -> None:
    """Faults in events have ids for roles; a fault without a target did not happen."""
    planned = {"fault": ["partition head|rest @2"]}
    assert progress(unfinished(LIMIT + 2, **planned)).status == "not-applicable"
    told = Event(source="operator", slot=2, kind="fault", detail="partition u0|u1,u2 @1s")
    assert progress([*unfinished(LIMIT + 3, **planned), told]).status == "broken"
    aimless = Event(source="operator", slot=2, kind="fault-without-target", detail="partition head|rest @1s")
    assert progress([*unfinished(LIMIT, **planned), aimless]).status == "broken"
    garbled = Event(source="operator", slot=2, kind="fault", detail="partition of india @1s")
    assert progress([*unfinished(LIMIT + 3), garbled]).status == "broken"


def test_g7_after_a_partition_for_good() -> None:
    """G7 applies to the side with a quorum, and notes the other UAVs."""
    cut = {"fault": ["partition u2|rest @2"]}
    alone = progress(unfinished(LIMIT + 2, **cut))
    excuse = "u2 need not arrive: a partition that never heals cuts it off from the quorum"
    assert (alone.status, alone.notes) == ("held", [excuse])
    cut = {"fault": ["partition u0|rest @2"]}
    assert progress(unfinished(LIMIT + 2, **cut)).status == "broken"
    split = progress(unfinished(LIMIT + 2, fault=["partition u0|rest @2", "partition u1|u2 @2"]))
    assert split.status == "not-applicable"
    assert "larger side" in split.notes[0]


def test_g7_excuses_the_dead() -> None:
    """A killed UAV need not arrive, and without a living quorum no UAV need."""
    messages = unfinished(20)
    for uav in ("u2", "u1"):
        messages.append(Event(source="operator", slot=20, kind="fault", detail=f"kill {uav} @20"))
        expected = {"u2": "held", "u1": "not-applicable"}[uav]
        assert results(messages)["G7"].status == expected


def dead(uav: str) -> Event:
    """Return the event of a kill in the last slot of the missions above."""
    return Event(source="operator", slot=LIMIT - 1, kind="fault", detail=f"kill {uav} @0")


def test_g7_does_not_take_empty_batteries_for_an_excuse() -> None:
    """An empty battery within the limit prevents a verdict; after the limit the UAV is late."""
    for slots, slot, status in ((LIMIT, LIMIT - 1, "not-judged"), (LIMIT + 1, LIMIT, "broken")):
        empty = [Event(source=uav, slot=slot, kind="battery-empty") for uav in ("u0", "u1", "u2")]
        assert progress([*unfinished(slots), *empty]).status == status, "also if no quorum is left"
    assert progress([*unfinished(LIMIT), empty[0]]).status == "broken"
    assert progress([*flight(parallel()), *empty]).status == "held", "all were there"
    early = progress([*unfinished(40), msgspec.structs.replace(empty[2], slot=39)])
    assert early.notes == ["empty batteries before slot 201: u2"]
    without_quorum = [*unfinished(40), *(msgspec.structs.replace(event, slot=39) for event in empty[:2])]
    assert progress([*without_quorum, ended("stalled")]).notes == ["empty batteries before slot 201: u0, u1"]


def test_g7_excuses_targets_that_a_dead_uav_covers() -> None:
    """A UAV need not arrive at a target below a dead UAV."""
    messages = unfinished(LIMIT)
    mission = messages[0]
    assert isinstance(mission, MissionMessage)
    onto = msgspec.structs.replace(mission.roster[1], target_x_m=24.0 - 9.9, target_y_m=16.0)
    messages[0] = msgspec.structs.replace(mission, roster=[mission.roster[0], onto, mission.roster[2]])
    assert progress(messages).status == "broken"
    messages.append(dead("u2"))
    excuse = "u1 need not arrive: its target is, or may be, covered by u2, which no longer flies"
    assert (progress(messages).status, progress(messages).notes) == ("held", [excuse])
    drop(messages, Report)
    assert (progress(messages).status, progress(messages).notes) == ("held", [excuse])


def test_g7_excuses_targets_that_a_dead_uav_may_cover() -> None:
    """A UAV need not arrive at a target within a hull of the last plan."""
    messages = unfinished(LIMIT)
    mission = messages[0]
    assert isinstance(mission, MissionMessage)
    near = msgspec.structs.replace(mission.roster[1], target_x_m=24.0 - 11.0, target_y_m=16.0)
    messages[0] = msgspec.structs.replace(mission, roster=[mission.roster[0], near, mission.roster[2]])
    messages += [dead("u2"), ended("stalled")]
    assert progress(messages).status == "broken"
    last = max(i for i, m in enumerate(messages) if isinstance(m, Report))
    hull = {"hull_uav": ["u2"], "hull_ax_m": [24.0], "hull_ay_m": [16.0], "hull_bx_m": [24.0], "hull_by_m": [16.0]}
    messages[last] = msgspec.structs.replace(messages[last], **hull, hull_r_m=[2.5])
    assert results(messages)["G7"].status == "held"


def test_g7_excuses_a_uav_that_must_hold() -> None:
    """A UAV within the hull of a dead one must hold, so it need not arrive."""
    messages = [*unfinished(LIMIT), dead("u0"), ended("stalled")]
    last = max(i for i, m in enumerate(messages) if isinstance(m, Report))
    for radius_m, status in ((9.9, "broken"), (10.1, "held")):
        hull = {"hull_uav": ["u0"], "hull_ax_m": [24.0], "hull_ay_m": [6.0], "hull_bx_m": [30.0], "hull_by_m": [6.0]}
        report = messages[last]
        assert isinstance(report, Report)
        messages[last] = msgspec.structs.replace(report, **hull, hull_r_m=[radius_m])
        assert progress(messages).status == status
    excuse = "u2 need not arrive: it must hold, since no step leads away from u0, which no longer flies"
    assert progress(messages).notes == [excuse]


def test_a_violation_is_told_in_one_line() -> None:
    """The line of a violation starts with slot and time, if there are any."""
    assert str(Violation("gap", "x is missing")) == "x is missing"
    assert str(Violation("overlap", "a and b", 3, ["a", "b"], 1.75)) == "slot 3, 1.750 s: a and b"


def test_a_slot_beyond_reason_is_one_clear_line(messages: list[Message]) -> None:
    """A garbled slot number must not exhaust the memory."""
    change(messages, {"uav": "u1", "slot": 3}, Fix, slot=1 << 39)
    with pytest.raises(RecordingError, match="beyond the longest mission that can be analysed"):
        check(recorded(messages))


def test_so_many_uav_slots_are_examined_and_no_more(messages: list[Message], monkeypatch: pytest.MonkeyPatch) -> None:
    """The limit is on slots times UAVs."""
    monkeypatch.setattr(tracks, "MAX_UAV_SLOTS", 9 * 3)
    assert broken(messages) == set()
    monkeypatch.setattr(tracks, "MAX_UAV_SLOTS", 9 * 3 - 1)
    with pytest.raises(RecordingError, match="slot 8, beyond"):
        check(recorded(messages))


def test_what_is_said_before_the_mission_or_by_strangers_is_no_part_of_it(messages: list[Message]) -> None:
    """A fix of slot -1 does not count as one of the last slot, and an unknown UAV has no track."""
    fix, truth = (next(m for m in messages if isinstance(m, kind) and m.uav == "u2") for kind in (Fix, Truth))
    far = {"waypoint_x_m": 90.0, "executing": True, "energy_j": 1.0}
    early = [msgspec.structs.replace(fix, slot=-1, **far), msgspec.structs.replace(truth, slot=-1, to_x_m=90.0)]
    strange = [msgspec.structs.replace(m, uav="zz", slot=20) for m in (fix, truth)]
    expected, found = (tracks.tracks_of(recorded(said)) for said in (messages, [*messages, *early, *strange]))
    for name in ("centre_m", "true_from_m", "true_to_m", "heard", "executed", "energy_j"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    assert found.energy_j[:, 2].tolist() == [5e4 - 70 * slot for slot in range(9)]


# --- G8 --------------------------------------------------------------------------------------


def zoned(**fields: object) -> list[Message]:
    """Return the messages of three UAVs that fly 16 m north at x = 0, 12 and 24, with one zone."""
    return flight(parallel(), zone=[convert({"name": "z", **fields}, Zone)])


@pytest.mark.parametrize(
    ("zone", "uavs", "slot", "time_s", "depth_m"),
    [
        # A fence that the centre of u2 leaves by 0.5 m all along.
        ({"kind": "inclusion", "polygon": [[-1, -1], [23.5, -1], [23.5, 17], [-1, 17]]}, ["u2"], 0, 0.0, 0.5),
        # It ends at y = 15: all leave it in slot 8, the last one, half-way through its step of 2 m.
        ({"kind": "inclusion", "polygon": [[-1, -1], [25, -1], [25, 15], [-1, 15]]}, ["u0", "u1", "u2"], 8, None, 1.0),
        # A sliver across the way of u1, thinner than a step: only the motion between two slots is in it.
        ({"kind": "exclusion", "polygon": [[11, 4.9], [13, 4.9], [13, 5.1], [11, 5.1]], "keep": "centre"}, ["u1"], 3,
         None, 0.1),
        # Circles count as circles.
        ({"kind": "exclusion", "centre": [18, 8], "radius_m": 1.5}, ["u1", "u2"], 3, None, 0.5),
        ({"kind": "inclusion", "centre": [12, 8], "radius_m": 14.0}, ["u0", "u2"], 0, 0.0, math.hypot(12, 8) - 14),
        # The disc keeps to a fence if the zone says so.
        ({"kind": "inclusion", "polygon": [[-4, -9], [30, -9], [30, 30], [-4, 30]], "keep": "disc"}, ["u0"], 0, 0.0, 1),
    ],
)  # fmt: skip
def test_a_broken_zone_is_named(
    zone: dict[str, object], uavs: list[str], slot: int, time_s: float | None, depth_m: float
) -> None:
    """UAV, zone, slot, time and depth; in continuous time, by the zone's own shape."""
    violations = results(zoned(**zone))["G8"].violations
    assert sorted(violation.uavs[0] for violation in violations) == uavs
    assert all("zone 'z'" in violation.text and violation.slot == slot for violation in violations)
    assert all(violation.value_m == pytest.approx(depth_m, rel=0.05) for violation in violations)
    for violation in violations:
        assert violation.time_s is not None
        assert slot * 0.5 <= violation.time_s <= (slot + 1) * 0.5
        assert time_s is None or violation.time_s == time_s


@pytest.mark.parametrize(
    "zone",
    [
        {"kind": "inclusion", "polygon": [[0, 0], [24, 0], [24, 16], [0, 16]]},
        {"kind": "exclusion", "polygon": [[29, 0], [40, 0], [40, 16], [29, 16]]},
        {"kind": "exclusion", "polygon": [[12, 3], [14, 5], [12, 7], [16, 5]], "keep": "centre"},
        {"kind": "exclusion", "centre": [6, 8], "radius_m": 1.0},
    ],
)
def test_touching_a_zone_breaks_nothing(zone: dict[str, object]) -> None:
    """The fence runs through starts, ways and targets; discs and centres touch, and go no farther."""
    assert results(zoned(**zone))["G8"].status == "held"


def test_zones_are_not_judged_without_fixes() -> None:
    """What a UAV did while its fixes are missing is unknown, unless the others already broke a zone."""
    held = zoned(kind="inclusion", polygon=[[-9, -9], [99, -9], [99, 99], [-9, 99]])
    drop(held, Fix, uav="u1", slot=4)
    assert results(held)["G8"].status == "not-judged"
    broken_too = zoned(kind="exclusion", centre=[0, 8], radius_m=1.0)
    drop(broken_too, Fix, uav="u1", slot=4)
    assert results(broken_too)["G8"].status == "broken"
