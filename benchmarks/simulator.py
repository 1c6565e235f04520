"""Simulator speed, as mission time over processor time: `python benchmarks/simulator.py [--repeats 5]`.

The script simulates random missions without a recording: for K = 10 and K = 50 with planner `straight`, so without the
planner's own time; for K = 50 with planner `edc`, ideal vehicles and multirotors in wind in turns. It prints medians.
"""

from __future__ import annotations

import argparse
import statistics
import time
from typing import Any

from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.validation import with_options
from edc_swarm.planner.registry import make_planner, warm_up
from edc_swarm.protocol.messages import mission_message
from edc_swarm.simulation.simulator import Simulation

CASES = ((10, 10_000.0), (50, 40_000.0))


INERT: dict[str, Any] = {"vehicle": {"model": "multirotor"}, "wind": {"mean_mps": 4.0, "gust_mps": 2.0}}


def ratio(uavs: int, area_m2: float, planner: str = "straight", **options: Any) -> float:
    """Return the simulated mission seconds per second of processor time."""
    chosen = {"uavs": uavs, "area_m2": area_m2, "planner": planner, **options}
    mission = mission_message(complete_mission(with_options(Mission(), chosen)))
    made = make_planner(planner, mission)
    simulation = Simulation(mission, lambda: made, lambda *_: None)
    start_s = time.process_time()
    end = simulation.run()
    return end.slots * mission.dt_s / (time.process_time() - start_s)


def main() -> None:
    """Print a line per case."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=5)
    repeats = parser.parse_args().repeats
    for uavs, area_m2 in CASES:
        ratios = [ratio(uavs, area_m2) for _ in range(repeats)]
        print(f"K = {uavs}, straight: {statistics.median(ratios):.0f} times real time (median of {repeats})")
    warm_up(complete_mission(Mission()))
    ratio(*CASES[-1], "edc", **INERT)
    pairs = [(ratio(*CASES[-1], "edc"), ratio(*CASES[-1], "edc", **INERT)) for _ in range(repeats)]
    ideal, inert = (statistics.median(column) for column in zip(*pairs, strict=True))
    share = statistics.median(second / first for first, second in pairs)
    print(f"K = 50, edc: {ideal:.0f} times real time, {inert:.0f} for multirotors in wind, {share:.2f} of it")


if __name__ == "__main__":
    main()
