"""Every metric, computed from a recording alone.

Durations are mission time, `*_ms` are wall time. Positions in path metrics are waypoints, the
centres of the tracked discs; a potential collision is the paper's criterion (eq. 16) evaluated on
the discs at every instant, a true collision the same on true positions and bodies.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from edc_swarm.analysis.living import alive_in, living_at_end
from edc_swarm.analysis.outcome import NotHome, home_at_end, not_home
from edc_swarm.analysis.separation import encounters, least_gap_m
from edc_swarm.analysis.tracks import Tracks, tracks_of
from edc_swarm.emulation.energy import compute_energy_j, propulsion_power_w, propulsion_powers_w
from edc_swarm.errors import RecordingError
from edc_swarm.files import read_regular
from edc_swarm.geometry import BODY_TOLERANCE_M, DISC_TOLERANCE_M
from edc_swarm.mission.configuration import ARRIVED_M, OPERATOR, Mission
from edc_swarm.mission.faults import parse_faults
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.messages import PLANNED, Report
from edc_swarm.recording.model import Recording
from edc_swarm.recording.ordering import fetched_count
from edc_swarm.recording.sequences import find_gaps

Floats = NDArray[np.float64]

_NUMBERED, _SENT = attrgetter("uav", "slot", "seq"), attrgetter("sent_ns")

OVERLOADED_PCT = 1.0
"""With more late ticks than this it was the machine, not the network, that was slow."""


class Quantiles(Struct, frozen=True):
    """Median, 99th percentile and maximum; None where there is nothing to measure."""

    p50: float | None
    p99: float | None
    max: float | None


class HeadTerm(Struct, frozen=True):
    """Who led in a term, from the first to the last slot whose fixes it planned with."""

    term: int
    head: str
    first_slot: int
    last_slot: int


class Timing(Struct, frozen=True):
    """Measured plan times of one slot, which a simulated recording itself does not carry."""

    slot: int
    plan_ms: float
    guidance_ms: float = 0.0
    assemble_ms: float = 0.0
    solve_ms: float = 0.0


class Metrics(Struct, frozen=True, kw_only=True):
    """What `edc-swarm metrics --json` prints, as docs/metrics.md defines it. None: not defined for this run."""

    uavs: int
    slots: int
    duration_s: float
    completed: bool
    arrived: int
    not_living: list[str]
    not_home: list[NotHome]
    potential_collisions: int
    true_collisions: int
    min_disc_gap_m: float | None
    min_true_distance_m: float | None
    path_m: float
    straight_m: float
    extra_distance_pct: float | None
    extra_distance_mean_pct: float | None
    makespan_s: float | None
    makespan_ratio: float | None
    energy_propulsion_j: float
    energy_compute_j: float | None
    energy_straight_j: float
    plan_ms: Quantiles
    fix_to_command_ms: Quantiles
    slots_held: int
    slots_missed: int
    ticks_late_pct: float
    messages: int
    gaps: int
    fetched: int
    duplicates: int
    heads: list[HeadTerm]
    failover_slots: list[int]
    faults_undone: list[str]


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
        (S, K) way flown in each slot.
    away_m
        (S + 1, K) distance of each centre from its UAV's target.
    true_from_m, true_to_m
        (S, K, 2) true motion, NaN where unknown.
    executed, lost, alive
        (S, K) whether a command was executed; whether the record lacks what was flown; whether the UAV still
        flies: one that does not live at the end does until the last slot that it is known from.
    energy_j
        (S, K) battery, NaN where not heard.
    plan_slot, plan_ms
        (P,) slots whose plans were timed, and how long they took; 0 ms in a report means: not measured.
    command_slot, fix_to_command_ms
        (C,) slot of each command that names a recorded fix, and the time since that fix was sent.
    """

    uavs: list[str]
    time_s: Floats
    centre_m: Floats
    step_m: Floats
    away_m: Floats
    true_from_m: Floats
    true_to_m: Floats
    executed: NDArray[np.bool_]
    lost: NDArray[np.bool_]
    alive: NDArray[np.bool_]
    energy_j: Floats
    plan_slot: NDArray[np.int64]
    plan_ms: Floats
    command_slot: NDArray[np.int64]
    fix_to_command_ms: Floats


class Timings(Struct, frozen=True):
    """Content of FILE.timings.json: plan times, and the SHA-256 of the recording that they belong to."""

    recording: str
    plans: list[Timing]


