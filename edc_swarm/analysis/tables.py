"""The table of a run's metrics, as rows of name and value, for the terminal and the report page."""

from __future__ import annotations

from collections.abc import Sequence

from edc_swarm.analysis.head_terms import HeadTerm
from edc_swarm.analysis.information_age import Age
from edc_swarm.analysis.metrics import Deadline, Metrics, Quantiles
from edc_swarm.analysis.outcome import NotHome

MAX_HEADS = 6
MAX_NAMED = 10
"""Most UAVs whose reason for not being home is printed; `--json` contains all."""


def metric_rows(m: Metrics) -> list[tuple[str, str]]:
    """Return the rows (name, value) of a run's metrics."""
    away = f"; beside their targets, which stay covered: {', '.join(m.beside)}" if m.beside else ""
    away += f"; not living: {', '.join(m.not_living)}" if m.not_living else ""
    away += f"; {len(m.unknown)} unknown" if m.unknown else ""
    zones = [(m.inclusion_zones, "inclusion"), (m.exclusion_zones, "exclusion")]
    zones_said = ", ".join(f"{count} {kind}" for count, kind in zones if count)
    undone = [("faults not done", "; ".join(m.faults_undone))] if m.faults_undone else []
    return [
        ("arrived", f"{_count(m.arrived)} of {m.uavs}{away}"),
        *_not_home(m),
        *([("zones", zones_said)] if zones_said else []),
        *_landed(m),
        *_goals(m),
        *_deadlines(m),
        ("slots", f"{_slots(m)}, {_count(m.slots_missed)} without commands"),
        *([] if m.clusters else [("heads", _heads(m.heads) or _no_head(m))]),
        *_clusters(m),
        ("collisions", f"{_count(m.potential_collisions)} potential, {_count(m.true_collisions)} true"),
        ("least gap", _gap(m)),
        *_vehicles(m),
        ("way flown", "-" if m.path_m is None else f"{m.path_m:.1f} m{_extra(m)}"),
        ("makespan", _makespan(m)),
        ("energy", f"{_kj(m.energy_propulsion_j)}, straight {_kj(m.energy_straight_j)}"),
        *([] if m.control == "local" else _of_heads(m)),
        *_held(m),
        ("late ticks", _number(m.ticks_late_pct, "%")),
        ("messages", f"{m.messages}, {_count(m.gaps)} gaps" + _late_and_twice(m)),
        *undone,
    ]


def _heads(heads: Sequence[HeadTerm]) -> str:
    named = [f"{h.head} (term {h.term}, slots {h.first_slot}-{h.last_slot})" for h in heads[:MAX_HEADS]]
    return ", ".join([*named, *["..."] * (len(heads) > MAX_HEADS)])


def _no_head(m: Metrics) -> str:
    return "none: control is local, every UAV plans for itself" if m.control == "local" else "none recorded"


def _of_heads(m: Metrics) -> list[tuple[str, str]]:
    """Return the rows about plans and commands of heads, which a mission without a head does not have."""
    return [
        ("plan time", _quantiles(m.plan_ms)),
        ("fix to command", _quantiles(m.fix_to_command_ms)),
        ("age of fixes", _age(m.fix_age_ms)),
        ("age of commands", _age(m.command_age_ms)),
    ]


def _gap(m: Metrics) -> str:
    if m.uavs == 1:
        return "none, with one UAV"
    return f"{_number(m.min_disc_gap_m, 'm')} between discs, {_number(m.min_true_distance_m, 'm')} true distance"


def _clusters(m: Metrics) -> list[tuple[str, str]]:
    """Return a row with the heads of each cluster; none for a mission with one."""
    return [
        (
            f"cluster {each.name}",
            f"{_count(each.arrived)} of {each.uavs} arrived; {each.messages} messages; heads: "
            + (_heads(each.heads) or "none recorded"),
        )
        for each in m.clusters
    ]


def _vehicles(m: Metrics) -> list[tuple[str, str]]:
    """Return a row with the budget of the tightest disc and the largest deviation; no row without inertia."""
    said = f"{m.disc_budget}; at most {_number(m.max_deviation_m, 'm')} from the declared path"
    return [("true paths", said)] if m.disc_budget else []


