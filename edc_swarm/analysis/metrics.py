"""The metrics of a run, computed from its recording alone.

Durations are mission time, `*_ms` are wall time. Positions in path metrics are waypoints, the centres of the tracked
discs; a potential collision is the paper's criterion (eq. 16) on the discs at every instant, a true collision the same
on true positions and bodies.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from edc_swarm.analysis.columns import Columns, Floats, columns_from
from edc_swarm.analysis.energy_use import compute_j, propulsion_j, straight_energy_j
from edc_swarm.analysis.guarantees.completeness import unproved
from edc_swarm.analysis.guarantees.evidence import Evidence, Known, gather
from edc_swarm.analysis.guarantees.inside import largest_deviation_m
from edc_swarm.analysis.head_terms import ClusterFigures, HeadTerm, cluster_figures, failover_slots, heads_of
from edc_swarm.analysis.holds import holds_by_cause
from edc_swarm.analysis.information_age import Age, age_of, command_updates, fix_to_step_ms, fix_updates, sawtooth_of
from edc_swarm.analysis.landing import Landing, landings
from edc_swarm.analysis.living import living_at_end
from edc_swarm.analysis.outcome import NotHome, home_at_end, not_home
from edc_swarm.analysis.separation import encounters, least_gap_m
from edc_swarm.analysis.timings import Timing
from edc_swarm.analysis.tracks import Tracks
from edc_swarm.analysis.voyages import Voyages, voyages_of
from edc_swarm.geometry import BODY_TOLERANCE_M, DISC_TOLERANCE_M
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.faults import parse_faults
from edc_swarm.mission.prospect import COMPLETED, GIVEN_UP
from edc_swarm.mission.roles import OPERATOR
from edc_swarm.mission.roster_entry import ARRIVED_M
from edc_swarm.mission.routes import hover_time_s
from edc_swarm.mission.vehicle_budget import budget_of, vehicle_of
from edc_swarm.protocol.backing import Backing
from edc_swarm.protocol.events import EventKind
from edc_swarm.recording.model import Recording

OVERLOADED_PCT = 1.0
"""Share of late ticks above which the machine, not the network, counts as the cause of delays."""


class Quantiles(Struct, frozen=True):
    """Median, 99th percentile and maximum; None if there is nothing to measure."""

    p50: float | None
    p99: float | None
    max: float | None


class Deadline(Struct, frozen=True):
    """A UAV with a time by which it is to be at its target, and when it was. None: not at its target, or unknown."""

    uav: str
    finish_by_s: float
    finished_s: float | None
    met: bool | None


class Metrics(Struct, frozen=True, kw_only=True):
    """The metrics that `edc-swarm metrics --json` prints, defined in docs/metrics.md. None: undefined for this run."""

    uavs: int
    control: str
    inclusion_zones: int
    exclusion_zones: int
    slots: int | None
    duration_s: float | None
    completed: bool | None
    arrived: int | None
    unknown: list[str]
    not_living: list[str]
    not_home: list[NotHome]
    landed: list[Landing]
    beside: list[str]
    potential_collisions: int | None
    true_collisions: int | None
    min_disc_gap_m: float | None
    min_true_distance_m: float | None
    disc_budget: str
    max_deviation_m: float | None
    path_m: float | None
    straight_m: float | None
    extra_distance_pct: float | None
    extra_distance_mean_pct: float | None
    makespan_s: float | None
    makespan_ratio: float | None
    energy_propulsion_j: float | None
    energy_compute_j: float | None
    energy_straight_j: float
    plan_ms: Quantiles
    fix_to_command_ms: Quantiles
    fix_to_step_ms: Quantiles
    fix_age_ms: Age
    command_age_ms: Age
    slots_held: int | None
    slots_held_by: dict[str, int] | None
    slots_missed: int | None
    ticks_late_pct: float | None
    messages: int
    gaps: int | None
    fetched: int | None
    duplicates: int
    heads: list[HeadTerm]
    goals_reached: int | None
    goals_per_minute: float | None
    deadlines: list[Deadline]
    failover_slots: list[int] | None
    faults_undone: list[str]
    clusters: list[ClusterFigures] = []


def compute_metrics(recording: Recording, timings: Sequence[Timing] = ()) -> Metrics:
    """Return all metrics of a run. `timings`, if given, replace the recorded plan times."""
    mission, evidence = recording.mission, gather(recording)
    tracks, known = evidence.tracks, Known.of(evidence)
    voyages = voyages_of(recording, tracks)
    living = living_at_end(recording, tracks)
    columns = columns_from(recording, tracks, living, timings)
    at_target = (columns.away_m <= ARRIVED_M) & ~voyages.pending
    home = home_at_end(recording, tracks)
    settled = bool(living.any() and home[living].all())
    arrival = _arrival_slots(at_target)
    slots = 1 + max((fix.slot for fix in recording.fixes), default=-1) or None
    duration_s = None if slots is None else mission.dt_s * slots
    commanded = _commanded(recording, tracks)
    first = min(commanded, default=None) if known.motion else None
    last = int(arrival[living].max()) if settled else tracks.slots - 1
    makespan_s = _makespan_s(mission, arrival[living], first) if settled and first is not None else None
    held = _held(columns, at_target, first, last) if first is not None else None
    heads, astray = heads_of(recording), not_home(recording, tracks, living)
    unknown = [who.uav for who in astray if who.is_unknown]
    separation = _separation(evidence, known)
    path_m, straight_m = columns.step_m.sum(axis=0), np.array([voyage.straight_m for voyage in voyages.each])
    ended_m = _ended_m(voyages, columns.centre_m[-1])
    return Metrics(
        uavs=len(tracks.uavs),
        control=mission.control,
        inclusion_zones=sum(zone.kind == "inclusion" for zone in mission.zone),
        exclusion_zones=sum(zone.kind == "exclusion" for zone in mission.zone),
        slots=slots,
        duration_s=duration_s,
        completed=_completed(recording, home, known, astray),
        arrived=int(home.sum()) or (None if unknown else 0),
        unknown=unknown,
        not_living=[uav for uav, lives in zip(tracks.uavs, living, strict=True) if not lives and uav not in unknown],
        not_home=astray,
        landed=landings(recording, tracks),
        beside=[who.uav for who in astray if who.cause == "beside"],
        potential_collisions=separation.potential_collisions,
        true_collisions=separation.true_collisions,
        min_disc_gap_m=separation.min_disc_gap_m,
        min_true_distance_m=separation.min_true_distance_m,
        disc_budget=_disc_budget(mission),
        max_deviation_m=largest_deviation_m(evidence) if known.places else None,
        path_m=float(path_m.sum()) if known.fixes else None,
        straight_m=float(straight_m.sum()) if known.fixes else None,
        extra_distance_pct=_extra_pct(path_m[home], ended_m[home]) if known.fixes else None,
        extra_distance_mean_pct=(
            _extra_mean_pct(path_m[home], ended_m[home], straight_m[home]) if known.fixes else None
        ),
        makespan_s=makespan_s,
        makespan_ratio=_makespan_ratio(makespan_s, _least_s(mission, voyages, _reached_m(columns, arrival))[living]),
        energy_propulsion_j=propulsion_j(columns, arrival, first) if first is not None else None,
        energy_compute_j=compute_j(recording, columns) if known.reports else None,
        energy_straight_j=straight_energy_j(mission),
        plan_ms=_quantiles(columns.plan_ms),
        fix_to_command_ms=_quantiles(columns.fix_to_command_ms),
        fix_to_step_ms=_quantiles(fix_to_step_ms(recording)),
        fix_age_ms=age_of(sawtooth_of(fix_updates(recording))) if known.motion else Age(),
        command_age_ms=age_of(sawtooth_of(command_updates(recording))) if known.motion else Age(),
        slots_held=int(held.sum()) if held is not None else None,
        slots_held_by=holds_by_cause(recording, tracks, held) if held is not None and known.reports else None,
        slots_missed=_slots_missed(commanded, first, last) if first is not None else None,
        ticks_late_pct=_ticks_late_pct(recording, int(tracks.heard.sum())) if known.fixes else None,
        messages=recording.message_count,
        gaps=_gaps(evidence),
        fetched=recording.fetched_count,
        duplicates=recording.duplicates,
        heads=[term for terms in heads.values() for term in terms],
        goals_reached=_goals_reached(mission, voyages, home) or (0 if known.fixes else None),
        goals_per_minute=_per_minute(mission, voyages, duration_s) if known.fixes else None,
        deadlines=_deadlines(mission, home, arrival, known),
        failover_slots=failover_slots(heads) if known.reports else None,
        faults_undone=_faults_undone(recording, duration_s, known),
        clusters=cluster_figures(
            recording, heads, home, path_m, straight_m, fixes_known=known.fixes, reports_known=known.reports
        ),
    )


def _completed(recording: Recording, home: NDArray[np.bool_], known: Known, astray: Sequence[NotHome]) -> bool | None:
    """Return True if all are home; None where the record lacks fixes, and does not tell how the mission ended.

    A mission that the operator ends as complete may have UAVs that landed elsewhere: one of which a plan says so, and
    that no head heard after its newest fix, is away for certain. A lifelong mission is complete if it has lasted
    `max_slots`.
    """
    ends = {event.detail for event in recording.events if event.kind == EventKind.END and event.source == OPERATOR}
    if recording.mission.goals == "lifelong":
        return ends == {GIVEN_UP} if ends else None
    backing = Backing(recording.mission)
    landed = {uav for report in recording.reports if backing.is_plan(report) for uav in report.landed}
    is_away = any(who.uav in landed and not who.is_unknown for who in astray)
    if known.fixes or home.all() or ends - {COMPLETED} or is_away:
        return bool(len(home) and home.all())
    return None


def _gaps(evidence: Evidence) -> int | None:
    """Return how many messages the numbers prove to be missing; None where they neither show nor exclude any."""
    missing = sum(gap.count for gap in evidence.gaps if not gap.duplicate)
    return None if not missing and unproved(evidence) else missing


def _commanded(recording: Recording, tracks: Tracks) -> set[int]:
    """Return the slots for which anybody was commanded; without a head, those in which anybody flew its own step."""
    if recording.mission.control == "local":
        return set(np.flatnonzero(tracks.executed.any(axis=1)).tolist())
    return {command.slot for command in recording.commands}


def _slots_missed(commanded: set[int], first: int, last: int) -> int:
    return len(set(range(first, last + 1)) - commanded)


def _faults_undone(recording: Recording, duration_s: float | None, known: Known) -> list[str]:
    """Return the faults without a target, and those still to come at the end, if the record shows the end."""
    aimless = [
        event.detail
        for event in recording.events
        if event.kind == EventKind.FAULT_WITHOUT_TARGET and event.source == OPERATOR
    ]
    end_s = duration_s if known.fixes and duration_s is not None else math.inf
    return aimless + [str(fault) for fault in parse_faults(recording.mission) if fault.at_s >= end_s]


def _arrival_slots(at_target: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return (K,) slots of arrival: the slot after whose motion a UAV stays at its target.

    It is -1 for a UAV that starts at its target and stays, S for one that never arrives.
    """
    away = ~at_target
    last_away = len(away) - 1 - np.argmax(away[::-1], axis=0)
    return np.where(away.any(axis=0), last_away, -1)


