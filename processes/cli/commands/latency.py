"""`edc-swarm latency`: the effects of delay, jitter and loss, in the simulator or with real processes."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from cyclopts import Parameter
from msgspec import Struct
from rich.table import Table

from edc_swarm.analysis.latency_sample import Sample
from edc_swarm.errors import InputError
from edc_swarm.experiments.latency.declared import Cell, Engine, LatencySweep, in_turn, run_name, runs_of, sweep_of
from edc_swarm.experiments.latency.findings import LatencyFinding, findings, is_judged, is_safe
from edc_swarm.experiments.latency.quantities import QUANTITIES, Quantity
from edc_swarm.experiments.latency.table import CellRow, flat, rows_of
from edc_swarm.experiments.sweeps import Run, command_of, mission_toml
from edc_swarm.foreign_text import MAX_LINE, shown
from edc_swarm.mission.stated import named_as_options
from edc_swarm.mission.validation import load_mission, read_toml
from processes.cli.options import swept
from processes.experiments.latency_page import baseline_notes, page, words
from processes.experiments.latency_plots import Axis, draw_quantity
from processes.experiments.ledger import Ledger, Scheduler, open_scheduler, sweep
from processes.experiments.plots import check_plots
from processes.experiments.real_runs import Launched, launched_fingerprint
from processes.experiments.zenoh_baseline import Baseline, measure_baseline
from processes.runtime.console import FAILED, NOT_JUDGED, note, print_json, stdout_console
from processes.runtime.output import unwritten
from processes.runtime.run_facts import run_facts

LISTS = {"delays": "delays_ms", "jitters": "jitters_ms", "losses": "losses", "slots": "slots_s", "uavs": "uavs"}
"""Field of the sweep that an option with a list sets."""
PLAIN = ("engine", "repeats", "max_slots", "hold_slots")
"""Fields of the sweep that options of the same names set."""
LAUNCHED = "processes"
"""Folder of the runs with real processes, in that of the sweep."""
BASELINE_SLOTS = 40
TABLE_WIDTH = 116
COLUMNS = (
    "engine",
    "UAVs",
    "slot s",
    "delay ms",
    "jitter ms",
    "loss %",
    "runs",
    "limit",
    "in time %",
    "done %",
    "overlaps",
    "collisions",
    "gap m",
    "terms",
    "late %",
)
"""The columns of the page's table, in few words."""
TITLES: dict[Engine, str] = {"sim": "simulated", "processes": "real processes"}
AXES: dict[Axis, str] = {"delay_ms": "delay", "loss": "loss"}


class LatencyReport(Struct):
    """The results that `--json` prints."""

    out: str
    findings: list[LatencyFinding]
    floor: Baseline | None
    cells: list[dict[str, Any]]


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class LatencyOptions:
    """Options of `latency`; without one the sweep file decides, else the engine's default.

    Parameters
    ----------
    engine
        sim, or processes: real ones, one mission at a time, the same cells simulated beside them (sim).
    repeats
        Missions per cell, with seeds 0, 1, ...
    max_slots
        Slots after which a mission is given up (as many as G7 needs for a verdict, see `sim --help`).
    hold_slots
        The same where two delays fill a slot, so that the swarm can only hold.
    mission
        Mission file (TOML) with all other fields.
    jobs
        Processes that simulate at the same time (the number of processors).
    scheduler
        Simulate on the Dask cluster with this scheduler, such as tcp://host:8786 (extra "cluster").
    out
        Folder for tables, plots, page, recordings and runs (latency); a sweep that was stopped continues.
    json
        Print findings and cells as JSON alone on standard output.
    """

    engine: Literal["sim", "processes"] | None = None
    delays: Annotated[str | None, swept("delay_ms")] = None
    jitters: Annotated[str | None, swept("jitter_ms")] = None
    losses: Annotated[str | None, swept("loss")] = None
    slots: Annotated[str | None, swept("dt_s")] = None
    uavs: Annotated[str | None, swept("uavs")] = None
    repeats: int | None = None
    max_slots: int | None = None
    hold_slots: int | None = None
    mission: Path | None = None
    jobs: int | None = None
    scheduler: str | None = None
    out: Path = Path("latency")
    json: bool = False

    def sweep(self, file: Path | None) -> LatencySweep:
        """Return the sweep: the file, with options in place of its fields, completed by defaults."""
        raw = read_toml("sweep file", file) if file is not None else {}
        given = {name: value for name in PLAIN if (value := getattr(self, name)) is not None}
        lists = {LISTS[name]: _numbers(name, text) for name in LISTS if (text := getattr(self, name)) is not None}
        options = {field: name for name, field in LISTS.items() if field in lists} | {name: name for name in given}
        if self.mission is not None:
            raw["mission"] = msgspec.to_builtins(load_mission(self.mission, "--mission"))
        with named_as_options({field: f"--{name.replace('_', '-')}" for field, name in options.items()}):
            return sweep_of({**raw, **given, **lists})


