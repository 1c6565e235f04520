"""`edc-swarm figures`: the paper's figures and the energy bill, from simulated missions."""

from __future__ import annotations

import csv
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
from cyclopts import Parameter
from msgspec import Struct

from edc_swarm.errors import InputError
from edc_swarm.experiments.figures.catalogue import LONG, LONG_RUN, chosen, figures_of, runs_of
from edc_swarm.experiments.figures.findings import FigureFinding, finding
from edc_swarm.experiments.figures.table import Row, rows_of
from edc_swarm.experiments.sweeps import Run
from processes.experiments.figures_page import page
from processes.experiments.ledger import Ledger, open_scheduler, sweep
from processes.experiments.plots import check_plots, draw_figure, draw_heads
from processes.runtime.console import note, print_json
from processes.runtime.output import unwritten
from processes.runtime.run_facts import run_facts

MAX_FIGURE_RUNS = 10_000


class FiguresReport(Struct):
    """The results that `--json` prints."""

    out: str
    runs: int
    findings: dict[str, FigureFinding]
    rows: list[Row]


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class FiguresOptions:
    """Options of `figures`.

    Parameters
    ----------
    runs
        Missions per point, with seeds 0, 1, ... (30).
    only
        Make only this figure: 4a, 4b, 4c, 5a, 5b, 6a, 6b, energy-plan, energy-head, energy-minimise or energy-long;
        may be given more than once (all).
    jobs
        Processes that simulate at the same time (the number of processors).
    out
        Folder for figures, tables, page and runs (figures); a sweep that was stopped continues.
    scheduler
        Fly on the Dask cluster with this scheduler, such as tcp://host:8786 (extra "cluster").
    json
        Print findings and numbers as JSON alone on standard output.
    """

    runs: int = 30
    only: list[str] = field(default_factory=list)
    jobs: int | None = None
    out: Path = Path("figures")
    scheduler: str | None = None
    json: bool = False


def figures(*, options: FiguresOptions | None = None) -> int:
    """Compute the paper's figures again: PNG, SVG, PDF and CSV each, and a page with the findings."""
    options = options or FiguresOptions()
    if not 1 <= options.runs <= MAX_FIGURE_RUNS:
        raise InputError("--runs", options.runs, f"between 1 and {MAX_FIGURE_RUNS}")
    names = chosen(options.only)
    check_plots()
    runs = runs_of(names, options.runs)
    with open_scheduler(options.scheduler, options.jobs) as scheduler, Ledger(options.out) as ledger:
        if ledger.outdated:
            note(f"{ledger.outdated} runs in {options.out} were made by other code and are made again")
        results = sweep(runs, ledger, scheduler, "figures")
    try:
        rows, found = _write(options, names, runs, results)
    except OSError as error:
        raise unwritten("--out", options.out, error) from None
    _conclude(options, rows, found)
    return 0


def _write(
    options: FiguresOptions, names: Sequence[str], runs: Sequence[Run], results: Mapping[str, Any]
) -> tuple[dict[str, list[Row]], dict[str, FigureFinding]]:
    """Write every figure, its table, and the page."""
    rows, found = dict[str, list[Row]](), dict[str, FigureFinding]()
    for figure in figures_of(names):
        rows[figure.name] = rows_of(figure, options.runs, results)
        found[figure.name] = finding(figure.name, figure.claim, rows[figure.name])
        _write_csv(options.out / f"{figure.name}.csv", Row, rows[figure.name])
        draw_figure(figure, rows[figure.name], options.out / figure.name)
    if LONG in names:
        long = results[LONG_RUN.key]
        _write_table(options.out / f"{LONG}.csv", long["bills"])
        draw_heads(long, options.out / LONG)
    facts = {**run_facts("virtual"), "runs": str(options.runs), "machine": _machine()}
    (options.out / "index.html").write_text(
        page(figures_of(names), found, rows, results, runs, facts), encoding="utf-8"
    )
    return rows, found


def _write_csv(path: Path, kind: type[Struct], rows: Sequence[Struct]) -> None:
    _write_table(path, [msgspec.to_builtins(row) for row in rows], kind.__struct_fields__)


def _write_table(path: Path, rows: Sequence[Mapping[str, Any]], names: Sequence[str] = ()) -> None:
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, names or list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def _machine() -> str:
    """Return the names of processor, machine and Python version."""
    try:
        described = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        described = []
    model = next((row.partition(":")[2].strip() for row in described if row.startswith("model name")), "")
    parts = (model, run_facts("virtual")["machine"], f"Python {platform.python_version()}")
    return ", ".join(part for part in parts if part)


def _conclude(options: FiguresOptions, rows: Mapping[str, list[Row]], found: Mapping[str, FigureFinding]) -> None:
    if options.json:
        every = [row for own in rows.values() for row in own]
        print_json(FiguresReport(str(options.out), options.runs, dict(found), every))
        return
    for name, result in found.items():
        print(f"{name}: {result.verdict}. {result.claim}")
        for sentence in result.found:
            print(f"    {sentence}")
    print(options.out / "index.html")
