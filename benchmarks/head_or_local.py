"""Head or local: the same missions over the same network, planned by a head or by every UAV for itself.

    python benchmarks/head_or_local.py --uavs 10 --runs 5                 delays 0-400 ms, loss 0-50 %: flies and draws
    python benchmarks/head_or_local.py --uavs 10 30 --runs 30 --jobs 2    the whole grid: hours
    python benchmarks/head_or_local.py --uavs 30 --delays 0 --controls orca bvc cbf    some of it
    python benchmarks/head_or_local.py --uavs 10 --runs 5 --draw          draws what is there

Every run is one simulated random mission on 10 000 m2 without a fence; its seed is its number, so all controls fly the
same missions. Runs are kept one a line in FILE.jsonl: a second call flies only those that are missing. The table is
FILE.md, the figures are FILE-kK.svg and .png. Intervals are those of `edc_swarm.experiments.statistics`: Wilson's for
shares of runs, Garwood's or Student's for counts.

Extra distance, makespan and energy are means over the runs that completed, so a control that completes only the easy
missions looks better there than it is: read them beside the completion.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from concurrent.futures import as_completed
from pathlib import Path
from typing import Any, NamedTuple

from edc_swarm.experiments.statistics import Estimate, Kind, estimate
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.link import Link
from processes.experiments.workers import workers

CONTROLS: dict[str, dict[str, Any]] = {
    "head: edc": {"planner": "edc"},
    "head: edc, 40 resends": {"planner": "edc", "resends": 40},
    "local: orca": {"planner": "orca", "control": "local"},
    "local: bvc": {"planner": "bvc", "control": "local"},
    "local: cbf": {"planner": "cbf", "control": "local"},
}
COLOURS = dict(zip(CONTROLS, ("#1b1b1b", "#4c9f70", "#d1495b", "#2e86ab", "#e09f3e"), strict=True))
MOST_SLOTS = 300
"""Slots after which a mission counts as not completed: five times what `edc` needs."""


class Cell(NamedTuple):
    uavs: int
    delay_ms: float
    loss: float
    control: str


class Quantity(NamedTuple):
    name: str
    title: str
    kind: Kind
    completed_only: bool


QUANTITIES = (
    Quantity("collisions", "pairs whose discs overlap", "count", False),
    Quantity("completed", "runs completed, %", "share of runs", False),
    Quantity("extra_pct", "extra distance, %", "amount", True),
    Quantity("makespan_s", "makespan, s", "amount", True),
    Quantity("messages", "messages per UAV and slot", "amount", False),
    Quantity("energy_kj", "propulsion energy, kJ", "amount", True),
)


def fly_one(cell: Cell, seed: int) -> dict[str, Any]:
    from edc_swarm.analysis.metrics import compute_metrics  # noqa: PLC0415  (drawing needs no simulator)
    from processes.experiments.measures import simulate  # noqa: PLC0415

    link = Link(delay_ms=cell.delay_ms, loss=cell.loss)
    recording, timings = simulate(
        Mission(
            uavs=cell.uavs, seed=seed, fence="none", max_slots=MOST_SLOTS, link=[link], **CONTROLS[cell.control]
        )
    )  # fmt: skip
    metrics = compute_metrics(recording, timings)
    said = len(recording.fixes) + len(recording.commands) + len(recording.reports)
    energy_j = metrics.energy_propulsion_j
    return {
        "collisions": metrics.potential_collisions,
        "bodies": metrics.true_collisions,
        "completed": 100.0 * bool(metrics.completed),
        "extra_pct": metrics.extra_distance_pct,
        "makespan_s": metrics.makespan_s,
        "messages": said / (cell.uavs * (metrics.slots or 1)),
        "energy_kj": None if energy_j is None else energy_j / 1e3,
        "plan_ms": metrics.plan_ms.p50,
        "gap_m": metrics.min_disc_gap_m,
    }


def read(path: Path) -> dict[tuple[Cell, int], dict[str, Any]]:
    if not path.exists():
        return {}
    rows = [json.loads(line) for line in path.read_text().splitlines() if line.endswith("}")]
    return {(Cell(*row["cell"]), row["seed"]): row["measured"] for row in rows}


def fly(cells: Sequence[Cell], runs: int, path: Path, jobs: int) -> None:
    known = read(path)
    missing = [(cell, seed) for seed in range(runs) for cell in cells if (cell, seed) not in known]
    with path.open("a") as stream, workers(jobs) as pool:
        flights = {pool.submit(fly_one, cell, seed): (cell, seed) for cell, seed in missing}
        for done, flight in enumerate(as_completed(flights), start=1):
            cell, seed = flights[flight]
            stream.write(json.dumps({"cell": list(cell), "seed": seed, "measured": flight.result()}) + "\n")
            stream.flush()
            print(f"run {done} of {len(missing)}: {cell}, seed {seed}", flush=True)


def estimates(measured: dict[tuple[Cell, int], dict[str, Any]], cell: Cell, quantity: Quantity) -> Estimate | None:
    """Return the estimate of a quantity in a cell, None if no run of it counts."""
    runs = [row for (of, _), row in measured.items() if of == cell]
    if quantity.completed_only:
        runs = [row for row in runs if row["completed"]]
    values = [row[quantity.name] for row in runs if row[quantity.name] is not None]
    return estimate(values, quantity.kind) if values else None


def table(measured: dict[tuple[Cell, int], dict[str, Any]], cells: Sequence[Cell]) -> Iterator[str]:
    yield "| K | delay, ms | loss, % | control | runs | " + " | ".join(each.title for each in QUANTITIES) + " |"
    yield "|---" * (5 + len(QUANTITIES)) + "|"
    for cell in cells:
        runs = sum(of == cell for of, _ in measured)
        found = [_shown(estimates(measured, cell, each)) for each in QUANTITIES]
        head = f"| {cell.uavs} | {cell.delay_ms:g} | {100 * cell.loss:g} | {cell.control} | {runs} |"
        yield f"{head} {' | '.join(found)} |"


def _shown(found: Estimate | None) -> str:
    if found is None:
        return "-"
    if found.low is None or found.high is None:
        return f"{found.mean:.3g}"
    return f"{found.mean:.3g} ({found.low:.3g}-{found.high:.3g})"


def draw(measured: dict[tuple[Cell, int], dict[str, Any]], cells: Sequence[Cell], path: Path) -> None:
    """Draw each quantity against delay at the least loss, and against loss at the least delay."""
    import matplotlib as mpl  # noqa: PLC0415

    mpl.use("Agg")
    mpl.rcParams["svg.hashsalt"] = "head-or-local"
    from matplotlib import pyplot as plt  # noqa: PLC0415

    least_ms, least_loss = min(cell.delay_ms for cell in cells), min(cell.loss for cell in cells)
    figure, axes = plt.subplots(len(QUANTITIES), 2, figsize=(8, 13), sharex="col", sharey="row", layout="constrained")
    for row, quantity in enumerate(QUANTITIES):
        for column, (by_delay, kept) in enumerate(
            (
                (True, [cell for cell in cells if cell.loss == least_loss]),
                (False, [cell for cell in cells if cell.delay_ms == least_ms]),
            )
        ):
            axis = axes[row][column]
            for place, control in enumerate(CONTROLS):
                points = [
                    (cell.delay_ms if by_delay else 100 * cell.loss, found)
                    for cell in kept
                    if cell.control == control and (found := estimates(measured, cell, quantity)) is not None
                ]
                if not points:
                    continue
                x, y = [x for x, _ in points], [found.mean for _, found in points]
                low = [found.mean - (found.mean if found.low is None else found.low) for _, found in points]
                high = [(found.mean if found.high is None else found.high) - found.mean for _, found in points]
                span = max(x) - min(x)
                shifted = [each + (place - 2) * 0.012 * span for each in x]  # Bars that do not cover each other.
                axis.errorbar(shifted, y, [low, high], label=control, color=COLOURS[control], marker="o", ms=3, lw=1.2,
                              capsize=2, elinewidth=0.8)  # fmt: skip
            axis.grid(alpha=0.25)
            axis.spines[["top", "right"]].set_visible(False)
        axes[row][0].set_ylim(0, 105 if quantity.kind == "share of runs" else None)
        axes[row][0].set_ylabel(quantity.title)
    axes[-1][0].set_xlabel(f"delay of every message, ms (loss {100 * least_loss:g} %)")
    axes[-1][1].set_xlabel(f"loss of messages, % (delay {least_ms:g} ms)")
    drawn = [cell for cell in cells if least_loss == cell.loss or least_ms == cell.delay_ms]
    runs = [sum(of == cell for of, _ in measured) for cell in drawn]
    flown = f"{min(runs)}" if min(runs) == max(runs) else f"{min(runs)} to {max(runs)}"
    figure.suptitle(f"A head or local control, {cells[0].uavs} UAVs, {flown} runs a cell, 95 % intervals")
    handles, labels = axes[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
    figure.savefig(path.with_suffix(".svg"), metadata={"Date": None})
    figure.savefig(path.with_suffix(".png"), dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--uavs", type=int, nargs="+", default=[10, 30])
    parser.add_argument("--delays", type=float, nargs="+", default=[0, 100, 200, 400], metavar="MS")
    parser.add_argument("--losses", type=float, nargs="+", default=[0, 0.1, 0.3, 0.5], metavar="SHARE")
    names = {control.partition(": ")[2]: control for control in CONTROLS}
    parser.add_argument("--controls", nargs="+", default=[*names], choices=[*names], metavar="NAME",
                        help=f"of {'; '.join(names)}")  # fmt: skip
    parser.add_argument("--runs", type=int, default=30)
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="processes that fly at the same time")
    parser.add_argument("--out", type=Path, default=Path("head_or_local.jsonl"))
    parser.add_argument("--draw", action="store_true", help="fly nothing")
    options = parser.parse_args()
    cells = [
        Cell(uavs, delay_ms, loss, control)
        for uavs in options.uavs
        for delay_ms in options.delays
        for loss in options.losses
        for control in map(names.__getitem__, options.controls)
    ]
    if not options.draw:
        fly(cells, options.runs, options.out, options.jobs)
    measured = read(options.out)
    options.out.with_suffix(".md").write_text("\n".join([*table(measured, cells), ""]))
    for uavs in options.uavs:
        kept = [cell for cell in cells if cell.uavs == uavs]
        draw(measured, kept, options.out.with_name(f"{options.out.stem}-k{uavs}"))
    print(f"written: {options.out.with_suffix('.md')} and figures beside it")


if __name__ == "__main__":
    main()