def _makespan_s(mission: Mission, arrival: NDArray[np.int64], first: int) -> float:
    """Return the time from the start of the first commanded slot to the arrival of the last UAV."""
    return max(0.0, (int(arrival.max()) + 1 - first) * mission.dt_s - mission.guard_s)


def _reached_m(columns: Columns, arrival: NDArray[np.int64]) -> Floats:
    """Return (K, 2) places of arrival, which are within `ARRIVED_M` of the targets."""
    ends = np.minimum(arrival + 1, len(columns.centre_m) - 1)
    reached_m: Floats = columns.centre_m[ends, np.arange(len(ends))]
    return reached_m


def _ended_m(voyages: Voyages, end_m: Floats) -> Floats:
    """Return (K,) lengths of the straight ways from the starts, through the points reached, to `end_m` (K, 2)."""
    ends_m = zip(voyages.each, end_m.tolist(), strict=True)
    return np.array([voyage.ended_m((x_m, y_m)) for voyage, (x_m, y_m) in ends_m], np.float64)


def _least_s(mission: Mission, voyages: Voyages, end_m: Floats) -> Floats:
    """Return (K,) least times from the starts to `end_m` (K, 2): at full speed, with corners cut, and hovering."""
    cut_m = [2 * voyage.entry.accept_m * (len(voyage.entry.points) - 1) for voyage in voyages.each]
    least_m = np.maximum(_ended_m(voyages, end_m) - cut_m, 0.0)
    hover_s = np.array([hover_time_s(entry) for entry in mission.roster], np.float64)
    least_s: Floats = least_m / np.array(mission.speeds_mps) + hover_s
    return least_s


