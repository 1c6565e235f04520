"""The evidence of a recording that the checkers share, and the parts of it that are missing.

A guarantee holds only if the recording shows it. A stream of messages is complete if its sequence numbers have no
gap, and its publisher sent a `closed` event or is known to have been ended by a fault. Each guarantee needs:

========= ====================== ==========================================================
Guarantee Needs                  Without it
========= ====================== ==========================================================
G1        fixes, commands,       grants and plans are unknown
          reports
G2        fixes, commands        what was executed, or who ordered it, is unknown
G3        fixes, truths          without fixes the discs, without truths the bodies are unknown
G4        fixes, truths          motion is unknown
G5        numbers, `closed`      what is missing is unknown; `run_end` tells how many there were
G7        fixes                  who has arrived is unknown
G8        fixes                  where the discs are is unknown
========= ====================== ==========================================================
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from operator import attrgetter

import numpy as np
from msgspec import UNSET
from numpy.typing import NDArray

from edc_swarm.analysis.autopilots import never_flew, unreported
from edc_swarm.analysis.guarantees.untold import unspoken_spans, untold_of
from edc_swarm.analysis.tracks import Tracks, tracks_of
from edc_swarm.analysis.true_paths import TruePaths, true_paths
from edc_swarm.foreign_text import listed
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.protocol.hindrance import Place, Point
from edc_swarm.protocol.messages import Command, Fix, MissionMessage, Report, Truth, roster_index
from edc_swarm.recording.ends import Ends, ends_of
from edc_swarm.recording.model import Recording
from edc_swarm.recording.repeats import plans_of
from edc_swarm.recording.sequences import Gap, find_gaps

NEEDS: dict[str, tuple[str, ...]] = {
    "G1": ("fix", "command", "report"),
    "G2": ("fix", "command"),
    "G3": ("fix", "truth"),
    "G4": ("fix", "truth"),
    "G7": ("fix",),
    "G8": ("fix",),
}
"""Kinds of messages that each guarantee needs in order to be judged."""
_PLURAL = {"fix": "fixes", "truth": "truths", "command": "commands", "report": "reports"}
_KEY = {
    "fix": re.compile(r"uav/([^/]+)/fix").fullmatch,
    "truth": re.compile(r"uav/([^/]+)/truth").fullmatch,
    "command": re.compile(r"head/([^/]+)/command/[^/]+").fullmatch,
    "report": re.compile(r"head/([^/]+)/report").fullmatch,
    "command_to": re.compile(r"head/[^/]+/command/([^/]+)").fullmatch,
}


@dataclass(frozen=True)
class Evidence:
    """A recording with its tracks.

    Attributes
    ----------
    index
        Roster position by id.
    fixes
        By UAV, in the order of the record (roster UAVs only).
    commands
        By UAV and slot.
    plans
        Reports of slots with a plan, each once.
    ends
        How each publisher ended.
    untold
        By kind, the UAVs of which the last messages of a killed process are certainly missing.
    spans
        By UAV, the slots of the last fix of each process that was cut off, and of the first one of its successor.
    whole
        The mission of all clusters, with all faults; `mission` is that of one cluster where a cluster is judged.
    foreign
        Where a cluster is judged: places of UAVs of other clusters that no longer fly.
    foreign_away
        The same of those that fly and are away from their targets, with their points at the end.
    """

    recording: Recording
    mission: MissionMessage
    index: dict[str, int]
    tracks: Tracks
    fixes: dict[str, list[Fix]]
    commands: dict[tuple[str, int], list[Command]]
    plans: list[Report]
    gaps: list[Gap]
    ends: Ends
    untold: Mapping[str, set[str]]
    spans: Mapping[str, Sequence[tuple[int, float]]]
    whole: MissionMessage
    foreign: Sequence[Place] = ()
    foreign_away: Sequence[tuple[RosterEntry, Point]] = ()

    @cached_property
    def paths(self) -> TruePaths | None:
        """True paths of the vehicles with inertia; None if there are none."""
        return true_paths(self.recording, self.tracks.slots)

    def time_s(self, slot: int, share: float = 0.0) -> float:
        """Return the mission time at a share of a slot."""
        return (slot + share) * self.mission.dt_s

    @cached_property
    def _fixes_lost(self) -> frozenset[str]:
        return frozenset(_lacking(self.gaps, self.ends, "fix") & self.index.keys())

    def fixes_lost(self) -> frozenset[str]:
        """UAVs of whose fixes some may be missing from the record: what they granted there is unknown."""
        return self._fixes_lost

    def lacks(self, uav: str, kind: str) -> bool:
        """Return True if messages of `kind` by `uav` may be missing from the record, or it holds no fix of it."""
        return not self.fixes.get(uav) or uav in _lacking(self.gaps, self.ends, kind)

    def fix_lost(self, uav: str, slot: int) -> bool:
        """Return True if the fix of `uav` in `slot` may be missing from the recording."""
        return uav in self._fixes_lost or any(before < slot < after for before, after in self.spans.get(uav, ()))

    def start_lost(self, uav: str, slot: int) -> bool:
        """Return True if the place of `uav` at the start of `slot` is unknown, since the fix before may be missing."""
        return slot > 0 and uav in self._fixes_lost and not self.tracks.heard[slot - 1, self.index[uav]]

    @cached_property
    def _newest_command(self) -> dict[tuple[str, str, str], int]:
        """Greatest recorded sequence number of the commands of each head's process to each UAV."""
        newest: dict[tuple[str, str, str], int] = {}
        for command in self.recording.commands:
            key = command.head, command.instance, command.uav
            newest[key] = max(command.seq, newest.get(key, -1))
        return newest

    @cached_property
    def _leaders(self) -> set[tuple[str, int]]:
        """The recorded heads and terms of plans and commands."""
        ordered = {(command.head, command.term) for command in self.recording.commands}
        return ordered | {(plan.head, plan.term) for plan in self.plans}

    def command_lost(self, fix: Fix) -> bool:
        """Return True if the command that `fix` names may be missing from the recording, by its sequence number."""
        if self.mission.control == "local":
            return False  # It names a step of the UAV's own, which is no message.
        if any(
            gap.key.endswith(f"/command/{fix.uav}") and gap.first <= fix.command_seq <= gap.last
            for gap in self.gaps
            if not gap.duplicate
        ):
            return True
        cut = [process for process in self.ends.cut if process[0] in self.index]
        led = fix.command_term != fix.term or (fix.head, fix.term) in self._leaders
        if not led and any(uav == fix.head for uav, _ in cut):
            return True  # It led this term as a process of which nothing is recorded, whatever the numbers of another.
        return any(self._newest_command.get((*process, fix.uav), -1) < fix.command_seq for process in cut)

    def gap_notes(self) -> list[str]:
        """Return a warning if messages are missing, so that a violation may be one of the recording only."""
        return ["the record has gaps (see G5): what is missing here may have been said"] if self.gaps else []

    def lacking(self, guarantee: str) -> list[str]:
        """Return one reason for each part of the evidence for `guarantee` that is missing."""
        if guarantee == "G8" and not self.mission.zone:
            return []  # Whatever is missing, nothing was promised.
        reasons = [reason for kind in NEEDS.get(guarantee, ()) for reason in self.missing(kind)]
        lost = [self.tracks.uavs[k] for k in np.flatnonzero(self.tracks.lost.any(axis=0)).tolist()]
        if lost and not reasons and "fix" in NEEDS.get(guarantee, ()):
            reasons = [f"the record does not tell how {listed(lost)} moved in every slot"]
        return reasons

    def missing(self, kind: str) -> Iterator[str]:
        """Yield the reasons why the record may lack messages of `kind` (a key of `_PLURAL`)."""
        name = _PLURAL[kind]
        missing = sum(gap.count for gap in self.gaps if not gap.duplicate and _KEY[kind](gap.key))
        if missing:
            yield f"{missing} {name} are missing"
        if unended := self.ends.unended & self.index.keys():
            yield f"{name} of {_named(unended)} may be missing: no `closed` event"
        if untold := self.untold.get(kind, set()) - unended:
            yield f"the last {name} of {_named(untold)} are missing"
        if kind in {"fix", "truth"}:
            published = self.recording.fixes if kind == "fix" else self.recording.truths
            silent = self.index.keys() - set(map(attrgetter("uav"), published)) - self.ends.ended_by_fault - unended
            silent -= never_flew(self.recording)
            if silent:
                yield f"no {name} of {_named(silent)}" + (": bodies cannot be judged" if kind == "truth" else "")
            if kind == "truth":
                yield from self._unreported(silent)

    def _unreported(self, silent: set[str]) -> Iterator[str]:
        """Yield a reason if autopilots of UAVs that are not wholly `silent` have reported too little in some slots."""
        slots = [f"{count} of {uav}" for uav, count in unreported(self.recording).items() if uav not in silent]
        if slots:
            yield f"slots that autopilots did not report: {listed(slots)}: bodies cannot be judged there"


