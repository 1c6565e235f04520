"""What a run has come to: the table that a person reads, computed from the recording alone."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rich.console import Console
from rich.table import Table

from edc_swarm.invariants import GuaranteeResult
from edc_swarm.metrics import Metrics, Quantiles


def print_metrics(metrics: Metrics, console: Console) -> None:
    """Print the table of metrics."""
    table = Table(show_header=False, box=None, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column(style="bold")
    table.add_column()
    for name, value in _rows(metrics):
        table.add_row(name, value)
    console.print(table)


def print_guarantees(results: Sequence[GuaranteeResult], console: Console, limit: int = 1000) -> None:
    """Print the verdict on every guarantee, with the first `limit` violations of each."""
    for result in results:
        notes = f" ({_some(result.notes, limit)})" if result.notes else ""
        console.print(f"{result.guarantee} {result.title}: {result.status.replace('-', ' ')}{notes}", markup=False)
        for where in result.where[:limit]:
            console.print(f"    {where}", markup=False)
        if len(result.where) > limit:
            console.print(f"    ... {len(result.where)} in all", markup=False)


def _some(texts: Sequence[str], limit: int) -> str:
    more = f"; ... {len(texts)} in all" if len(texts) > limit else ""
    return "; ".join(texts[:limit]) + more


def _rows(m: Metrics) -> Iterable[tuple[str, str]]:
    heads = ", ".join(f"{h.head} (term {h.term}, slots {h.first_slot}-{h.last_slot})" for h in m.heads[:6])
    away = f"; not living: {', '.join(m.not_living)}" if m.not_living else ""
    return (
        ("arrived", f"{m.arrived} of {m.uavs}{away}"),
        ("slots", f"{m.slots} ({m.duration_s:g} s), {m.slots_missed} without commands"),
        ("heads", (heads + (", ..." if len(m.heads) > 6 else "")) or "none"),
        ("collisions", f"{m.potential_collisions} potential, {m.true_collisions} true"),
        (
            "least gap",
            f"{_number(m.min_disc_gap_m, 'm')} between discs, {_number(m.min_true_distance_m, 'm')} true distance",
        ),
        ("way flown", f"{m.path_m:.1f} m, {_number(m.extra_distance_pct, '%')} more than straight"),
        ("makespan", f"{_number(m.makespan_s, 's')}, {_number(m.makespan_ratio, '')} times the least"),
        ("energy", f"{m.energy_propulsion_j / 1e3:.2f} kJ, straight {m.energy_straight_j / 1e3:.2f} kJ"),
        ("plan time", _quantiles(m.plan_ms)),
        ("fix to command", _quantiles(m.fix_to_command_ms)),
        ("late ticks", f"{m.ticks_late_pct:.2f} %"),
        ("messages", f"{m.messages}, {m.gaps} gaps"),
    )


def _number(value: float | None, unit: str) -> str:
    return "-" if value is None else f"{value:.2f} {unit}".rstrip()


def _quantiles(q: Quantiles) -> str:
    return f"{_number(q.p50, 'ms')} median, {_number(q.p99, 'ms')} p99, {_number(q.max, 'ms')} most"