def _goals_reached(mission: Mission, voyages: Voyages, home: NDArray[np.bool_]) -> int:
    """Return how many goals the UAVs have reached, those at which they are included."""
    last = int(home.sum()) if mission.goals == "once" else 0
    return last + sum(len(voyage.reached_slots) for voyage in voyages.each)


def _per_minute(mission: Mission, voyages: Voyages, duration_s: float | None) -> float | None:
    """Return the goals reached in a minute of a lifelong mission; None for any other."""
    if mission.goals != "lifelong" or duration_s is None:
        return None
    return 60 * sum(len(voyage.reached_slots) for voyage in voyages.each) / duration_s


def _deadlines(mission: Mission, home: NDArray[np.bool_], arrival: NDArray[np.int64], known: Known) -> list[Deadline]:
    """Return the UAVs with a time to finish by, and whether they met it; unknown where the record lacks motion."""
    found = []
    for k, entry in enumerate(mission.roster):
        if entry.finish_by_s:
            finished_s = max(0.0, (int(arrival[k]) + 1) * mission.dt_s - mission.guard_s) if home[k] else None
            met = (finished_s is not None and finished_s <= entry.finish_by_s) if known.motion else None
            found.append(Deadline(entry.uav, entry.finish_by_s, finished_s if known.motion else None, met))
    return found


