"""The results of a run as text for a terminal, computed from the recording alone."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console
from rich.table import Table
from rich.text import Text

from edc_swarm.analysis.guarantees.verdict import GuaranteeResult, safety
from edc_swarm.analysis.metrics import Metrics
from edc_swarm.analysis.tables import metric_rows
from edc_swarm.foreign_text import MAX_LINE, shown
from processes.runtime.console import FAILED, NOT_JUDGED, print_line

MAX_NOTES = 100_000
"""Characters of the line with all notes on one guarantee, each of which is up to `MAX_LINE` long."""


def print_metrics(metrics: Metrics, console: Console) -> None:
    """Print the table of metrics: on a terminal with values that wrap in their column, elsewhere a line for each."""
    rows = [(name, shown(value, MAX_LINE)) for name, value in metric_rows(metrics)]
    if console.soft_wrap:
        width = max(len(name) for name, _ in rows)
        for name, value in rows:
            console.print(f"{name:<{width}}  {value}", markup=False)
        return
    table = Table(show_header=False, box=None, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column(style="bold")
    table.add_column()
    for name, value in rows:
        table.add_row(name, Text(value.replace("; ", ";\n")))
    console.print(table)


def print_guarantees(results: Sequence[GuaranteeResult], console: Console, limit: int = 1000) -> None:
    """Print the verdict on every guarantee with its first `limit` violations, and whether the UAVs were safe."""
    for result in results:
        notes = f" ({_some(result.notes, limit)})" if result.notes else ""
        line = f"{result.guarantee} {result.title}: {result.words}{notes}"
        print_line(shown(line, MAX_NOTES), console)
        for where in result.where[:limit]:
            print_line(f"    {shown(where, MAX_LINE)}", console)
        if len(result.where) > limit:
            console.print(f"    ... {result.counted}", markup=False)
    print_line(shown(safety(results), MAX_LINE), console)


def guarantees_status(results: Sequence[GuaranteeResult]) -> int:
    """Return the exit status for verdicts: 1 when one is broken, else 3 when one was not judged, else 0."""
    if any(result.broken for result in results):
        return FAILED
    return 0 if all(result.judged for result in results) else NOT_JUDGED


def _some(texts: Sequence[str], limit: int) -> str:
    more = f"; ... {len(texts)} in all" if len(texts) > limit else ""
    return "; ".join(shown(text, MAX_LINE) for text in texts[:limit]) + more
