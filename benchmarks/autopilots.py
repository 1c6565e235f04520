"""Set-points on time: `python -m benchmarks.autopilots --bodies 10 50`.

For each number of bodies, stand-in autopilots (tests/processes/stand_in.py) fly a mission of real processes on this
machine, beside everything else that runs here. Printed are the times between the set-points that an autopilot receives
(planned: 0.05 s), the share of seconds with at least ten of them, what the process of a UAV uses of a processor, how
far the vehicles were from their declared paths, and who did not get home.
"""

from __future__ import annotations

import argparse
import json
import math
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.geodesy import to_wgs84
from edc_swarm.mission.configuration import Mission
from edc_swarm.recording.reader import read_recording

STAND_IN = Path(__file__).resolve().parents[1] / "tests" / "processes" / "stand_in.py"
FIRST_PORT = 21_000
APART_M = 20.0
LEAST_HZ = 10


def starts_m(bodies: int) -> list[tuple[float, float]]:
    return [(APART_M * (index % 10), 2 * APART_M * (index // 10)) for index in range(bodies)]


def mission_text(bodies: int) -> str:
    head = [
        'name = "bodies"', "r_m = 4.0", "v_max_mps = 4.0", "dt_s = 1.0", "landing_s = 4.0", "[vehicle]",
        'model = "mavlink"', f'autopilot = "udpin:127.0.0.1:{{{FIRST_PORT}+i}}"', "altitude_m = 2.0",
        "takeoff_s = 15.0",
    ]  # fmt: skip
    entries = [
        f'[[roster]]\nuav = "u{index + 1:03d}"\nstart_x_m = {x_m}\nstart_y_m = {y_m}\n'
        f"target_x_m = {x_m}\ntarget_y_m = {y_m + APART_M}"
        for index, (x_m, y_m) in enumerate(starts_m(bodies))
    ]
    return "\n".join([*head, *entries])


def orders(bodies: int) -> list[dict[str, Any]]:
    plain = Mission()
    origin_deg = plain.origin_lat_deg, plain.origin_lon_deg
    found = []
    for index, place_m in enumerate(starts_m(bodies)):
        lat, lon = to_wgs84(*place_m, *origin_deg)
        found.append({"port": FIRST_PORT + index, "lat": lat, "lon": lon, "system": index + 1})
    return found


def measure(bodies: int, folder: Path) -> None:
    mission, recording = folder / "mission.toml", folder / "run.mcap"
    mission.write_text(mission_text(bodies))
    command = [sys.executable, str(STAND_IN), json.dumps(orders(bodies))]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as stand_ins:
        assert stand_ins.stdout is not None
        stand_ins.stdout.readline()
        run = [sys.executable, "-m", "processes.cli.main", "run", str(mission), "--arm", "--overload", "fly"]
        flown = subprocess.run(
            [*run, "--out", str(recording), "--force", "--quiet", "--no-viz"],
            check=False,
            capture_output=True,
            text=True,
        )
        stand_ins.send_signal(signal.SIGTERM)
        logs = json.loads(stand_ins.communicate()[0])
    if not recording.exists():
        print(f"{bodies} bodies: status {flown.returncode}: {flown.stderr.strip().splitlines()[-1:]}")
        return
    gaps_s = np.concatenate([log["gaps_s"] for log in logs])
    seconds = np.concatenate([np.bincount(np.cumsum(log["gaps_s"]).astype(int))[:-1] for log in logs if log["gaps_s"]])
    told = read_recording(recording)
    metrics = compute_metrics(told)
    cpu_s = {fix.uav: fix.cpu_s for fix in told.fixes}
    first_s = {fix.uav: fix.cpu_s for fix in reversed(told.fixes)}
    slots = max(fix.slot for fix in told.fixes)
    used = np.median([(cpu_s[uav] - first_s[uav]) / (slots * told.mission.dt_s) for uav in cpu_s])
    p50, p99 = np.quantile(gaps_s, [0.5, 0.99])
    print(
        f"{bodies} bodies: {gaps_s.size} set-points, {p50:.3f} s apart (median), {p99:.3f} s (p99),"
        f" {gaps_s.max():.3f} s (most); {100 * np.mean(gaps_s <= 0.1):.2f} % at most 0.1 s apart,"
        f" {100 * np.mean(seconds >= LEAST_HZ):.2f} % of seconds with at least {LEAST_HZ};"
        f" {100 * used:.1f} % of a processor a UAV"
    )
    print(
        f"  status {flown.returncode}, {metrics.arrived} of {bodies} home, {metrics.true_collisions} true collisions,"
        f" at most {metrics.max_deviation_m or math.nan:.2f} m off the path"
    )
    for away in metrics.not_home:
        print(f"  {away}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bodies", type=int, nargs="+", default=[10, 50])
    for bodies in parser.parse_args().bodies:
        with tempfile.TemporaryDirectory() as folder:
            measure(bodies, Path(folder))


if __name__ == "__main__":
    main()