@dataclass(frozen=True, slots=True)
class Known:
    """The kinds of messages of which the record is known to lack none: what is counted in them is then a measurement.

    A count of what was found may always be told; a count of 0, a sum, a share of all and a least or largest value may
    not.
    """

    fixes: bool
    truths: bool
    commands: bool
    reports: bool

    @classmethod
    def of(cls, evidence: Evidence) -> Known:
        """Return what `evidence` is complete in."""
        return cls(*(not any(evidence.missing(kind)) for kind in ("fix", "truth", "command", "report")))

    @property
    def motion(self) -> bool:
        """True if it is known who flew which command."""
        return self.fixes and self.commands

    @property
    def places(self) -> bool:
        """True if it is known where all bodies truly were."""
        return self.fixes and self.truths


def gather(recording: Recording) -> Evidence:
    """Return the evidence of a recording."""
    index = roster_index(recording.mission.roster)
    fixes: dict[str, list[Fix]] = {uav: [] for uav in index}
    for fix in recording.fixes:
        if fix.uav in fixes:
            fixes[fix.uav].append(fix)
    commands: dict[tuple[str, int], list[Command]] = defaultdict(list)
    for command in recording.commands:
        commands[command.uav, command.slot].append(command)
    gaps, ends = find_gaps(recording), ends_of(recording)
    plans, spans = plans_of(recording), unspoken_spans(fixes, ends)
    untold = untold_of(recording, ends, plans, spans)
    return Evidence(
        recording=recording,
        mission=recording.mission,
        index=index,
        tracks=_judgeable(recording, index, gaps, ends, untold),
        fixes=fixes,
        commands=dict(commands),
        plans=plans,
        gaps=gaps,
        ends=ends,
        untold=untold,
        spans=spans,
        whole=recording.mission,
    )


