"""Age of information: how old the newest fix of a UAV is at its head, and the newest command at the UAV that flies it.

The age grows with time and falls when a newer update is used (S. Kaul, R. Yates, M. Gruteser, "Real-Time Status: How
Often Should One Update?", IEEE INFOCOM 2012). Its peaks are the ages just before that (M. Costa, M. Codreanu,
A. Ephremides, "On the Age of Information in Status Update Systems with Packet Management", IEEE Trans. Inf. Theory
62(4), 2016). A recording tells when an update is used, not when it arrived: a fix is used when the head sends the
command that names it, a command when the slot begins in which it is flown.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from edc_swarm.analysis.columns import counted_ns
from edc_swarm.recording.model import Recording
from edc_swarm.recording.repeats import said_once

Updates = Mapping[str, list[tuple[int, int]]]
"""Times in nanoseconds at which an update of each UAV is used, and at which it was sent."""


class Age(Struct, frozen=True):
    """Age of information over all UAVs in milliseconds: mean and quantiles over time, mean and quantiles of its peaks.

    None where no update follows another.
    """

    mean: float | None = None
    p50: float | None = None
    p99: float | None = None
    max: float | None = None
    peak_mean: float | None = None
    peak_p50: float | None = None
    peak_p99: float | None = None


class Sawtooth(Struct, frozen=True):
    """The pieces of all UAVs on which the age grows evenly, (N,) from `low_ms` to `high_ms`, and its (P,) peaks."""

    low_ms: NDArray[np.float64]
    high_ms: NDArray[np.float64]
    peak_ms: NDArray[np.float64]

    def share_below(self, age_ms: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the share of time in which the age is at most each of `age_ms`, which are in order."""
        lengths_ms = (self.high_ms - self.low_ms).sum()
        low, high = np.sort(self.low_ms), np.sort(self.high_ms)
        return np.asarray((_excess(low, age_ms) - _excess(high, age_ms)) / lengths_ms)


def fix_updates(recording: Recording) -> Updates:
    """Return when fixes were used by heads; nothing where commands name no fix, as in older recordings."""
    sent_ns, found = counted_ns(recording), defaultdict[str, list[tuple[int, int]]](list)
    for command in recording.commands:
        fix_ns = sent_ns.get((command.uav, command.slot - 1, command.fix_seq))
        if fix_ns is not None and fix_ns <= command.sent_ns:
            found[command.uav].append((command.sent_ns, fix_ns))
    return found


def command_updates(recording: Recording) -> Updates:
    """Return when commands were flown."""
    mission, found = recording.mission, defaultdict[str, list[tuple[int, int]]](list)
    sent_ns = flown_ns(recording)
    for fix in recording.fixes:
        command_ns = sent_ns.get((fix.uav, fix.slot))
        begun_ns = mission.epoch_ns + fix.slot * mission.slot_ns
        if command_ns is not None and command_ns <= begun_ns:
            found[fix.uav].append((begun_ns, command_ns))
    return found


def flown_ns(recording: Recording) -> dict[tuple[str, int], int]:
    """Return when the command was sent that a UAV flies in a slot, by (UAV, slot): of several copies the one named."""
    exact = {(c.uav, c.slot, c.term, c.seq): c.sent_ns for c in recording.commands}
    first = {(c.uav, c.slot, c.term): c.sent_ns for c in reversed(recording.commands)}
    return {
        (fix.uav, fix.slot): exact.get((*key, fix.command_seq), first[key])
        for fix in recording.fixes
        if fix.executing and (key := (fix.uav, fix.slot, fix.command_term)) in first
    }


def sawtooth_of(updates: Updates) -> Sawtooth:
    """Return the ages of each UAV from its first update that is used to the last one."""
    pieces_ns = [piece for found in updates.values() for piece in _pieces(sorted(found))]
    low_ns, high_ns = np.array(pieces_ns, np.float64).reshape(-1, 2).T
    return Sawtooth(low_ns / 1e6, high_ns / 1e6, high_ns / 1e6)


def age_of(sawtooth: Sawtooth) -> Age:
    """Return mean and quantiles of the ages; time counts, not updates."""
    low, high = sawtooth.low_ms, sawtooth.high_ms
    if not len(low) or not (high > low).any():
        return Age()
    steps = np.unique(np.concatenate([low, high]))
    p50, p99 = np.interp([0.5, 0.99], sawtooth.share_below(steps), steps)
    peak_p50, peak_p99 = np.percentile(sawtooth.peak_ms, [50, 99])
    return Age(
        mean=float(((high**2 - low**2) / 2).sum() / (high - low).sum()),
        p50=float(p50),
        p99=float(p99),
        max=float(high.max()),
        peak_mean=float(sawtooth.peak_ms.mean()),
        peak_p50=float(peak_p50),
        peak_p99=float(peak_p99),
    )


def fix_to_step_ms(recording: Recording) -> NDArray[np.float64]:
    """Return, for each command that was flown, the time from the fix that it was planned with to the step's slot."""
    fixes_ns, mission = counted_ns(recording), recording.mission
    flown = {(fix.uav, fix.slot, fix.command_term) for fix in recording.fixes if fix.executing}
    found_ns = [
        mission.epoch_ns + command.slot * mission.slot_ns - fixes_ns[key]
        for command in said_once(recording.commands)
        if (command.uav, command.slot, command.term) in flown
        and (key := (command.uav, command.slot - 1, command.fix_seq)) in fixes_ns
    ]
    return np.array(found_ns, np.float64) / 1e6


def _pieces(used: Iterable[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return the ages at both ends of each piece between two uses; an update that is older than one used is none."""
    found, last_ns, newest_ns = list[tuple[int, int]](), -1, -1
    for at_ns, sent_ns in used:
        if newest_ns >= 0 and sent_ns > newest_ns:
            found.append((last_ns - newest_ns, at_ns - newest_ns))
        if sent_ns > newest_ns:
            last_ns, newest_ns = at_ns, sent_ns
    return found


def _excess(sorted_ms: NDArray[np.float64], age_ms: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return, for each age, the sum of what it exceeds the values by."""
    sums = np.concatenate([[0.0], np.cumsum(sorted_ms)])
    count = np.searchsorted(sorted_ms, age_ms, side="right")
    return np.asarray(count * age_ms - sums[count])
