"""G2: every executed step is one recorded command, valid at the tick of its slot, and no UAV flies that has landed."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import numpy as np

from edc_swarm.analysis.autopilots import strays_of
from edc_swarm.analysis.guarantees.evidence import Evidence
from edc_swarm.analysis.guarantees.verdict import GuaranteeResult, Violation, not_judged, verdict
from edc_swarm.analysis.tracks import TRUTH_TOLERANCE_M, Step
from edc_swarm.analysis.true_paths import have_inertia
from edc_swarm.mission.configuration import NS_PER_S
from edc_swarm.mission.failsafe import failsafe_of
from edc_swarm.protocol.messages import Command, Fix

LENGTH_TOLERANCE_M = 1e-9


def check_fencing(evidence: Evidence) -> GuaranteeResult:
    """Return the verdict on G2."""
    silent: dict[int, list[Step]] = {}
    for step in evidence.tracks.silent:
        silent.setdefault(step.uav, []).append(step)
    found = [*_astray(evidence), *_risen(evidence)]
    for uav, fixes in evidence.fixes.items():
        found += _executions(evidence, uav, fixes)
        found += _silent_executions(evidence, uav, silent.get(evidence.index[uav], []))
    if not found and (absent := absent_commands(evidence)):
        why = f"{absent} executed steps name commands that may be missing from the record"
        return not_judged("G2", "Only valid commands", why, evidence.gap_notes())
    return verdict("G2", "Only valid commands", found, evidence.gap_notes())


def _risen(evidence: Evidence) -> Iterator[Violation]:
    """Yield a violation for each UAV that executes a step, or still publishes fixes, after it had to land.

    A slot with a command may have had an accepted step if it has no fix, or if its fix is the first one of a new
    process: the one before may have died between the step and its fix. A stray goes on saying where it is.
    """
    failsafe, tracks = failsafe_of(evidence.mission), evidence.tracks
    if failsafe is None:
        return
    maybe, strays = tracks.executed | tracks.lost, strays_of(evidence.recording)
    begun = {uav: _first_slots(fixes) for uav, fixes in evidence.fixes.items()}
    for uav, slot in evidence.commands:
        k = evidence.index.get(uav, -1)
        if k >= 0 and 0 <= slot < tracks.slots:
            maybe[slot, k] |= not tracks.heard[slot, k] or slot in begun.get(uav, ())
    for k, uav in enumerate(tracks.uavs):
        if uav in evidence.fixes_lost() or uav in strays:
            continue
        stepped = [-1, *np.flatnonzero(maybe[:, k]).tolist(), tracks.slots + failsafe.wait_slots]
        for landing_slot, slot in zip(map(failsafe.landing_slot, stepped), stepped[1:], strict=False):
            late = slot > landing_slot and slot < tracks.slots and tracks.executed[slot, k]
            fixes = np.flatnonzero(tracks.heard[landing_slot:slot, k])
            if late or len(fixes):
                first, what = (landing_slot + int(fixes[0]), "still flies") if len(fixes) else (slot, "executes a step")
                text = f"{uav} {what} although it had to land in slot {landing_slot}"
                yield Violation("after-landing", text, first, [uav])


def _first_slots(fixes: Iterable[Fix]) -> set[int]:
    """Return the slot of the first fix of each process of a UAV."""
    first: dict[str, int] = {}
    for fix in fixes:
        first[fix.instance] = min(fix.slot, first.get(fix.instance, fix.slot))
    return set(first.values())


def absent_commands(evidence: Evidence) -> int:
    """Return how many executed commands are not recorded although they may have been published."""
    return len(
        {
            (fix.uav, fix.slot)
            for fixes in evidence.fixes.values()
            for fix in fixes
            if fix.executing and fix.voter and not _named(evidence, fix) and evidence.command_lost(fix)
        }
    )


def _executions(evidence: Evidence, uav: str, fixes: list[Fix]) -> Iterator[Violation]:
    """Yield the violations of the steps that fixes report; a retransmitted fix is judged once."""
    granted: set[tuple[int, str]] = set()
    slot, judged, newest, before = -1, -1, 0, 0
    for fix in fixes:
        if fix.slot > slot:
            slot, before = fix.slot, newest
        if fix.voter:
            granted.add((fix.term, fix.head))
            newest = max(newest, fix.term)
        if fix.executing and fix.slot > judged:
            judged = fix.slot
            yield from _judged(evidence, uav, fix, granted, before)


def _judged(evidence: Evidence, uav: str, fix: Fix, granted: set[tuple[int, str]], before: int) -> Iterator[Violation]:
    """Yield the violations of one step. `before` is the newest term granted before the slot's tick."""
    if not fix.voter:
        yield Violation("without-memory", f"{uav} lost its memory and yet executes", fix.slot, [uav])
        return
    rivals = _named(evidence, fix)
    if not rivals:
        if not evidence.command_lost(fix):
            yield Violation(*_unknown(evidence, fix), fix.slot, [uav])
        return
    explained = [list(_explained(evidence, fix, command, granted, before)) for command in rivals]
    yield from min(explained, key=len)


