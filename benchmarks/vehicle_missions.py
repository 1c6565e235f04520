"""Missions of vehicles with inertia, simulated: the tables of docs/vehicles.md.

    python benchmarks/vehicle_missions.py wind            missions in wind, beside `ideal` (--runs 10)
    python benchmarks/vehicle_missions.py delay           collisions and deviation over delay and loss (--runs 3)

Each mission is a line of a ledger (--ledger), so a call that was stopped goes on where it was. A ledger belongs to one
version of the code. The tables show what the ledger has, with the number of missions.
"""

from __future__ import annotations

import argparse
import cmath
import json
import math
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

from edc_swarm.analysis.guarantees.check import check
from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.validation import mission_from_dict
from edc_swarm.planner.registry import make_planner
from edc_swarm.protocol.messages import Message, mission_message
from edc_swarm.recording.model import Recording
from edc_swarm.simulation.simulator import Simulation

mpl.use("Agg")
from matplotlib import pyplot as plt

FIRST_SEED = 1000
FIGURES = (
    "completed",
    "potential_collisions",
    "true_collisions",
    "max_deviation_m",
    "extra_distance_pct",
    "makespan_s",
    "energy_propulsion_j",
    "slots",
)


def circle(uavs: int) -> list[dict[str, Any]]:
    """Return a roster whose UAVs change places across a circle with a radius of 40 m."""
    starts = [cmath.rect(40.0, index * math.tau / uavs) for index in range(uavs)]
    return [
        {"uav": f"u{n:03}", "start_x_m": at.real, "start_y_m": at.imag, "target_x_m": -at.real, "target_y_m": -at.imag}
        for n, at in enumerate(starts, 1)
    ]


SCENARIOS: dict[str, dict[str, Any]] = {
    "default": {},
    "K = 50 on 40 000 m²": {"uavs": 50, "area_m2": 40_000.0},
    "circle of 20": {"uavs": 20, "roster": circle(20)},
}
WINDS_MPS, GPS_MODELS = (0.0, 4.0, 8.0), ("white", "gauss-markov")
DELAYS_MS, LOSSES = (0, 100, 200, 300, 400), (0.0, 0.1, 0.3)
BREEZE = {"mean_mps": 4.0, "gust_mps": 2.0}
Case = dict[str, Any]
Row = dict[str, Any]
Key = tuple[str, float, str]
"""Vehicle, mean wind and GPS model."""


def simulated(case: Case) -> Row:
    """Simulate a mission; return its figures. None is unknown."""
    message = mission_message(complete_mission(mission_from_dict(case)))
    said: list[Message] = []
    planner = make_planner(message.planner, message)
    begun_s = time.process_time()
    Simulation(message, lambda: planner, lambda _key, now, _ns: said.append(now)).run()
    took_s = time.process_time() - begun_s
    recording = Recording.from_messages(said)
    metrics, results = compute_metrics(recording), check(recording)
    outside = sum(violation.kind == "outside-disc" for result in results for violation in result.violations)
    broken = [result.guarantee for result in results if result.broken]
    return {name: getattr(metrics, name) for name in FIGURES} | {"outside": outside, "broken": broken, "took_s": took_s}


class Ledger:
    """The missions flown so far: a file with a line of JSON for each."""

    def __init__(self, path: Path) -> None:
        self._path = path
        lines = path.read_text().splitlines() if path.exists() else []
        self._rows = {json.dumps(line["case"]): line["row"] for line in map(json.loads, lines)}

    def fly(self, cases: list[Case]) -> None:
        """Fly those that the file lacks."""
        for number, case in enumerate(cases, 1):
            if json.dumps(case) in self._rows:
                continue
            row = self._rows[json.dumps(case)] = simulated(case)
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with self._path.open("a") as file:
                file.write(json.dumps({"case": case, "row": row}) + "\n")
            print(
                f"{number} of {len(cases)}: {row['took_s']:.1f} s, broken: {row['broken']}", file=sys.stderr, flush=True
            )

    def missions(self) -> Iterator[tuple[Case, Row]]:
        """Yield each mission with its figures."""
        return ((json.loads(text), row) for text, row in self._rows.items())


def wind_cases(runs: int, scenarios: list[str]) -> Iterator[Case]:
    """Yield the missions in wind, all cases of a seed before the next seed."""
    kinds = [("ideal", 0.0, "white")]
    kinds += [("multirotor", wind, gps) for gps in GPS_MODELS for wind in WINDS_MPS]
    for run in range(runs):
        for name in scenarios:
            for vehicle, mean_mps, gps in kinds:
                wind = {"mean_mps": mean_mps, "gust_mps": mean_mps / 2}
                vehicles = {"vehicle": {"model": vehicle}, "wind": wind, "gps_model": gps}
                yield {**SCENARIOS[name], **vehicles, "seed": FIRST_SEED + run}


def show_winds(ledger: Ledger, cases: list[Case], scenarios: list[str]) -> None:
    """Print a table as Markdown: a row for each scenario, vehicle, wind and GPS model."""
    columns = (
        "vehicle, wind, GPS",
        "complete",
        "collisions, potential and true",
        "outside",
        "extra",
        "makespan",
        "energy",
    )
    for name in scenarios:
        print(f"\n| {name}: {' | '.join(columns)} |\n|---|{'---|' * len(columns)}")
        flown: dict[Key, list[Row]] = {_key(case): [] for case in cases if _scenario(case) == name}
        for case, row in ledger.missions():
            if _scenario(case) == name:
                flown[_key(case)].append(row)
        for key, rows in flown.items():
            if rows:
                print(f"| {_named(key)} | {_told(rows)} | {_compared(rows, next(iter(flown.values())))} |")


