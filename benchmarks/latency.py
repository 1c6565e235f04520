"""Measurement of the bus with real processes: `python benchmarks/latency.py [--trials 3] [--uavs 10] [--json]`.

Each trial measures three things, one after the other:

1. the baseline, called floor in the output: plain Zenoh processes with the same fan-in and fan-out through the same
   router (`processes.experiments.zenoh_baseline`);
2. the swarm's latency from fix to command with planner `straight`;
3. the same with delayed links, which gives the delay error of the emulation.

The exit status is 1 if the swarm's median is above twice that of the baseline, or the median delay error above 1 ms.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from rich.console import Console
from rich.progress import track

from edc_swarm.analysis.latency_sample import Sample, sample_of
from edc_swarm.analysis.metrics import OVERLOADED_PCT
from edc_swarm.recording.reader import read_recording
from processes.experiments.zenoh_baseline import measure_baseline

SLOT_S, SLOTS = 0.5, 40
MOST_TIMES_FLOOR = 2.0
MOST_DELAY_ERROR_MS = 1.0
DELAYED = ("--delay-ms", "50", "--jitter-ms", "20")


def fly(uavs: int, seed: int, folder: Path, *extra: str) -> Sample:
    """Run one mission with real processes and planner `straight`."""
    path = folder / "run.mcap"
    command = [sys.executable, "-m", "processes.cli.main", "run", "--uavs", str(uavs), "--slot", str(SLOT_S), "--json"]
    options = ["--planner", "straight", "--no-viz", "--seed", str(seed), "--out", str(path), "--force"]
    done = subprocess.run([*command, *options, *extra], capture_output=True, text=True, check=False, timeout=600)
    if not path.exists():
        raise SystemExit(f"no recording:\n{done.stderr[-2000:]}")
    return sample_of(read_recording(path))


def trial(uavs: int, seed: int, folder: Path) -> dict[str, float]:
    """Return the latencies of baseline and swarm, and the delay error, in milliseconds."""
    floor = measure_baseline(uavs, SLOT_S, SLOTS)
    swarm, delayed = fly(uavs, seed, folder), fly(uavs, seed, folder, *DELAYED)
    error = delayed.delay_error
    assert error is not None
    assert swarm.fix_to_command_ms is not None
    assert floor.put_to_answer_ms.p50 is not None
    return {
        "floor p50": floor.put_to_answer_ms.p50,
        "floor p99": floor.put_to_answer_ms.p99 or 0.0,
        "floor round trip p50": floor.round_trip_ms.p50 or 0.0,
        "swarm p50": swarm.fix_to_command_ms,
        "swarm p99": swarm.fix_to_command_p99_ms or 0.0,
        "swarm / floor p50": swarm.fix_to_command_ms / floor.put_to_answer_ms.p50,
        "delay error p50": error.p50_ms,
        "delay error p99": error.p99_ms,
        "delay error max": error.max_ms,
        "late ticks %": max(swarm.ticks_late_pct or 0.0, delayed.ticks_late_pct or 0.0),
    }


def main() -> int:
    """Measure all trials and print their medians; return 1 if a promise was not kept."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=3)
    parser.add_argument("--uavs", type=int, default=10)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        seeds = track(range(options.trials), description="latency", console=Console(stderr=True))
        trials = [trial(options.uavs, seed, Path(folder)) for seed in seeds]
    medians = {name: round(statistics.median(one[name] for one in trials), 3) for name in trials[0]}
    if options.json:
        print(json.dumps({"uavs": options.uavs, "trials": trials, "median": medians}, indent=2))
    else:
        for name, value in medians.items():
            print(f"{name:24} {value:10.3f}" + ("" if name.endswith("%") or "/" in name else " ms"))
    if medians["late ticks %"] > OVERLOADED_PCT:
        print("the machine was overloaded: these results say nothing about the bus", file=sys.stderr)
    kept = medians["swarm / floor p50"] <= MOST_TIMES_FLOOR and medians["delay error p50"] <= MOST_DELAY_ERROR_MS
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