def _not_home(m: Metrics) -> list[tuple[str, str]]:
    """Return a row with the UAVs that are not home and their reasons, and one with those of which that is unknown."""
    known, unknown = ([who for who in m.not_home if who.is_unknown is flag] for flag in (False, True))
    return [(name, _named(who)) for name, who in (("not home", known), ("unknown", unknown)) if who]


def _named(astray: Sequence[NotHome]) -> str:
    more = [f"and {len(astray) - MAX_NAMED} more"] * (len(astray) > MAX_NAMED)
    return "; ".join([*(str(who).replace(": unknown:", ":", 1) for who in astray[:MAX_NAMED]), *more])


def _slots(m: Metrics) -> str:
    return "-" if m.slots is None else f"{m.slots} ({m.duration_s:g} s)"


def _goals(m: Metrics) -> list[tuple[str, str]]:
    if m.goals_per_minute is None:
        return []
    return [("goals", f"{m.goals_reached} reached, {m.goals_per_minute:.1f} a minute")]


def _deadlines(m: Metrics) -> list[tuple[str, str]]:
    """Return a row with the UAVs that missed their time to finish; no row if no UAV has such a time."""
    if not m.deadlines:
        return []
    missed = [deadline for deadline in m.deadlines if deadline.met is False]
    unknown = sum(deadline.met is None for deadline in m.deadlines)
    named = [f"missed by {d.uav} ({_finished(d)})" for d in missed[:MAX_NAMED]]
    named += [f"and {len(missed) - MAX_NAMED} more"] * (len(missed) > MAX_NAMED) + [f"{unknown} unknown"] * (
        unknown > 0
    )
    met = sum(deadline.met is True for deadline in m.deadlines)
    return [("finish times", "; ".join([f"{met} of {len(m.deadlines)} met", *named]))]


def _finished(d: Deadline) -> str:
    if d.finished_s is None:
        return f"not there, by {d.finish_by_s:g} s"
    return f"{d.finished_s - d.finish_by_s:.2f} s late"


def _landed(m: Metrics) -> list[tuple[str, str]]:
    """Return a row with the UAVs that the failsafe has made land; no row if there are none."""
    named = [str(landing) for landing in m.landed[:MAX_NAMED]]
    named += [f"and {len(m.landed) - MAX_NAMED} more"] * (len(m.landed) > MAX_NAMED)
    return [("landed", "; ".join(named))] if named else []


def _makespan(m: Metrics) -> str:
    if not m.makespan_s:
        return "-"
    whose = "" if m.completed else " of the living UAVs"
    return f"{m.makespan_s:.2f} s{whose}, {_number(m.makespan_ratio, '')} times the least"


def _extra(m: Metrics) -> str:
    if m.extra_distance_pct is None:
        return ""
    whose = ", " if m.arrived == m.uavs else "; by those at their targets "
    return f"{whose}{_number(m.extra_distance_pct, '%')} more than straight"


def _count(value: int | None) -> str:
    return "-" if value is None else str(value)


def _kj(value_j: float | None) -> str:
    return "-" if value_j is None else f"{value_j / 1e3:.2f} kJ"


def _number(value: float | None, unit: str) -> str:
    return "-" if value is None else f"{round(value, 2) + 0.0:.2f} {unit}".rstrip()


def _quantiles(q: Quantiles) -> str:
    return f"{_number(q.p50, 'ms')} median, {_number(q.p99, 'ms')} p99, {_number(q.max, 'ms')} max"


def _age(age: Age) -> str:
    peaks = f"peaks {_number(age.peak_mean, 'ms')} mean, {_number(age.peak_p99, 'ms')} p99"
    return f"{_number(age.mean, 'ms')} mean, {_number(age.p99, 'ms')} p99; {peaks}"


def _held(m: Metrics) -> list[tuple[str, str]]:
    """Return a row with the shares of the causes of holds; no row if no UAV held."""
    if m.slots_held == 0:
        return []
    if m.slots_held is None or m.slots_held_by is None:
        return [("slots held", f"{_count(m.slots_held)} UAV-slots, causes unknown" if m.slots_held else "-")]
    shares = [f"{100 * count / m.slots_held:.0f} % {cause}" for cause, count in m.slots_held_by.items()]
    return [("slots held", f"{m.slots_held} UAV-slots: {', '.join(shares)}")]


def _late_and_twice(m: Metrics) -> str:
    fetched = f", {m.fetched} fetched again" if m.fetched else ""
    return fetched + (f", {m.duplicates} duplicates dropped" if m.duplicates else "")
