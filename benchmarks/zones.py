"""Missions with and without zones: what a fence costs, and what twenty stay-out zones cost the planner.

    python benchmarks/zones.py                       K = 50 with and without a fence, 30 missions each, and plan times
    python benchmarks/zones.py --runs 2 --jobs 1     two missions of each kind
    python benchmarks/zones.py --json out.json       the results as JSON too ('-': standard output)

The planner runs alone in a closed loop and every command is executed. Every motion is checked against the other discs
by exact closest approach, and against the zones by their own polygons (`analysis.breaches`). Plan times are processor
time of the planning thread; missions with zones and without have the same starts and targets. Tune the planner only on
seeds below 1000.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import time
import warnings
from typing import Any

import msgspec
import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from edc_swarm.analysis.breaches import breaches
from edc_swarm.geometry import DISC_TOLERANCE_M, Floats, closest_approach_m, length_m, near_pairs
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.roster_entry import ARRIVED_M
from edc_swarm.mission.zone import Zone
from edc_swarm.planner.charts import Charts, clear_of
from edc_swarm.planner.interface import PlanRequest
from edc_swarm.planner.registry import make_planner, warm_up
from edc_swarm.planner.safe import airspace_of
from processes.experiments.workers import workers

FIRST_SEED = 1000
AREAS_M2 = (10_000.0, 40_000.0)
SIZES = {50: 10, 200: 3, 1000: 1}
"""Missions of each number of UAVs whose plans are timed."""
M2_PER_UAV = 800.0
ZONES = 20
MOST_SLOTS = 1500


def fence_case(area_m2: float, fenced: bool, seed: int) -> dict[str, Any]:
    """Fly 50 UAVs of a random mission with or without its area as fence; both count who is outside the area."""
    mission = complete_mission(Mission(uavs=50, area_m2=area_m2, seed=seed))
    start_m = np.array([(entry.start_x_m, entry.start_y_m) for entry in mission.roster])
    target_m = np.array([(entry.target_x_m, entry.target_y_m) for entry in mission.roster])
    side_m = math.sqrt(area_m2)
    area = Zone(name="area", kind="inclusion", polygon=[(0.0, 0.0), (side_m, 0.0), (side_m, side_m), (0.0, side_m)])
    flown = fly(msgspec.structs.replace(mission, zone=[area] if fenced else []), start_m, target_m, [area])
    return {"case": f"{area_m2:g} m2", "fence": fenced, "seed": seed, **flown}


def timed_case(uavs: int, zones: bool, seed: int) -> dict[str, Any]:
    """Fly a random mission with 20 random polygons or without; starts and targets are free of them in both."""
    mission, start_m, target_m = zoned_mission(uavs, seed)
    judged = mission.zone
    if not zones:
        mission = msgspec.structs.replace(mission, zone=[])
    return {"case": f"K = {uavs}", "zones": zones, "seed": seed, **fly(mission, start_m, target_m, judged)}


def zoned_mission(uavs: int, seed: int) -> tuple[Mission, Floats, Floats]:
    """Return a mission with its area as fence and 20 polygons, starts and targets, that has a way for every UAV."""
    side_m, rng = math.sqrt(M2_PER_UAV * uavs), np.random.default_rng([seed, uavs])
    plain = Mission(uavs=uavs, area_m2=side_m**2, seed=seed)
    r_m = np.full(uavs, plain.r_m)
    while True:
        zones = [_polygon(rng, number, side_m) for number in range(ZONES)]
        mission = msgspec.structs.replace(plain, zone=zones)
        start_m, target_m = _placed(rng, mission, side_m), _placed(rng, mission, side_m)
        charts = Charts.of(airspace_of(mission))
        if all(charts.reaches(k, r_m[k], start_m[k], target_m[k]) for k in range(uavs)):
            return mission, start_m, target_m


def _polygon(rng: np.random.Generator, number: int, side_m: float) -> Zone:
    """Return a polygon of four to eight corners, convex or not, 10 to 30 m about its middle."""
    count = int(rng.integers(4, 9))
    turn = (np.arange(count) + rng.uniform(0, 0.8, count)) * math.tau / count
    away_m = rng.uniform(0.4, 1.0, count) * rng.uniform(10, 30)
    corner_m = rng.uniform(0, side_m, 2) + away_m[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    return Zone(name=f"zone {number}", kind="exclusion", polygon=corner_m.tolist())


def _placed(rng: np.random.Generator, mission: Mission, side_m: float) -> Floats:
    """Return (K, 2) points in the airspace, clear of zones and of each other."""
    airspace, points_m = airspace_of(mission), np.empty((0, 2))
    while len(points_m) < mission.uavs:
        point_m = rng.uniform(0, side_m, (1, 2))
        clear = clear_of(airspace, point_m, np.full(1, mission.r_m)) & airspace.contains(point_m)
        if clear[0] and length_m(points_m - point_m).min(initial=np.inf) >= 2.1 * mission.r_m:
            points_m = np.concatenate([points_m, point_m])
    return points_m


def fly(mission: Mission, start_m: Floats, target_m: Floats, zones: list[Zone]) -> dict[str, Any]:
    """Fly one mission with the planner alone, and judge it against `zones`."""
    warnings.simplefilter("ignore")
    warm_up(mission)
    count, r_m = len(start_m), np.full(len(start_m), mission.r_m)
    planner = make_planner("edc", msgspec.structs.replace(mission, roster=[]), time.thread_time_ns)
    position_m, path_m, times_ms, overlaps = start_m, np.zeros(count), [], 0
    outside = np.zeros(count, dtype=bool)
    depth_m, slot = 0.0, 0
    arrived_slot = np.zeros(count)
    for slot in range(MOST_SLOTS):
        started_ns = time.thread_time_ns()
        plan = planner.plan(PlanRequest(slot, range(count), position_m, target_m, r_m))
        times_ms.append((time.thread_time_ns() - started_ns) / 1e6)
        after_m = np.array(plan.waypoint_m)
        for zone in zones:
            breach_m, _ = breaches(zone, position_m, after_m, r_m * zone.keeps_disc)
            outside |= breach_m > DISC_TOLERANCE_M
            depth_m = max(depth_m, float(breach_m.max()))
        first, second = near_pairs(position_m, 2 * mission.r_m + 2 * mission.u_max_m)
        near_m = closest_approach_m(position_m[first], after_m[first], position_m[second], after_m[second])
        overlaps += int((near_m < 2 * mission.r_m - DISC_TOLERANCE_M).sum())
        path_m += length_m(after_m - position_m)
        away = length_m(after_m - target_m) >= ARRIVED_M
        arrived_slot[away | (length_m(position_m - target_m) >= ARRIVED_M)] = slot + 1
        position_m = after_m
        if not away.any():
            break
    straight_m = length_m(target_m - start_m)
    return {
        "completed": not away.any(),
        "overlaps": overlaps,
        "outside": int(outside.sum()),
        "depth_m": depth_m,
        "extra_distance_pct": 100 * (float(path_m.sum() / straight_m.sum()) - 1),
        "makespan_ratio": float(arrived_slot.max() * mission.u_max_m / straight_m.max()),
        "first_plan_ms": times_ms[0],
        "times_ms": times_ms,
    }


def summarise(flights: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the results of missions of one kind: sums, means, and quantiles over all their slots."""
    times_ms = np.concatenate([flight["times_ms"] for flight in flights])
    return {
        "completed": f"{sum(flight['completed'] for flight in flights)}/{len(flights)}",
        "overlaps": sum(flight["overlaps"] for flight in flights),
        "outside": sum(flight["outside"] for flight in flights),
        "depth_m": max(flight["depth_m"] for flight in flights),
        "extra_distance_pct": float(np.mean([flight["extra_distance_pct"] for flight in flights])),
        "makespan_ratio": float(np.mean([flight["makespan_ratio"] for flight in flights])),
        "plan_ms_mean": float(times_ms.mean()),
        "plan_ms_p50": float(np.percentile(times_ms, 50)),
        "plan_ms_p99": float(np.percentile(times_ms, 99)),
        "first_plan_ms": float(np.median([flight["first_plan_ms"] for flight in flights])),
        "incomplete": [flight["seed"] for flight in flights if not flight["completed"]],
    }


