"""The story of a recording: what happened, slot by slot, on the evidence of the whole record."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import msgspec

from edc_swarm.analysis.guarantees.evidence import Evidence, gather
from edc_swarm.analysis.guarantees.spacing import overlapping, touching
from edc_swarm.analysis.guarantees.verdict import Violation
from edc_swarm.protocol.messages import Command, Fix, Message, Report
from edc_swarm.recording.model import Recording
from edc_swarm.recording.sequences import sequence_numbers
from edc_swarm.story.happening import STATES, Happening, grouped
from edc_swarm.story.log import MAX_HAPPENINGS
from edc_swarm.story.teller import Storyteller

MAX_STORY_SLOTS = 1_000_000
"""Most slots of a story."""
AMENDED: tuple[Literal["silent", "dead", "frozen", "cut-off", "unknown"], ...] = (
    "silent",
    "dead",
    "frozen",
    "cut-off",
    "unknown",
)
"""Kinds of happenings that are states, and begin before they can be told."""
NO_FIX = "the record holds no fix of it"
"""Words for a UAV of which nothing is known."""


@dataclass(frozen=True, slots=True)
class Story:
    """The story of a mission.

    Attributes
    ----------
    happenings
        By time; those that differ in their UAVs alone are one.
    states
        One bytes object per slot: for each UAV, in roster order, the index of its state in `STATES`.
    left_out
        Number of happenings beyond the most that are kept.
    """

    happenings: list[Happening]
    states: list[bytes]
    left_out: int


def story_of(recording: Recording) -> Story:
    """Return the story from slot 0 to the last slot with a fix; what comes after belongs to that one."""
    mission, slots = recording.mission, slots_of(recording)
    teller = Storyteller(mission)
    by_slot: dict[int, list[Message]] = {}
    for slot, message in _messages(recording, slots):
        by_slot.setdefault(slot, []).append(message)
    code, states = {state: k for k, state in enumerate(STATES)}, []
    for slot in range(slots):
        for message in by_slot.pop(slot, ()):
            teller.hear(message)
        teller.close(slot)
        states.append(bytes(code[state] for state in teller.states.values()))
    evidence = gather(recording)
    _tell_unheard(teller.happenings, recording)
    _doubt_holds(teller.happenings, evidence)
    left_out = teller.left_out + _tell_overlaps(teller.happenings, evidence)
    _amend(teller.happenings, states, [entry.uav for entry in mission.roster])
    happenings = grouped(teller.happenings, [entry.uav for entry in mission.roster])
    happenings.sort(key=lambda happening: happening.time_s)
    return Story(happenings, states, left_out)


def slots_of(recording: Recording) -> int:
    """Return the number of slots of a story, at least one: as many as the tracks have."""
    last = max((fix.slot for fix in recording.fixes), default=0)
    return min(MAX_STORY_SLOTS, 1 + max(last, max((truth.slot for truth in recording.truths), default=0)))


def _messages(recording: Recording, slots: int) -> Iterable[tuple[int, Message]]:
    """Yield the messages of a story with their slots; events after the last slot belong to it."""
    for event in recording.events:
        slot = min(max(event.slot, 0), slots - 1)
        yield slot, msgspec.structs.replace(event, slot=slot)
    sent: list[Fix | Command | Report] = [*recording.fixes, *recording.commands, *recording.reports]
    for each in sent:
        yield each.slot, each


def _tell_unheard(happenings: list[Happening], recording: Recording) -> None:
    """Tell that UAVs without any recorded fix are unknown, where no event says what became of them."""
    unheard = {entry.uav for entry in recording.mission.roster} - {fix.uav for fix in recording.fixes}
    for each in happenings:
        if each.kind == "silent" and unheard.issuperset(each.uavs):
            each.kind, each.detail, each.level = "unknown", NO_FIX, "news"
        if each.kind in {"unknown", "dead", "frozen"}:
            unheard.difference_update(each.uavs)
    if unheard:
        uavs = [entry.uav for entry in recording.mission.roster if entry.uav in unheard]
        happenings.append(Happening(kind="unknown", slot=0, time_s=0.0, uavs=uavs, detail=NO_FIX, lasts=True))


def _doubt_holds(happenings: list[Happening], evidence: Evidence) -> None:
    """Make the reasons of holds unknown that rest on the absence of commands or reports which the record lacks.

    Where a later command to the UAV follows, the teller has judged by its number.
    """
    holds = [each for each in happenings if each.kind == "holding" and each.reason == "no-command"]
    if not holds:
        return
    recording, numbers = evidence.recording, sequence_numbers(evidence.recording)
    gaps = [gap for gap in evidence.gaps if not gap.duplicate and gap.key.startswith("head/")]
    tails = [gap.key for gap in gaps if gap.last > max(numbers.get((gap.key, gap.instance), ()), default=-1)]
    lacking = {key.rsplit("/", 1)[1] for key in tails}
    lacks_all = "report" in lacking or not (recording.commands or recording.reports)
    newest: dict[str, int] = {}
    for command in recording.commands:
        newest[command.uav] = max(command.slot, newest.get(command.uav, -1))
    for hold in holds:
        until = math.inf if hold.last_slot is None else hold.last_slot
        is_judged = any(newest.get(uav, -1) > until for uav in hold.uavs)
        if not is_judged and (lacks_all or not lacking.isdisjoint(hold.uavs)):
            hold.reason, hold.detail = "unknown", "the record lacks commands for it"


def _tell_overlaps(happenings: list[Happening], evidence: Evidence) -> int:
    """Tell once of each pair whose discs overlap or whose bodies meet, as G3 finds; return how many are left out."""
    found: list[tuple[Literal["overlap", "collision"], Violation]] = [
        *(("overlap", each) for each in overlapping(evidence)),
        *(("collision", each) for each in touching(evidence)),
    ]
    room = max(0, MAX_HAPPENINGS - len(happenings))
    for kind, each in found[:room]:
        assert each.time_s is not None, "two that meet have an instant"
        words = each.text.partition(": ")[2]
        happenings.append(
            Happening(kind=kind, slot=each.slot, time_s=each.time_s, uavs=each.uavs, detail=words, level="warning")
        )
    return max(0, len(found) - room)


def _amend(happenings: list[Happening], states: list[bytes], uavs: list[str]) -> None:
    """Amend the states from the slot on in which a UAV is told to be gone: the teller knew it a slot or more later.

    States in which the record turned out to lack fixes become unknown.
    """
    index, codes = {uav: k for k, uav in enumerate(uavs)}, {state: k for k, state in enumerate(STATES)}
    for each in sorted(happenings, key=lambda happening: happening.kind == "unknown"):
        if each.kind not in AMENDED:
            continue
        last = len(states) - 1 if each.last_slot is None else each.last_slot
        for slot in range(each.slot, min(last + 1, len(states))):
            row = bytearray(states[slot])
            for uav in each.uavs:
                if row[index[uav]] != codes["landed"] or each.kind == "unknown":
                    row[index[uav]] = codes[each.kind]
            states[slot] = bytes(row)