def _makespan_ratio(makespan_s: float | None, straight_s: Floats) -> float | None:
    """Return the makespan divided by the longest of the straight flights at full speed, which take `straight_s`."""
    longest_s = float(straight_s.max(initial=0.0))
    return makespan_s / longest_s if makespan_s is not None and longest_s else None


class _Separation(NamedTuple):
    """Numbers of colliding pairs and least distances, of tracked discs and of true bodies."""

    potential_collisions: int | None
    true_collisions: int | None
    min_disc_gap_m: float | None
    min_true_distance_m: float | None


def _separation(evidence: Evidence, known: Known) -> _Separation:
    mission, tracks, paths = evidence.mission, evidence.tracks, evidence.paths
    radius_m = np.array([entry.r_m for entry in mission.roster])
    body_m = np.array([entry.body_m for entry in mission.roster])
    from_m, to_m = tracks.seen_m
    true_m = tracks.bodies_m if paths is None else paths.moves_m(*tracks.bodies_m)
    overlaps, touches = _pairs(from_m, to_m, radius_m, -DISC_TOLERANCE_M), _pairs(*true_m, body_m, -BODY_TOLERANCE_M)
    return _Separation(
        overlaps or (0 if known.fixes else None),
        touches or (0 if known.places else None),
        _finite(least_gap_m(from_m, to_m, radius_m)) if known.fixes or overlaps else None,
        _finite(least_gap_m(*true_m, np.zeros_like(body_m))) if known.places or touches else None,
    )


def _disc_budget(mission: Mission) -> str:
    """Return the arithmetic of the tightest disc of a vehicle with inertia; "" if there is none."""
    budgets = [budget_of(mission, entry) for entry in mission.roster if not vehicle_of(mission, entry).is_ideal]
    return str(max(budgets, key=lambda budget: budget.needed_m - budget.r_m)) if budgets else ""


def _pairs(from_m: Floats, to_m: Floats, radius_m: Floats, below_m: float) -> int:
    met = encounters(from_m, to_m, radius_m, below_m)
    return len(set(zip(met.first.tolist(), met.second.tolist(), strict=True)))


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _extra_pct(path_m: Floats, ended_m: Floats) -> float | None:
    """Return 100 (sum of paths / sum of straight distances between their ends - 1)."""
    total_m = float(ended_m.sum())
    return max(0.0, 100 * (float(path_m.sum()) / total_m - 1)) if total_m else None


def _extra_mean_pct(path_m: Floats, ended_m: Floats, straight_m: Floats) -> float | None:
    """Return the mean of 100 (path / straight distance - 1) over the UAVs whose start is not their target."""
    going = straight_m > ARRIVED_M
    if not going.any():
        return None
    return max(0.0, float(np.mean(100 * (path_m[going] / ended_m[going] - 1))))


def _quantiles(values: Floats) -> Quantiles:
    if not len(values):
        return Quantiles(None, None, None)
    p50, p99, most = np.percentile(values, [50, 99, 100])
    return Quantiles(float(p50), float(p99), float(most))


def _held(columns: Columns, at_target: NDArray[np.bool_], first: int, last: int) -> NDArray[np.bool_]:
    """Return (S, K): True in the slots first..last where a UAV away from its target executes no command."""
    held = ~columns.executed & ~at_target[:-1] & columns.alive
    held[:first] = False
    held[last + 1 :] = False
    return held


def _ticks_late_pct(recording: Recording, ticks: int) -> float | None:
    """Late ticks among all slots begun; `late_ticks` counts within one life of a process."""
    late: dict[tuple[str, str], int] = {}
    for fix in recording.fixes:
        if fix.late_ticks:
            late[fix.uav, fix.instance] = max(fix.late_ticks, late.get((fix.uav, fix.instance), 0))
    return 100 * sum(late.values()) / ticks if ticks else None
