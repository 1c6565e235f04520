"""The measurements of one run of a latency experiment, from its recording alone.

Ages are ages of information (S. Kaul, R. Yates, M. Gruteser, "Real-Time Status: How Often Should One
Update?", IEEE INFOCOM 2012) in wall milliseconds. They are sampled at the start of every slot for every UAV that flies:

- fix age = start of the slot - sending of the UAV's newest fix that a command names as input of its plan;
- command age = start of the slot - sending of the newest command that the UAV has begun to fly.

Before the first such fix or command, the mission's epoch takes its place.
"""

from __future__ import annotations

import msgspec
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from edc_swarm.analysis.columns import Columns, columns_of, counted_ns
from edc_swarm.analysis.guarantees.check import check
from edc_swarm.analysis.guarantees.progress import PROGRESS
from edc_swarm.analysis.metrics import OVERLOADED_PCT, compute_metrics
from edc_swarm.emulation.links import DelayError
from edc_swarm.mission.roster_entry import ARRIVED_M
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.messages import roster_index
from edc_swarm.recording.model import Recording


class Sample(Struct, frozen=True, kw_only=True):
    """The measurements of one run.

    Attributes
    ----------
    limit_slots
        Most slots that the mission lasts.
    others_flew
        Commands flown by UAVs other than their head.
    held_pct
        100 n / N, from the first commanded slot on (from slot 1 if there is none): N is the number of UAV-slots in
        which a UAV flies and is away from its target, n the number of those in which it flew no command.
    failover_slots
        Number of slots without commands at changes of head, summed over all changes.
    broken, not_judged
        Guarantees other than progress that are broken, and those that could not be judged.
    delay_error
        None in the simulator, and if no message was delayed.
    """

    completed: bool | None
    slots: int | None
    limit_slots: int
    others_flew: int
    potential_collisions: int | None
    true_collisions: int | None
    min_disc_gap_m: float | None
    broken: list[str]
    not_judged: list[str]
    fix_to_command_ms: float | None
    fix_to_command_p99_ms: float | None
    fix_age_ms: float | None
    command_age_ms: float | None
    held_pct: float | None
    extra_distance_pct: float | None
    makespan_s: float | None
    energy_kj: float | None
    failover_slots: int | None
    terms: int
    plan_ms: float | None
    ticks_late_pct: float | None
    delay_error: DelayError | None = None

    @property
    def invalid(self) -> bool:
        """True if the machine was, or may have been, overloaded, so that this run says nothing about the network."""
        return self.ticks_late_pct is None or self.ticks_late_pct > OVERLOADED_PCT


def sample_of(recording: Recording) -> Sample:
    """Return the measurements of a run."""
    metrics, columns = compute_metrics(recording), columns_of(recording)
    first = min((command.slot for command in recording.commands), default=1)
    done = metrics.completed
    # Progress is not judged, since the share of completed missions is a result of the experiment.
    verdicts = [result for result in check(recording) if result.guarantee != PROGRESS]
    return Sample(
        completed=done,
        slots=metrics.slots,
        limit_slots=recording.mission.max_slots,
        others_flew=_others_flew(recording),
        potential_collisions=metrics.potential_collisions,
        true_collisions=metrics.true_collisions,
        min_disc_gap_m=metrics.min_disc_gap_m,
        broken=[result.guarantee for result in verdicts if result.broken],
        not_judged=[result.guarantee for result in verdicts if not result.judged],
        fix_to_command_ms=metrics.fix_to_command_ms.p50,
        fix_to_command_p99_ms=metrics.fix_to_command_ms.p99,
        fix_age_ms=_mean_fix_age_ms(recording, columns, first),
        command_age_ms=_mean_age_ms(recording, _flown_ns(recording, columns), columns.alive, first),
        held_pct=_held_pct(columns, first),
        extra_distance_pct=metrics.extra_distance_pct if done else None,
        makespan_s=metrics.makespan_s if done else None,
        energy_kj=None if metrics.energy_propulsion_j is None else metrics.energy_propulsion_j / 1e3,
        failover_slots=None if metrics.failover_slots is None else sum(metrics.failover_slots),
        terms=len(metrics.heads),
        plan_ms=metrics.plan_ms.p50,
        ticks_late_pct=metrics.ticks_late_pct,
        delay_error=_delay_error(recording),
    )


