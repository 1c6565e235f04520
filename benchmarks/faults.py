"""Measurement of fail-over with real processes: `python benchmarks/faults.py [--trials 20] [--only NAME]`.

Ten UAVs, slot 0.5 s, real time by default. Each trial injects its fault at another moment within a slot, runs the
mission to its end with `edc-swarm run`, and is judged from the recording alone. The script prints a table, or JSON
with `--json`.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.progress import track

from edc_swarm.analysis.guarantees.check import check
from edc_swarm.analysis.metrics import Metrics, compute_metrics
from edc_swarm.recording.model import Recording
from edc_swarm.recording.reader import read_recording

UAVS = 10
SLOT_S = 0.5
FAULT_SLOT = 10
HEAL_SLOT = 30
LAND_AFTER_S = 15.0
"""Partitions of these trials last 10 s, the default of `land_after_s`: all that they cut off would just land."""


@dataclass(frozen=True)
class Flight:
    """One trial: its recording, its metrics, and the guarantees that are broken or could not be judged."""

    recording: Recording
    metrics: Metrics
    broken: list[str]
    not_judged: list[str]

    @property
    def living_home(self) -> bool:
        """True if every UAV that lives at the end is at its target, and none that lived has landed elsewhere."""
        away = self.metrics.not_home
        return all(who.uav in self.metrics.not_living and who.cause != "landed" for who in away)

    def planned_between(self, first: int, last: int) -> int:
        """Return the number of reports with a plan for slots first..last."""
        return sum(r.has_quorum and first <= r.slot <= last for r in self.recording.reports)


@dataclass(frozen=True)
class Scenario:
    """A fault with the value to measure; `ok` judges the value of one trial."""

    name: str
    figure: str
    faults: Callable[[float], list[str]]
    measure: Callable[[Flight], float]
    ok: Callable[[float], bool]


def _failover_slots(flight: Flight) -> float:
    return float(max(flight.metrics.failover_slots or [], default=0))


def _old_commands_flown(flight: Flight) -> float:
    """Return the number of steps of a lower term that UAVs flew after the first plan of the next term."""
    first: dict[int, int] = {}
    for report in flight.recording.reports:
        if report.has_quorum:
            first.setdefault(report.term, report.slot)
    fixes = (fix for fix in flight.recording.fixes if fix.executing)
    return sum(any(term > fix.command_term and fix.slot > slot + 1 for term, slot in first.items()) for fix in fixes)


def _slots_to_one_head(flight: Flight) -> float:
    """Return the number of slots from the end of the fault until every UAV grants the same head."""
    for slot in range(HEAL_SLOT, flight.metrics.slots or 0):
        last = {fix.uav: (fix.term, fix.head) for fix in flight.recording.fixes if fix.slot == slot}
        if len(last) == UAVS and len(set(last.values())) == 1:
            return slot - HEAL_SLOT
    return float("inf")


def _plans_while_split(flight: Flight) -> float:
    return flight.planned_between(FAULT_SLOT + 1, HEAL_SLOT - 1)


def _term_growth(flight: Flight) -> float:
    terms = [report.term for report in flight.recording.reports]
    return max(terms) - min(terms)


def _at(phase: float) -> str:
    return f"{(FAULT_SLOT + phase) * SLOT_S:.3f}s"


SCENARIOS = (
    Scenario(
        "kill head", "slots without commands", lambda p: [f"kill head @{_at(p)}"], _failover_slots, lambda v: v <= 2
    ),
    Scenario(
        "freeze head 5 s",
        "old-term commands flown",
        lambda p: [f"freeze head @{_at(p)} for 5s"],
        _old_commands_flown,
        lambda v: v == 0,
    ),
    Scenario(
        "cut head off",
        "slots to one head",
        lambda p: [f"partition head|rest @{_at(p)} for {HEAL_SLOT - FAULT_SLOT - p}"],
        _slots_to_one_head,
        lambda v: v <= 2,
    ),
    Scenario(
        "5|5 partition",
        "plans while split",
        lambda p: [f"partition halves @{_at(p)} for {HEAL_SLOT - FAULT_SLOT - p}"],
        _plans_while_split,
        lambda v: v == 0,
    ),
    Scenario("restart router", "terms gained", lambda p: [f"restart router @{_at(p)}"], _term_growth, lambda v: v <= 1),
    Scenario(
        "kill two heads",
        "slots without commands",
        lambda p: [f"kill head @{_at(p)}", f"kill head @{_at(p + 2)}"],
        _failover_slots,
        lambda v: v <= 2,
    ),
)


def fly(scenario: Scenario, trial: int, trials: int, time_scale: float, failsafe: str, folder: Path) -> Flight:
    """Run one mission with real processes."""
    path = folder / f"{scenario.name.replace(' ', '-').replace('|', '-')}-{trial}.mcap"
    faults = [word for fault in scenario.faults(trial / trials) for word in ("--fault", fault)]
    command = [sys.executable, "-m", "processes.cli.main", "run", "--uavs", str(UAVS), "--slot", str(SLOT_S), "--json"]
    extra = [
        "--land-after",
        str(LAND_AFTER_S),
        "--failsafe",
        failsafe,
        "--seed",
        str(trial),
        "--time-scale",
        str(time_scale),
        "--out",
        str(path),
        "--force",
    ]
    done = subprocess.run([*command, *extra, *faults], capture_output=True, text=True, check=False, timeout=900)
    if not path.exists():
        raise SystemExit(f"{' '.join(command)} gave no recording:\n{done.stderr[-2000:]}")
    recording = read_recording(path)
    verdicts = check(recording)
    broken = [f"{r.guarantee}: {where}" for r in verdicts if r.broken for where in r.where[:2]]
    not_judged = [f"{r.guarantee}: {note}" for r in verdicts if not r.judged for note in r.notes[:1]]
    return Flight(recording, compute_metrics(recording), broken, not_judged)


def late_pct(flight: Flight) -> float | None:
    """Return the share of late ticks, which tells a loaded machine from a late head; None if it is unknown."""
    late = flight.metrics.ticks_late_pct
    return None if late is None else round(late, 2)


def row(scenario: Scenario, flights: Sequence[Flight]) -> dict[str, object]:
    """Return the results of one scenario."""
    values = [scenario.measure(flight) for flight in flights]
    return {
        "scenario": scenario.name,
        "figure": scenario.figure,
        "trials": len(flights),
        "p50": statistics.median(values),
        "max": max(values),
        "each": values,
        "late ticks of each, %": [late_pct(flight) for flight in flights],
        "as promised": sum(scenario.ok(value) for value in values),
        "all that live at home": sum(flight.living_home for flight in flights),
        "broken guarantees": sum(bool(flight.broken) for flight in flights),
        "first broken": next((flight.broken[0] for flight in flights if flight.broken), ""),
        "not judged": sum(bool(flight.not_judged) for flight in flights),
        "first not judged": next((flight.not_judged[0] for flight in flights if flight.not_judged), ""),
    }


def main() -> int:
    """Run all trials and print the table; return 1 if a promise was not kept."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=20)
    parser.add_argument("--time-scale", type=float, default=1.0)
    parser.add_argument("--jobs", type=int, default=1, help="missions that run at the same time")
    parser.add_argument("--failsafe", choices=("land", "hold"), default="land", help="of all missions (land)")
    parser.add_argument("--only", help="a scenario whose name contains this")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    chosen = [scenario for scenario in SCENARIOS if not options.only or options.only in scenario.name]
    jobs = [(scenario, trial) for scenario in chosen for trial in range(options.trials)]
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(options.jobs) as pool:
        flown = pool.map(
            lambda job: fly(job[0], job[1], options.trials, options.time_scale, options.failsafe, Path(folder)), jobs
        )
        console = Console(stderr=True)
        flights = list(track(flown, description="faults", total=len(jobs), console=console))
    rows = [
        row(scenario, flights[index * options.trials : (index + 1) * options.trials])
        for index, scenario in enumerate(chosen)
    ]
    if options.json:
        print(json.dumps(rows, indent=2))
    else:
        for line in rows:
            print("  ".join(f"{name}: {value}" for name, value in line.items() if value != ""))
    kept = all(line["as promised"] == line["all that live at home"] == line["trials"] for line in rows)
    kept = kept and not any(line["first broken"] or line["first not judged"] for line in rows)
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