def latency(
    sweep_file: Annotated[Path | None, Parameter(help="Sweep file (TOML); without one, the engine's defaults.")] = None,
    /,
    *,
    options: LatencyOptions | None = None,
) -> int:
    """Fly a grid of delays, jitters and losses; write a table, plots with confidence bands, and the findings."""
    options = options or LatencyOptions()
    declared = options.sweep(sweep_file)
    check_plots()
    try:
        rows, floor = _fly(declared, options)
    except KeyboardInterrupt:
        note(f"interrupted: the same command goes on where it was, in {options.out}")
        return FAILED
    found = findings(rows)
    try:
        _write(options.out, rows, found, floor)
    except OSError as error:
        raise unwritten("--out", options.out, error) from None
    _conclude(options, rows, found, floor)
    if not is_safe(rows):
        return FAILED
    return 0 if is_judged(rows) else NOT_JUDGED


def _fly(declared: LatencySweep, options: LatencyOptions) -> tuple[list[CellRow], Baseline | None]:
    """Make all runs; with real processes, the baseline too."""
    rows = _simulated(declared, options)
    if declared.engine == "sim":
        return rows, None
    rows += _launched(declared, options)
    slot_s = declared.slots_s[0] / declared.mission.time_scale
    return rows, measure_baseline(declared.uavs[0], slot_s, BASELINE_SLOTS)


def _numbers(option: str, text: str) -> list[float]:
    try:
        values = [float(word) for word in text.split(",")]
    except ValueError:
        raise InputError(f"--{option}", text, "numbers separated by commas") from None
    return [int(value) if value.is_integer() else value for value in values]


def _simulated(declared: LatencySweep, options: LatencyOptions) -> list[CellRow]:
    with open_scheduler(options.scheduler, options.jobs) as scheduler:
        return _flown(declared, "sim", options.out, scheduler)


def _launched(declared: LatencySweep, options: LatencyOptions) -> list[CellRow]:
    folder = options.out / LAUNCHED
    return _flown(declared, "processes", folder, Launched(folder / "recordings"), launched_fingerprint())


def _flown(
    declared: LatencySweep, engine: Engine, folder: Path, scheduler: Scheduler, code: str | None = None
) -> list[CellRow]:
    """Make the runs that `folder` does not hold yet; return the rows of all cells."""
    with Ledger(folder, code) as ledger:
        if ledger.outdated:
            note(f"{ledger.outdated} runs in {folder} were made by other code and are made again")
        runs = {cell: [_with_file(run, folder) for run in own] for cell, own in runs_of(declared, engine).items()}
        results = sweep(in_turn(runs), ledger, scheduler, TITLES[engine])
    return _rows(declared, engine, runs, results)


def _rows(
    declared: LatencySweep, engine: Engine, runs: Mapping[Cell, Sequence[Run]], results: Mapping[str, Any]
) -> list[CellRow]:
    samples = {
        cell: [msgspec.convert(results[run.key], Sample) for run in cell_runs] for cell, cell_runs in runs.items()
    }
    return rows_of(declared, engine, samples)


def _with_file(run: Run, folder: Path) -> Run:
    """Return the same run; a run that options cannot express gets a mission file in `folder`."""
    try:
        command_of(run.mission)
    except InputError:
        file = folder / "missions" / f"{run_name(run.mission)}.toml"
        try:
            file.parent.mkdir(exist_ok=True)
            file.write_text(mission_toml(run.mission), encoding="utf-8")
        except OSError as error:
            raise unwritten("--out", folder, error) from None
        return replace(run, file=str(file))
    return run


def _write(folder: Path, rows: Sequence[CellRow], found: Sequence[LatencyFinding], floor: Baseline | None) -> None:
    """Write the table, every figure and the page."""
    lines = [flat(row) for row in rows]
    with (folder / "cells.csv").open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, list(lines[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(lines)
    figures = {quantity.name: list(_draw(quantity, rows, folder)) for quantity in QUANTITIES}
    text = page(rows, found, baseline_notes(floor), figures, run_facts("virtual"))
    (folder / "index.html").write_text(text, encoding="utf-8")


def _draw(quantity: Quantity, rows: Sequence[CellRow], folder: Path) -> Iterator[str]:
    """Draw one quantity over every axis that has more than one value; yield the stems of the pictures."""
    slots_s = list(dict.fromkeys(row.cell.slot_s for row in rows))
    for slot_s in slots_s:
        own = [row for row in rows if row.cell.slot_s == slot_s]
        for axis, name in AXES.items():
            if len({getattr(row.cell, axis) for row in own}) < 2:
                continue
            stem = f"{quantity.name}-by-{name}" + (f"-slot-{1e3 * slot_s:g}ms" if len(slots_s) > 1 else "")
            draw_quantity(quantity, axis, own, folder / stem)
            yield stem


def _conclude(
    options: LatencyOptions, rows: Sequence[CellRow], found: Sequence[LatencyFinding], floor: Baseline | None
) -> None:
    if options.json:
        print_json(LatencyReport(str(options.out), list(found), floor, [flat(row) for row in rows]))
        return
    console = stdout_console()
    console.width = max(console.width, TABLE_WIDTH)
    console.print(_table(rows))
    for one in found:
        print(shown({True: "as promised: ", False: "NOT as promised: ", None: ""}[one.kept] + one.text, MAX_LINE))
    for text in baseline_notes(floor):
        print(text)
    print(options.out / "index.html")


def _table(rows: Sequence[CellRow]) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0))
    for name in COLUMNS:
        table.add_column(name, justify="right")
    for row in rows:
        table.add_row(*words(row))
    return table