def content_hash(recording_path: str | Path) -> str:
    """Return the SHA-256 of a recording's bytes.

    Raises
    ------
    RecordingError
        The file cannot be read.
    """
    try:
        with Path(recording_path).open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise RecordingError(recording_path, f"cannot be read ({error.strerror})") from None


def _ignore(_: str) -> None:
    pass


def load_timings(recording_path: str | Path, warn: Callable[[str], None] = _ignore) -> list[Timing]:
    """Read the plan times beside a simulated recording, from FILE.timings.json; empty where they are unknown.

    Times that belong to another recording are told to `warn` and left out.

    Raises
    ------
    RecordingError
        The file cannot be read or is not a list of timings.
    """
    path = Path(recording_path).with_suffix(".timings.json")
    try:
        timings = msgspec.json.decode(read_regular(path), type=Timings | list[Timing])
    except FileNotFoundError:
        return []
    except OSError as error:
        raise RecordingError(path, f"cannot be read ({error.strerror})") from None
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise RecordingError(path, f"holds no timings ({error})") from None
    if isinstance(timings, Timings) and timings.recording == content_hash(recording_path):
        return timings.plans
    warn(f"warning: {path} is not known to belong to {recording_path}: plan times are unknown")
    return []


def measured(recording: Recording, timings: Sequence[Timing]) -> Sequence[Timing]:
    """Return `timings`, unless the run was a real one: its own times are in its reports."""
    return () if recording.run.get("clock") == "wall" else timings


def columns_of(recording: Recording, timings: Sequence[Timing] = ()) -> Columns:
    """The run as arrays. `timings`, when given, replace the recorded plan times."""
    tracks = tracks_of(recording)
    return _columns(recording, tracks, living_at_end(recording, tracks), timings)


def compute_metrics(recording: Recording, timings: Sequence[Timing] = ()) -> Metrics:
    """All metrics of a run. `timings`, when given, replace the recorded plan times."""
    mission, tracks = recording.mission, tracks_of(recording)
    living = living_at_end(recording, tracks)
    columns = _columns(recording, tracks, living, timings)
    at_target = columns.away_m <= ARRIVED_M
    home = home_at_end(recording, tracks)
    settled = bool(living.any() and home[living].all())
    arrival = _arrival_slots(at_target)
    slots = 1 + max((fix.slot for fix in recording.fixes), default=-1)
    commanded = {command.slot for command in recording.commands}
    first = min(commanded, default=None)
    last = int(arrival[living].max()) if settled else tracks.slots - 1
    makespan_s = _makespan_s(mission, arrival[living], first) if settled else None
    heads = _heads(recording)
    separation = _separation(mission, tracks)
    path_m, straight_m = columns.step_m.sum(axis=0), np.array([entry.straight_m for entry in mission.roster])
    ended_m = _length_m(columns.centre_m[-1] - columns.centre_m[0])
    return Metrics(
        uavs=len(tracks.uavs),
        slots=slots,
        duration_s=mission.dt_s * slots,
        completed=bool(len(home) and home.all()),
        arrived=int(home.sum()),
        not_living=[uav for uav, alive in zip(tracks.uavs, living, strict=True) if not alive],
        not_home=not_home(recording, tracks, living),
        potential_collisions=separation.potential_collisions,
        true_collisions=separation.true_collisions,
        min_disc_gap_m=separation.min_disc_gap_m,
        min_true_distance_m=separation.min_true_distance_m,
        path_m=float(path_m.sum()),
        straight_m=float(straight_m.sum()),
        extra_distance_pct=_extra_pct(path_m[home], ended_m[home]),
        extra_distance_mean_pct=_extra_mean_pct(path_m[home], ended_m[home], straight_m[home]),
        makespan_s=makespan_s,
        makespan_ratio=_makespan_ratio(mission, makespan_s, _reached_m(columns, arrival)[living]),
        energy_propulsion_j=_propulsion_j(mission, columns, arrival, first),
        energy_compute_j=_compute_j(recording, columns),
        energy_straight_j=_straight_energy_j(mission),
        plan_ms=_quantiles(columns.plan_ms),
        fix_to_command_ms=_quantiles(columns.fix_to_command_ms),
        slots_held=_slots_held(columns, at_target, first, last),
        slots_missed=len(set(range(first, last + 1)) - commanded) if first is not None else 0,
        ticks_late_pct=_ticks_late_pct(recording, int(tracks.heard.sum())),
        messages=recording.message_count,
        gaps=sum(gap.count for gap in find_gaps(recording) if not gap.duplicate),
        fetched=fetched_count(recording),
        duplicates=recording.duplicates,
        heads=heads,
        failover_slots=[max(0, new.first_slot - old.last_slot - 1) for old, new in pairwise(heads)],
        faults_undone=_faults_undone(recording, mission.dt_s * slots),
    )


