"""Random swaps: K UAVs change places at random, planned by a head with `edc` and with the baselines, side by side.

    python benchmarks/swaps.py                                  K = 20, 50, 100, all planners, three seeds: an hour
    python benchmarks/swaps.py --uavs 20 --runs 1               a minute

Starts are random with a tenth of the area covered by discs; the target of each UAV is the start of another one. The
network is perfect. Plan times are those of the thread, by the machine that runs it.
"""

from __future__ import annotations

import argparse
import math
from random import Random

import msgspec

from edc_swarm.analysis.metrics import Metrics, compute_metrics
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import complete_mission
from processes.experiments.measures import simulate

PLANNERS = ("edc", "orca", "bvc", "cbf", "priority")
COVERED = 0.1
MOST_SLOTS = 400


def swap(uavs: int, seed: int, planner: str) -> Mission:
    """Return the mission: random starts, and a permutation of them, without a fixed point, as targets."""
    area_m2 = uavs * math.pi * Mission().r_m ** 2 / COVERED
    drawn = complete_mission(Mission(uavs=uavs, seed=seed, area_m2=area_m2, fence="none"))
    order = list(range(uavs))
    Random(seed).shuffle(order)
    places = [(entry.start_x_m, entry.start_y_m) for entry in drawn.roster]
    after = dict(zip(order, [*order[1:], order[0]], strict=True))
    roster = [
        msgspec.structs.replace(entry, target_x_m=places[after[k]][0], target_y_m=places[after[k]][1])
        for k, entry in enumerate(drawn.roster)
    ]
    return msgspec.structs.replace(drawn, roster=roster, planner=planner, max_slots=MOST_SLOTS)


def shown(value: float | None, digits: int = 3) -> str:
    return "-" if value is None else f"{value:.{digits}g}"


def row(uavs: int, planner: str, flown: list[Metrics]) -> str:
    home = [metrics for metrics in flown if metrics.completed]
    overlaps = sum(metrics.potential_collisions or 0 for metrics in flown) / len(flown)
    extra = [metrics.extra_distance_pct for metrics in home if metrics.extra_distance_pct is not None]
    makespan = [metrics.makespan_ratio for metrics in home if metrics.makespan_ratio is not None]
    plan_ms = [metrics.plan_ms.p50 for metrics in flown if metrics.plan_ms.p50 is not None]
    means = [sum(values) / len(values) if values else None for values in (extra, makespan, plan_ms)]
    said = " | ".join(shown(value) for value in [overlaps, *means])
    return f"| {uavs} | {planner} | {len(home)} of {len(flown)} | {said} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--uavs", type=int, nargs="+", default=[20, 50, 100])
    parser.add_argument("--planners", nargs="+", default=PLANNERS)
    parser.add_argument("--runs", type=int, default=3)
    options = parser.parse_args()
    print(
        "| K | planner | completed | pairs that overlap | extra distance, % | makespan, times the least | ms per plan |"
    )
    print("|---|---|---|---|---|---|---|")
    for uavs in options.uavs:
        for planner in options.planners:
            flown = [compute_metrics(*simulate(swap(uavs, seed, planner))) for seed in range(options.runs)]
            print(row(uavs, planner, flown), flush=True)


if __name__ == "__main__":
    main()
