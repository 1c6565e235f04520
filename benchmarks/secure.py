"""The cost of `--secure`: latency from fix to command with and without it, measured alternately.

python benchmarks/secure.py [--uavs 10 30] [--runs 5]
"""

from __future__ import annotations

import argparse
import json
import re
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path


def fly(uavs: int, seed: int, secure: bool, out: Path) -> dict[str, float]:
    area_m2 = 1000 * uavs
    command = [sys.executable, "-m", "processes.cli.main", "run", "--json", "--out", str(out), "--force"]
    command += ["--uavs", str(uavs), "--area", str(area_m2), "--seed", str(seed), *(["--secure"] if secure else [])]
    said = subprocess.run(command, capture_output=True, text=True, check=True)
    metrics = json.loads(said.stdout)
    connected = re.search(r"connected ([\d.]+) s", said.stderr)
    return {
        **{name: metrics["fix_to_command_ms"][name] for name in ("p50", "p99")},
        "late": metrics["ticks_late_pct"],
        "connected": float(connected[1]) if connected else float("nan"),
    }


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--uavs", type=int, nargs="+", default=[10, 30])
    parser.add_argument("--runs", type=int, default=5)
    options = parser.parse_args()
    print("UAVs  bus     fix to command p50 ms  p99 ms  all connected s  late ticks %  (medians)")
    with tempfile.TemporaryDirectory() as folder:
        for uavs in options.uavs:
            flown: dict[bool, list[dict[str, float]]] = {False: [], True: []}
            for seed in range(options.runs):
                for secure in (False, True):
                    flown[secure].append(fly(uavs, seed, secure, Path(folder) / "run.mcap"))
            for secure, runs in flown.items():
                p50, p99, late, connected = (statistics.median(run[name] for run in runs) for name in runs[0])
                bus = "secure" if secure else "open"
                print(f"{uavs:4}  {bus:6} {p50:22.1f} {p99:7.1f} {connected:16.2f} {late:13.2f}")


if __name__ == "__main__":
    main()