def _faults_undone(recording: Recording, duration_s: float) -> list[str]:
    aimless = [
        event.detail
        for event in recording.events
        if event.kind == EventKind.FAULT_WITHOUT_TARGET and event.source == OPERATOR
    ]
    return aimless + [str(fault) for fault in parse_faults(recording.mission) if fault.at_s >= duration_s]


def _columns(recording: Recording, tracks: Tracks, living: NDArray[np.bool_], timings: Sequence[Timing]) -> Columns:
    mission, centre_m = recording.mission, tracks.centre_m
    target_m = np.array([(e.target_x_m, e.target_y_m) for e in mission.roster]).reshape(-1, 2)
    reports = [report for report in recording.reports if report.status in PLANNED]
    times: Sequence[Timing | Report] = measured(recording, timings) or reports
    planned = [plan for plan in times if plan.plan_ms > 0]
    command_slot, fix_to_command_ms = _fix_to_command_ms(recording)
    return Columns(
        uavs=tracks.uavs,
        time_s=mission.dt_s * np.arange(tracks.slots, dtype=np.float64),
        centre_m=centre_m,
        step_m=_length_m(np.diff(centre_m, axis=0)),
        away_m=_length_m(centre_m - target_m),
        true_from_m=tracks.true_from_m,
        true_to_m=tracks.true_to_m,
        executed=tracks.executed,
        lost=tracks.lost,
        alive=alive_in(tracks, living),
        energy_j=tracks.energy_j,
        plan_slot=np.array([plan.slot for plan in planned], np.int64),
        plan_ms=np.array([plan.plan_ms for plan in planned], np.float64),
        command_slot=command_slot,
        fix_to_command_ms=fix_to_command_ms,
    )


def _length_m(vectors_m: Floats) -> Floats:
    return np.hypot(vectors_m[..., 0], vectors_m[..., 1])