def show(results: dict[str, dict[str, Any]], console: Console) -> None:
    """Print one row for each kind of mission."""
    table = Table(title="planner edc, closed loop; 'outside': UAVs that broke a zone, 'depth': by how much at most, m")
    keys = list(next(iter(results.values())))
    for head in ("case", *keys):
        table.add_column(head, justify="right")
    for name, row in results.items():
        cells = (f"{row[key]:.3f}" if isinstance(row[key], float) else str(row[key]) for key in keys)
        table.add_row(name, *cells)
    console.print(table)


def main() -> None:
    """Fly the missions that the arguments ask for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=30, help="missions with and without fence (default: 30)")
    parser.add_argument("--timed", type=int, default=0, help="missions per size for plan times (default: 10, 3, 1)")
    parser.add_argument("--sizes", default="50,200,1000", help="numbers of UAVs whose plans are timed ('' for none)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--json", metavar="FILE", default="", help="write the results to FILE ('-': standard output)")
    args = parser.parse_args()
    console = Console(stderr=True, width=max(170, Console().width))
    work: list[tuple[Any, tuple[Any, ...]]] = [
        (fence_case, (area_m2, fenced, FIRST_SEED + run))
        for area_m2 in AREAS_M2 for fenced in (False, True) for run in range(args.runs)
    ]  # fmt: skip
    work += [
        (timed_case, (uavs, zones, FIRST_SEED + run))
        for uavs in map(int, filter(None, args.sizes.split(",")))
        for run in range(args.timed or SIZES.get(uavs, 1)) for zones in (False, True)
    ]  # fmt: skip
    with workers(args.jobs) as pool:
        ends = [pool.submit(function, *arguments) for function, arguments in work]
        flights = [end.result() for end in track(ends, "flying", console=console)]
    kinds: dict[str, list[dict[str, Any]]] = {}
    for flight in flights:
        what = ("fenced" if flight["fence"] else "free") if "fence" in flight else f"{ZONES * flight['zones']} zones"
        kinds.setdefault(f"{flight['case']}, {what}", []).append(flight)
    results = {name: summarise(kind) for name, kind in kinds.items()}
    show(results, console)
    if args.json:
        text = json.dumps(results, indent=1)
        with sys.stdout if args.json == "-" else open(args.json, "w", encoding="utf-8") as file:
            file.write(text + "\n")


if __name__ == "__main__":
    main()