def _lacking(gaps: list[Gap], ends: Ends, kind: str) -> set[str]:
    """Return the UAVs whose messages of this kind may be incomplete, without those that a fault ended."""
    holed = {found[1] for gap in gaps if not gap.duplicate and (found := _KEY[kind](gap.key))}
    return holed | ends.unended


def _with_unknown_commands(recording: Recording) -> set[str]:
    """Return the UAVs whose fixes name executed commands that are not recorded; nobody publishes a UAV's own steps."""
    if recording.mission.control == "local":
        return set()
    said = {(command.uav, command.slot, command.term, command.seq) for command in recording.commands}
    executed = (fix for fix in recording.fixes if fix.executing)
    return {fix.uav for fix in executed if (fix.uav, fix.slot, fix.command_term, fix.command_seq) not in said}


def _judgeable(
    recording: Recording, index: dict[str, int], gaps: list[Gap], ends: Ends, untold: Mapping[str, set[str]]
) -> Tracks:
    """Return tracks in which every motion that is uncertain, since fixes or truths may be missing, is lost or NaN.

    In a slot without a fix, a UAV with complete fixes held. The place of one with incomplete fixes is unknown, also if
    its fix tells none, since it has lost its memory. No number tells whether the last messages of a killed process are
    missing, so that is unknown where others are.
    """
    unknown_commands = _with_unknown_commands(recording)
    doubted = {uav for uav, _ in ends.cut if uav in index}
    holed = any(not gap.duplicate and (_KEY["fix"](gap.key) or _KEY["truth"](gap.key)) for gap in gaps)
    if not (holed or unknown_commands or ends.unheard or any(untold.values())):
        doubted = set()
    tracks = tracks_of(recording, _lacking(gaps, ends, "command_to") | unknown_commands | doubted)
    no_fix = _may_be_missing(recording.fixes, "fix", index, gaps, ends, tracks.heard.shape)
    no_truth = _may_be_missing(recording.truths, "truth", index, gaps, ends, tracks.heard.shape)
    for uav in doubted:
        no_fix[:, index[uav]] = no_truth[:, index[uav]] = True
    placed = np.zeros_like(tracks.heard)
    for fix in recording.fixes:
        if fix.slot >= 0 and fix.uav in index and (fix.voter or fix.stray_m is not UNSET):
            placed[fix.slot, index[fix.uav]] = True
    lost = tracks.lost | (~placed & no_fix)
    if not (lost.any() or no_truth.any()):
        return tracks
    published = np.zeros_like(tracks.heard)
    for truth in recording.truths:
        if truth.slot >= 0 and truth.uav in index:
            published[truth.slot, index[truth.uav]] = True
    unknown = (~published & (no_truth | lost))[..., None]
    return replace(
        tracks,
        lost=lost,
        true_from_m=np.where(unknown, np.nan, tracks.true_from_m),
        true_to_m=np.where(unknown, np.nan, tracks.true_to_m),
    )


def _may_be_missing(
    said: Sequence[Fix] | Sequence[Truth],
    kind: str,
    index: dict[str, int],
    gaps: list[Gap],
    ends: Ends,
    shape: tuple[int, ...],
) -> NDArray[np.bool_]:
    """Return (S, K) slots whose message of `kind` may be missing, by the sequence numbers around them."""
    missing = np.zeros(shape, bool)
    lacking = _lacking(gaps, ends, kind) & index.keys()
    streams: dict[tuple[str, str], list[tuple[int, int]]] = {}
    for message in said if lacking else ():
        if message.uav in lacking:
            streams.setdefault((message.uav, message.instance), []).append((message.seq, message.slot))
    for uav in lacking - {uav for uav, _ in streams}:
        missing[:, index[uav]] = True
    tails = {(gap.key, gap.instance): gap.last for gap in gaps if not gap.duplicate}
    for (uav, instance), numbers in streams.items():
        numbers.sort()
        for (before, slot), (seq, next_slot) in pairwise([(-1, -1), *numbers]):
            if seq > before + 1:
                missing[slot + 1 : next_slot, index[uav]] = True
        newest, slot = numbers[-1]
        if uav in ends.unended or tails.get((f"uav/{uav}/{kind}", instance), -1) > newest:
            missing[slot + 1 :, index[uav]] = True
    return missing


def _named(uavs: set[str] | frozenset[str]) -> str:
    return listed(sorted(uavs))