def _arrival_slots(at_target: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(K,) slot whose motion brings each UAV to its target for good: -1 when it starts there and
    stays, S when it never arrives.
    """
    away = ~at_target
    last_away = len(away) - 1 - np.argmax(away[::-1], axis=0)
    return np.where(away.any(axis=0), last_away, -1)


def _makespan_s(mission: Mission, arrival: NDArray[np.int64], first: int | None) -> float | None:
    """From the start of the first commanded slot to the end of the last UAV's last motion."""
    if first is None:
        return None
    slots = int(arrival.max()) + 1 - first
    return max(0.0, slots * mission.dt_s - mission.guard_s)


def _reached_m(columns: Columns, arrival: NDArray[np.int64]) -> Floats:
    """(K,) straight line from each UAV's start to where it was when it arrived: up to `ARRIVED_M` from its target."""
    ends = np.minimum(arrival + 1, len(columns.centre_m) - 1)
    reached_m = columns.centre_m[ends, np.arange(len(ends))]
    return _length_m(reached_m - columns.centre_m[0])


def _makespan_ratio(mission: Mission, makespan_s: float | None, reached_m: Floats) -> float | None:
    """The makespan over the least time in which anybody could fly the longest of these straight lines."""
    longest_m = float(reached_m.max(initial=0.0))
    return makespan_s * mission.v_max_mps / longest_m if makespan_s is not None and longest_m else None


class _Separation(NamedTuple):
    """Collisions (as pairs) and least distances, tracked and true."""

    potential_collisions: int
    true_collisions: int
    min_disc_gap_m: float | None
    min_true_distance_m: float | None


def _separation(mission: Mission, tracks: Tracks) -> _Separation:
    radius_m = np.array([entry.r_m for entry in mission.roster])
    body_m = np.array([entry.body_m for entry in mission.roster])
    from_m, to_m = tracks.seen_m
    true_m = (tracks.true_from_m, tracks.true_to_m)
    return _Separation(
        _pairs(from_m, to_m, radius_m, -DISC_TOLERANCE_M),
        _pairs(*true_m, body_m, -BODY_TOLERANCE_M),
        _finite(least_gap_m(from_m, to_m, radius_m)),
        _finite(least_gap_m(*true_m, np.zeros_like(body_m))),
    )


def _pairs(from_m: Floats, to_m: Floats, radius_m: Floats, below_m: float) -> int:
    met = encounters(from_m, to_m, radius_m, below_m)
    return len(set(zip(met.first.tolist(), met.second.tolist(), strict=True)))


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _extra_pct(path_m: Floats, ended_m: Floats) -> float | None:
    """All paths together against the straight lines between their ends, together."""
    total_m = float(ended_m.sum())
    return max(0.0, 100 * (float(path_m.sum()) / total_m - 1)) if total_m else None


def _extra_mean_pct(path_m: Floats, ended_m: Floats, straight_m: Floats) -> float | None:
    """Mean over the UAVs that have somewhere to go of each one's own percentage."""
    going = straight_m > ARRIVED_M
    if not going.any():
        return None
    return max(0.0, float(np.mean(100 * (path_m[going] / ended_m[going] - 1))))


def _propulsion_j(mission: Mission, columns: Columns, arrival: NDArray[np.int64], first: int | None) -> float:
    """Energy of flying and hovering of each UAV, from the first commanded slot until it has arrived, or is dead."""
    if first is None:
        return 0.0
    flown_s = mission.dt_s - 2 * mission.guard_s
    flying_j = propulsion_powers_w(columns.step_m / flown_s, mission.energy) * flown_s
    hovering_j = propulsion_power_w(0.0, mission.energy) * (mission.dt_s - flown_s)
    slot = np.arange(len(columns.step_m))[:, None]
    return float(np.sum((flying_j + hovering_j)[(slot >= first) & (slot <= arrival) & columns.alive]))


def _compute_j(recording: Recording, columns: Columns) -> float | None:
    """Energy of all plans; None where there is none, or one whose time was not measured."""
    plans = sum(report.status in PLANNED for report in recording.reports)
    if not plans or len(columns.plan_ms) < plans:
        return None
    return compute_energy_j(float(columns.plan_ms.sum()) / 1e3, recording.mission.head)


def _straight_energy_j(mission: Mission) -> float:
    total_m = sum(entry.straight_m for entry in mission.roster)
    return propulsion_power_w(mission.v_max_mps, mission.energy) * total_m / mission.v_max_mps


def _quantiles(values: Floats) -> Quantiles:
    if not len(values):
        return Quantiles(None, None, None)
    p50, p99 = np.percentile(values, [50, 99])
    return Quantiles(float(p50), float(p99), float(values.max()))


def _fix_to_command_ms(recording: Recording) -> tuple[NDArray[np.int64], Floats]:
    """For each command its slot, and its send time minus that of the fix that it says its head planned with.

    Commands that do not say it (older recordings), or whose fix is not recorded, have no delay.
    """
    sent_ns = counted_ns(recording)
    slots, delays_ns = [], []
    for command in recording.commands:
        fix_ns = sent_ns.get((command.uav, command.slot - 1, command.fix_seq))
        if fix_ns is not None and fix_ns <= command.sent_ns:
            slots.append(command.slot)
            delays_ns.append(command.sent_ns - fix_ns)
    return np.array(slots, np.int64), np.array(delays_ns, np.float64) / 1e6


def counted_ns(recording: Recording) -> dict[tuple[str, int, int], int]:
    """When each fix was sent, by UAV, slot and number: what commands name."""
    return dict(zip(map(_NUMBERED, recording.fixes), map(_SENT, recording.fixes), strict=True))


def _slots_held(columns: Columns, at_target: NDArray[np.bool_], first: int | None, last: int) -> int:
    """UAV-slots in first..last that begin away from the target and in which nothing is executed."""
    if first is None:
        return 0
    held = ~columns.executed & ~at_target[:-1] & columns.alive
    return int(held[first : last + 1].sum())


def _ticks_late_pct(recording: Recording, ticks: int) -> float:
    """Late ticks among all slots begun; `late_ticks` counts within one life of a process."""
    late: dict[tuple[str, str], int] = {}
    for fix in recording.fixes:
        if fix.late_ticks:
            late[fix.uav, fix.instance] = max(fix.late_ticks, late.get((fix.uav, fix.instance), 0))
    return 100 * sum(late.values()) / ticks if ticks else 0.0


def _heads(recording: Recording) -> list[HeadTerm]:
    """Heads that planned, by term; a plan that only claims a quorum makes nobody head."""
    mission = recording.mission
    roster = {entry.uav for entry in mission.roster}
    slots: dict[tuple[int, str], list[int]] = {}
    for report in recording.reports:
        if report.has_quorum and report.is_backed(roster, mission.quorum):
            slots.setdefault((report.term, report.head), []).append(report.slot)
    return [HeadTerm(term, head, min(led), max(led)) for (term, head), led in sorted(slots.items())]
