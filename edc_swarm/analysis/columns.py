"""A run as arrays over slots and UAVs, for metrics, plots and notebooks.

Positions are waypoints, the centres of the tracked discs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from edc_swarm.analysis.guarantees.evidence import gather
from edc_swarm.analysis.living import alive_in, living_at_end
from edc_swarm.analysis.slot_energy import slot_energy_j
from edc_swarm.analysis.timings import Timing, measured
from edc_swarm.analysis.tracks import Tracks
from edc_swarm.analysis.true_paths import true_paths
from edc_swarm.protocol.messages import Report
from edc_swarm.recording.model import Recording
from edc_swarm.recording.repeats import plans_of, said_once

Floats = NDArray[np.float64]

_NUMBERED, _SENT = attrgetter("uav", "slot", "seq"), attrgetter("sent_ns")


@dataclass(frozen=True, slots=True)
class Columns:
    """The run as arrays over S slots and K UAVs, for plots and notebooks.

    Attributes
    ----------
    uavs
        K ids.
    time_s
        (S,) mission time at the start of each slot.
    centre_m
        (S + 1, K, 2) centres of the tracked discs at slot starts and, last, at the end.
    step_m
        (S, K) distance flown in each slot.
    slot_j
        (S, K) energy of propulsion in each slot.
    away_m
        (S + 1, K) distance of each centre from its UAV's target.
    true_from_m, true_to_m
        (S, K, 2) true motion, NaN where unknown.
    executed, lost, grounded, alive
        (S, K) True where the UAV executed a command; where the recording lacks the motion; where the failsafe has
        taken the UAV out of the airspace; where the UAV flies (a UAV that does not live at the end flies until its last
        known slot).
    energy_j
        (S, K) battery, NaN in a slot without a fix.
    plan_slot, plan_ms
        (P,) slots whose plans were timed, and their plan times; 0 ms in a report means: not measured.
    command_slot, fix_to_command_ms
        (C,) slot of each command that names a recorded fix, and the time since that fix was sent.
    """

    uavs: list[str]
    time_s: Floats
    centre_m: Floats
    step_m: Floats
    slot_j: Floats
    away_m: Floats
    true_from_m: Floats
    true_to_m: Floats
    executed: NDArray[np.bool_]
    lost: NDArray[np.bool_]
    grounded: NDArray[np.bool_]
    alive: NDArray[np.bool_]
    energy_j: Floats
    plan_slot: NDArray[np.int64]
    plan_ms: Floats
    command_slot: NDArray[np.int64]
    fix_to_command_ms: Floats


def columns_of(recording: Recording, timings: Sequence[Timing] = ()) -> Columns:
    """Return the run as arrays. `timings`, if given, replace the recorded plan times."""
    tracks = gather(recording).tracks
    return columns_from(recording, tracks, living_at_end(recording, tracks), timings)


def columns_from(recording: Recording, tracks: Tracks, living: NDArray[np.bool_], timings: Sequence[Timing]) -> Columns:
    """Return the run as arrays, from its tracks and the (K,) UAVs that live at its end."""
    mission, centre_m = recording.mission, tracks.centre_m
    target_m = np.array([(e.target_x_m, e.target_y_m) for e in mission.roster]).reshape(-1, 2)
    reports = plans_of(recording)
    times: Sequence[Timing | Report] = measured(recording, timings) or reports
    planned = [plan for plan in times if plan.plan_ms > 0]
    command_slot, fix_to_command_ms = _fix_to_command_ms(recording)
    step_m = length_m(np.diff(centre_m, axis=0))
    return Columns(
        uavs=tracks.uavs,
        time_s=mission.dt_s * np.arange(tracks.slots, dtype=np.float64),
        centre_m=centre_m,
        step_m=step_m,
        slot_j=slot_energy_j(mission, step_m, true_paths(recording, tracks.slots)),
        away_m=length_m(centre_m - target_m),
        true_from_m=tracks.true_from_m,
        true_to_m=tracks.true_to_m,
        executed=tracks.executed,
        lost=tracks.lost,
        grounded=tracks.grounded,
        alive=alive_in(tracks, living),
        energy_j=tracks.energy_j,
        plan_slot=np.array([plan.slot for plan in planned], np.int64),
        plan_ms=np.array([plan.plan_ms for plan in planned], np.float64),
        command_slot=command_slot,
        fix_to_command_ms=fix_to_command_ms,
    )


def length_m(vectors_m: Floats) -> Floats:
    """Return the lengths of vectors (..., 2)."""
    return np.hypot(vectors_m[..., 0], vectors_m[..., 1])


def _fix_to_command_ms(recording: Recording) -> tuple[NDArray[np.int64], Floats]:
    """Return, for each command, its slot and its sending time minus that of the fix that it names.

    Commands that name no fix (older recordings), or one that is not recorded, are left out.
    """
    sent_ns = counted_ns(recording)
    slots, delays_ns = [], []
    for command in said_once(recording.commands):
        fix_ns = sent_ns.get((command.uav, command.slot - 1, command.fix_seq))
        if fix_ns is not None and fix_ns <= command.sent_ns:
            slots.append(command.slot)
            delays_ns.append(command.sent_ns - fix_ns)
    return np.array(slots, np.int64), np.array(delays_ns, np.float64) / 1e6


def counted_ns(recording: Recording) -> dict[tuple[str, int, int], int]:
    """Return the sending time of each fix by (UAV, slot, sequence number), by which commands name it."""
    return dict(zip(map(_NUMBERED, recording.fixes), map(_SENT, recording.fixes), strict=True))