def _scenario(case: Case) -> str:
    return next(name for name in reversed(SCENARIOS) if SCENARIOS[name].items() <= case.items())


def _key(case: Case) -> Key:
    return case["vehicle"]["model"], case["wind"]["mean_mps"], case["gps_model"]


def _named(key: Key) -> str:
    vehicle, mean_mps, gps = key
    return f"`{vehicle}`" if vehicle == "ideal" else f"{mean_mps:g} m/s, `{gps}`"


def _told(rows: list[Row]) -> str:
    done = sum(row["completed"] is True for row in rows)
    return f"{done} of {len(rows)} | {_sum(rows, 'potential_collisions')}, {_sum(rows, 'true_collisions')} | " + _sum(
        rows, "outside"
    )


def _compared(rows: list[Row], base: list[Row]) -> str:
    parts = [f"{_mean(rows, 'extra_distance_pct'):.1f} %"]
    for name, unit, scale in (("makespan_s", "s", 1.0), ("energy_propulsion_j", "kJ", 1e-3)):
        mean, ideal = _mean(rows, name), _mean(base, name)
        parts.append(f"{scale * mean:.1f} {unit} ({100 * (mean / ideal - 1):+.0f} %)")
    return " | ".join(parts)


def _sum(rows: list[Row], name: str) -> str:
    """Return the sum as text, "-" if one is unknown."""
    values = [row[name] for row in rows]
    return "-" if None in values else str(sum(values))


def _mean(rows: list[Row], name: str) -> float:
    """Return the mean, NaN if one is unknown."""
    return float(np.mean([np.nan if row[name] is None else row[name] for row in rows])) if rows else float("nan")


def delay_cases(runs: int) -> Iterator[Case]:
    """Yield missions of ten multirotors in wind, with links that delay and lose.

    Those with exact GPS, five UAVs and one seed show what the vehicle deviates without the error of its GPS.
    """
    for run in range(runs):
        for delay_ms in DELAYS_MS:
            for loss in LOSSES:
                fields = {"uavs": 10, "area_m2": 8000.0, "vehicle": {"model": "multirotor"}, "gps_model": "white"}
                rest = {"wind": BREEZE, "link": [_link(delay_ms, loss)], "seed": FIRST_SEED + run, "max_slots": 400}
                yield {**fields, **rest}
                if run == 0:
                    yield {**fields, "uavs": 5, "area_m2": 4000.0, "gps_model": "none", **rest}


def _link(delay_ms: int, loss: float) -> dict[str, float]:
    return {"delay_ms": float(delay_ms), "jitter_ms": delay_ms / 5, "loss": loss}


def show_delays(ledger: Ledger, folder: Path) -> None:
    """Print a table as Markdown, and plot the largest deviation."""
    print(f"| delay | {' | '.join(f'loss {100 * loss:g} %' for loss in LOSSES)} |\n|{'---|' * (len(LOSSES) + 1)}")
    figure, axes = plt.subplots(figsize=(7, 3.2))
    off_m: dict[float, list[float]] = {loss: [] for loss in LOSSES}
    for delay_ms in DELAYS_MS:
        texts = []
        for loss in LOSSES:
            found = [(case, row) for case, row in ledger.missions() if case["link"] == [_link(delay_ms, loss)]]
            rows = [row for case, row in found if case["gps_model"] == "white"]
            exact_m = [row["max_deviation_m"] for case, row in found if case["gps_model"] == "none"]
            off_m[loss].append(next((m for m in exact_m if m is not None), float("nan")))
            done = sum(row["completed"] is True for row in rows)
            collisions = f"{_sum(rows, 'potential_collisions')}, {_sum(rows, 'true_collisions')}"
            texts.append(f"{collisions}; {done} of {len(rows)} complete")
        print(f"| {delay_ms} ms | {' | '.join(texts)} |")
    for (loss, values), marker in zip(off_m.items(), "os^", strict=True):
        axes.plot(DELAYS_MS, values, marker=marker, label=f"loss {100 * loss:g} %")
    axes.set(xlabel="delay [ms]", ylabel="largest deviation, exact GPS [m]", ylim=(0.0, None))
    axes.legend()
    figure.tight_layout()
    figure.savefig(folder / "vehicle_delay.svg", metadata={"Date": None})


def main() -> int:
    """Fly what the words ask for, and show it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["wind", "delay"])
    parser.add_argument("--runs", type=int, help="missions of each case: 10 in wind, 3 over delay")
    parser.add_argument("--scenario", action="append", choices=list(SCENARIOS))
    parser.add_argument("--ledger", type=Path, default=Path("vehicle_missions.jsonl"))
    parser.add_argument("--folder", type=Path, default=Path("docs/figures"))
    parser.add_argument("--show", action="store_true", help="show what the ledger has, and fly nothing")
    given = parser.parse_args()
    ledger = Ledger(given.ledger)
    if given.what == "wind":
        scenarios = given.scenario or list(SCENARIOS)
        cases = list(wind_cases(10 if given.runs is None else given.runs, scenarios))
        ledger.fly([] if given.show else cases)
        show_winds(ledger, cases, scenarios)
    else:
        ledger.fly([] if given.show else list(delay_cases(3 if given.runs is None else given.runs)))
        show_delays(ledger, given.folder)
    return 0


if __name__ == "__main__":
    sys.exit(main())