def _others_flew(recording: Recording) -> int:
    """Return the number of steps that UAVs flew by a command of another UAV."""
    leads = {command.term: command.head for command in recording.commands}
    cells = {(fix.uav, fix.slot): fix for fix in recording.fixes if fix.executing}
    return sum(leads.get(fix.command_term) != fix.uav for fix in cells.values())


def _held_pct(columns: Columns, first: int) -> float | None:
    away = (columns.away_m[:-1] > ARRIVED_M)[first:] & (columns.alive & ~columns.lost)[first:]
    held = away & ~columns.executed[first:]
    return 100 * float(held.sum() / away.sum()) if away.any() else None


def _counted_ns(recording: Recording, columns: Columns) -> NDArray[np.int64]:
    """Return (S, K) sending times of the newest fix of each UAV that a plan used before each slot; 0 for none."""
    sent_ns = counted_ns(recording)
    table = np.zeros(columns.executed.shape, np.int64)
    index = roster_index(recording.mission.roster)
    for command in recording.commands:
        slot, k = _next_slot(recording, command.sent_ns), index[command.uav]
        if slot < len(table):
            table[slot, k] = max(table[slot, k], sent_ns.get((command.uav, command.slot - 1, command.fix_seq), 0))
    return table


def _mean_fix_age_ms(recording: Recording, columns: Columns, first: int) -> float | None:
    """Return the mean fix age; None if the commands do not name fixes, as in older recordings."""
    if recording.commands and all(command.fix_seq < 0 for command in recording.commands):
        return None
    return _mean_age_ms(recording, _counted_ns(recording, columns), columns.alive, first)


def _flown_ns(recording: Recording, columns: Columns) -> NDArray[np.int64]:
    """Return (S, K) sending times of the command that each UAV began to fly in each slot; 0 where it held."""
    sent_ns = {(command.uav, command.slot, command.term): command.sent_ns for command in recording.commands}
    table = np.zeros(columns.executed.shape, np.int64)
    index = roster_index(recording.mission.roster)
    for fix in recording.fixes:
        if fix.executing:
            table[fix.slot, index[fix.uav]] = sent_ns.get((fix.uav, fix.slot, fix.command_term), 0)
    return table


def _mean_age_ms(
    recording: Recording, sent_ns: NDArray[np.int64], alive: NDArray[np.bool_], first: int
) -> float | None:
    """Return the mean age of the newest `sent_ns`, over slots from `first` on and the UAVs that fly in them."""
    mission = recording.mission
    newest_ns = np.maximum.accumulate(np.maximum(sent_ns - mission.epoch_ns, 0), axis=0)
    start_ns = np.arange(len(newest_ns), dtype=np.int64)[:, None] * mission.slot_ns
    ages_ns = (start_ns - newest_ns)[first:][alive[first:]]
    return float(ages_ns.mean()) / 1e6 if ages_ns.size else None


def _next_slot(recording: Recording, at_ns: int) -> int:
    """Return the first slot that begins at `at_ns` or later."""
    mission = recording.mission
    return -((mission.epoch_ns - at_ns) // mission.slot_ns)


def _delay_error(recording: Recording) -> DelayError | None:
    """Return the median over UAVs of their medians, and the greatest of their 99th percentiles and maxima."""
    errors = [
        msgspec.json.decode(event.detail, type=DelayError)
        for event in recording.events
        if event.kind == EventKind.DELAY_ERROR
    ]
    if not errors:
        return None
    return DelayError(
        messages=sum(one.messages for one in errors),
        p50_ms=float(np.median([one.p50_ms for one in errors])),
        p99_ms=max(one.p99_ms for one in errors),
        max_ms=max(one.max_ms for one in errors),
    )