def _explained(
    evidence: Evidence, fix: Fix, command: Command, granted: set[tuple[int, str]], before: int
) -> Iterator[Violation]:
    """Yield the violations of the step that `fix` reports if the UAV executed `command`."""
    uav = fix.uav
    target_m, waypoint_m = (command.target_x_m, command.target_y_m), (fix.waypoint_x_m, fix.waypoint_y_m)
    if target_m != waypoint_m:
        text = f"{uav} was sent to {target_m} and says {waypoint_m}"
        yield Violation("other-target", text, fix.slot, [uav], value_m=math.dist(target_m, waypoint_m))
    unsaid = uav in evidence.fixes_lost() and command.term >= before
    if ((command.term, command.head) not in granted and not unsaid) or command.term < before:
        text = f"{uav} executes term {command.term} of {command.head} while it grants term {max(before, fix.term)}"
        yield Violation("not-granted", text, fix.slot, [uav])
    yield from _invalid(evidence, uav, command)


def _silent_executions(evidence: Evidence, uav: str, steps: list[Step]) -> Iterator[Violation]:
    """Yield the violations of steps that no fix reports, judged with the grants published before the slot."""
    for step in steps:
        earlier = [(f.term, f.head) for f in evidence.fixes[uav] if f.slot < step.slot and f.voter]
        granted = max(earlier, default=None)
        explained = [list(_silently_explained(evidence, uav, command, granted)) for command in step.commands]
        yield from min(explained, key=len)


def _silently_explained(
    evidence: Evidence, uav: str, command: Command, granted: tuple[int, str] | None
) -> Iterator[Violation]:
    """Yield the violations of a step that no fix reports if the UAV executed `command`."""
    if (command.term, command.head) != granted and not evidence.fix_lost(uav, command.slot - 1):
        text = f"{uav} executed term {command.term} of {command.head}, which it did not grant"
        yield Violation("not-granted", text, command.slot, [uav])
    yield from _invalid(evidence, uav, command)


def _invalid(evidence: Evidence, uav: str, command: Command) -> Iterator[Violation]:
    """Yield the reasons that make a command invalid for its slot, apart from grants."""
    mission, slot = evidence.mission, command.slot
    start_m = (command.start_x_m, command.start_y_m)
    x_m, y_m = evidence.tracks.centre_m[slot, evidence.index[uav]].tolist()
    if start_m != (x_m, y_m) and not evidence.start_lost(uav, slot):
        text = f"{uav} is at {(x_m, y_m)} and executes a step from {start_m}"
        yield Violation("other-start", text, slot, [uav], value_m=math.dist(start_m, (x_m, y_m)))
    length_m = math.dist(start_m, (command.target_x_m, command.target_y_m))
    longest_m = mission.step_m(mission.roster[evidence.index[uav]])
    if length_m > longest_m + LENGTH_TOLERANCE_M:
        text = f"{uav} executes a step of {length_m:.3f} m, more than {longest_m:.3f} m"
        yield Violation("too-long", text, slot, [uav], value_m=length_m)
    late_s = (command.sent_ns - _latest_ns(evidence, slot)) / NS_PER_S
    if late_s > 0:
        text = f"{uav} executes a command that was sent {late_s * 1e3:.1f} ms after its slot began"
        yield Violation("late", text, slot, [uav])


def _latest_ns(evidence: Evidence, slot: int) -> int:
    """Return the latest valid sending time of a command for `slot`.

    It is the start of the slot plus 2 `guard_s`, since the clocks of sender and receiver may each be off by `guard_s`.
    """
    mission = evidence.mission
    guard_ns = round(2 * mission.guard_s * NS_PER_S / mission.time_scale)
    return mission.epoch_ns + slot * mission.slot_ns + guard_ns


def _named(evidence: Evidence, fix: Fix) -> list[Command]:
    """Return the commands that the fix may name; several, if rival heads use equal sequence numbers."""
    return [
        command
        for command in evidence.commands.get((fix.uav, fix.slot), [])
        if (command.term, command.seq) == (fix.command_term, fix.command_seq)
    ]


def _unknown(evidence: Evidence, fix: Fix) -> tuple[str, str]:
    named = f"{fix.uav} executes command {fix.command_seq} of term {fix.command_term}"
    for command in evidence.recording.commands:
        if (command.uav, command.term, command.seq) == (fix.uav, fix.command_term, fix.command_seq):
            return "other-slot", f"{named}, which is for slot {command.slot}"
    return "no-such-command", f"{named}, which no head published"


def _astray(evidence: Evidence) -> Iterator[Violation]:
    """Yield a violation for each executed step that truly moved otherwise than the disc, without inertia."""
    tracks = evidence.tracks
    moved_m = np.diff(tracks.centre_m, axis=0)
    apart_m = np.hypot(*np.moveaxis(tracks.true_to_m - tracks.true_from_m - moved_m, 2, 0))
    exact = tracks.executed & ~tracks.lost & ~have_inertia(evidence.mission)
    for slot, k in np.argwhere((apart_m > TRUTH_TOLERANCE_M) & exact).tolist():
        uav, off_m = tracks.uavs[k], float(apart_m[slot, k])
        text = f"{uav} truly moved otherwise than its disc, by {off_m:.3g} m"
        yield Violation("truth-differs", text, slot, [uav], value_m=off_m)
