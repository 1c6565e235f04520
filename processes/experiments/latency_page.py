"""The HTML page of a latency experiment, with its findings, every figure and every cell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

from edc_swarm.experiments.latency.findings import LatencyFinding
from edc_swarm.experiments.latency.quantities import QUANTITIES
from edc_swarm.experiments.latency.table import CellRow
from edc_swarm.experiments.statistics import Estimate
from processes.experiments.figures_page import META, STYLE
from processes.experiments.zenoh_baseline import Baseline

TITLE = "Latency experiments"
EXTRA_STYLE = (
    "img { max-width: 60rem; } .cells td { white-space: nowrap; } .hold { color: #666; } .bad { background: #fdd; }"
)
MARKS = {True: '<b class="yes">as promised</b>', False: '<b class="no">not as promised</b>', None: ""}
HEADINGS = (
    "engine",
    "UAVs",
    "slot [s]",
    "delay [ms]",
    "jitter [ms]",
    "loss [%]",
    "runs (invalid)",
    "limit [slots]",
    "in time, predicted [%]",
    "completed [%]",
    "overlaps",
    "collisions",
    "least gap [m]",
    "terms",
    "late ticks [%]",
)
SHOWN = tuple(quantity for quantity in QUANTITIES if quantity.name not in {"completed_pct", "min_disc_gap_m"})


def page(
    rows: Sequence[CellRow],
    found: Sequence[LatencyFinding],
    notes: Sequence[str],
    figures: Mapping[str, Sequence[str]],
    facts: Mapping[str, str],
) -> str:
    """Return the whole page as HTML. `figures` has the file stems of the pictures of each quantity."""
    parts = [_introduction(facts, any(row.engine == "processes" for row in rows)), _findings(found, notes)]
    parts += [_figures(quantity.label, figures[quantity.name]) for quantity in QUANTITIES if quantity.name in figures]
    parts.append(_cells(rows))
    body = "\n".join(parts)
    return (
        f'<!doctype html>\n<html lang="en"><head>{META}<title>{TITLE}</title>'
        f"<style>{STYLE}{EXTRA_STYLE}</style></head>\n<body>\n{body}\n</body></html>\n"
    )


def _introduction(facts: Mapping[str, str], real: bool) -> str:
    others = ' and of <a href="processes/runs.jsonl">processes/runs.jsonl</a>' if real else ""
    return (
        f"<h1>{TITLE}</h1><p><code>{escape(facts['command'])}</code>, commit {escape(facts['commit'] or 'unknown')},"
        f" {escape(facts['machine'])}. Delay, jitter and loss are emulated in the receiving agent, above the bus, by"
        " the same seeded model in the simulator and in real processes. Means over valid runs, bands are 95 %"
        " confidence intervals (Wilson's for shares of missions, Poisson's for counts, else Student's t);"
        " extra distance, makespan and energy are of missions that brought every"
        ' UAV home. Every run, with the command that repeats it, is a line of <a href="runs.jsonl">runs.jsonl</a>'
        f"{others};"
        ' every cell is a line of <a href="cells.csv">cells.csv</a>.</p>'
    )


def _findings(found: Sequence[LatencyFinding], notes: Sequence[str]) -> str:
    lines = "".join(f"<li>{MARKS[one.kept]} {escape(one.text)}</li>" for one in found)
    return f"<ul>{lines}{''.join(f'<li>{escape(note)}</li>' for note in notes)}</ul>"


def _figures(label: str, stems: Sequence[str]) -> str:
    pictures = "".join(
        f'<img src="{stem}.svg" alt="{escape(label)}, {stem}">'
        f'<p><a href="{stem}.png">PNG</a> <a href="{stem}.svg">SVG</a> <a href="{stem}.pdf">PDF</a></p>'
        for stem in stems
    )
    return f"<section><h2>{escape(label)}</h2>{pictures}</section>"


def _cells(rows: Sequence[CellRow]) -> str:
    head = "".join(f"<th>{escape(name)}</th>" for name in (*HEADINGS, *(quantity.label for quantity in SHOWN)))
    return (
        f'<section><h2>Every cell</h2><table class="cells"><tr>{head}</tr>{"".join(map(_cell, rows))}</table>'
        "<p>Grey: only heads have flown commands. Limit: missions longer than this are given up; it is short where"
        " the slot arithmetic says that nothing else can happen.</p></section>"
    )


def _cell(row: CellRow) -> str:
    bad = row.potential_collisions or row.true_collisions or row.broken
    kind = "bad" if bad else "hold" if row.only_holds else ""
    values = [*words(row), *(_mean(row.quantities.get(quantity.name)) for quantity in SHOWN)]
    return f'<tr class="{kind}">{"".join(f"<td>{escape(value)}</td>" for value in values)}</tr>'


def words(row: CellRow) -> list[str]:
    """Return the texts below `HEADINGS` for one cell."""
    cell = row.cell
    invalid = f" ({row.invalid_runs})" if row.invalid_runs else ""
    return [
        row.engine,
        f"{cell.uavs}",
        f"{cell.slot_s:g}",
        f"{cell.delay_ms:g}",
        f"{cell.jitter_ms:g}",
        f"{100 * cell.loss:g}",
        f"{row.runs}{invalid}",
        f"{row.limit_slots}",
        f"{row.predicted_in_time_pct:.0f}",
        "-" if row.completed_pct is None else f"{row.completed_pct:.0f}",
        "-" if row.potential_collisions is None else f"{row.potential_collisions}",
        "-" if row.true_collisions is None else f"{row.true_collisions}",
        "-" if row.min_disc_gap_m is None else f"{row.min_disc_gap_m:.3f}",
        f"{row.terms:.1f}",
        "-" if row.ticks_late_pct is None else f"{row.ticks_late_pct:.2f}",
    ]


def baseline_notes(baseline: Baseline | None) -> list[str]:
    """Return the baseline in a sentence, if it was measured."""
    if baseline is None:
        return []
    answer, trip = baseline.put_to_answer_ms, baseline.round_trip_ms
    return [
        f"Zenoh baseline, {baseline.uavs} processes, one of which collects and answers, through the same router: from"
        f" put to answer {answer.p50:.2f} ms (median; 99 %: {answer.p99:.2f} ms), round trip {trip.p50:.2f} ms"
        f" ({trip.p99:.2f} ms), {baseline.lost} lost."
    ]


def _mean(found: Estimate | None) -> str:
    return "-" if found is None else f"{found.mean:.4g}"
