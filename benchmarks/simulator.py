"""Simulator speed, without the planner's own time: `python benchmarks/simulator.py [--repeats 5]`.

The script simulates random missions with planner `straight` without a recording, and prints the median ratio of
mission time to processor time for K = 10 and K = 50.
"""

from __future__ import annotations

import argparse
import statistics
import time

from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.validation import with_options
from edc_swarm.planner.registry import make_planner
from edc_swarm.protocol.messages import mission_message
from edc_swarm.simulation.simulator import Simulation

CASES = ((10, 10_000.0), (50, 40_000.0))


def ratio(uavs: int, area_m2: float) -> float:
    """Return the simulated mission seconds per second of processor time."""
    options = {"uavs": uavs, "area_m2": area_m2, "planner": "straight"}
    mission = mission_message(complete_mission(with_options(Mission(), options)))
    simulation = Simulation(mission, lambda: make_planner("straight", mission), lambda *_: None)
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
        print(f"K = {uavs}: {statistics.median(ratios):.0f} times real time (median of {repeats})")


if __name__ == "__main__":
    main()
