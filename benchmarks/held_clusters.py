"""UAVs that are killed near another cluster and hold in the air: guarantees, and who gets where.

    python benchmarks/held_clusters.py --runs 10

Simulates random missions of twelve UAVs in three clusters with `failsafe = "hold"`, seeds from 0. In each cluster of at
least three UAVs, the one that is nearest to a UAV of another cluster at 6 s is killed then. Prints a line for each
mission.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator

from msgspec.structs import replace

from edc_swarm.analysis.guarantees.check import check
from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.mission.clusters import cluster_names
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import complete_mission
from edc_swarm.planner.registry import make_planner
from edc_swarm.protocol.messages import Fix, Message, MissionMessage, mission_message
from edc_swarm.recording.model import Recording
from edc_swarm.simulation.simulator import Simulation

KILLED_S = 6.0
LEAST = 3
"""Least number of UAVs of a cluster that loses one."""


def simulated(mission: MissionMessage) -> tuple[Simulation, list[Message]]:
    """Return a simulation, and the list that it fills with all messages."""
    said = list[Message]()
    make = lambda: make_planner(mission.planner, mission)  # noqa: E731 - one of two arguments
    return Simulation(mission, make, lambda _key, each, _ns: said.append(each)), said


def nearest(mission: MissionMessage) -> Iterator[str]:
    """Yield, of each cluster, the UAV that is nearest to one of another cluster at 6 s."""
    slot = round(KILLED_S / mission.dt_s)
    simulation, said = simulated(mission)
    next(now for now in simulation.slots() if now > slot)
    at_m = {fix.uav: (fix.waypoint_x_m, fix.waypoint_y_m) for fix in said if isinstance(fix, Fix) and fix.slot == slot}
    for name in cluster_names(mission.roster):
        own = [entry.uav for entry in mission.roster if entry.cluster == name]
        others = at_m.keys() - set(own)
        if len(own) >= LEAST:
            yield min(own, key=lambda uav: (min(math.dist(at_m[uav], at_m[other]) for other in others), uav))


def report(seed: int) -> str:
    """Return one line about a mission."""
    drawn = Mission(uavs=12, area_m2=9600.0, clusters=3, seed=seed, failsafe="hold")
    killed = list(nearest(mission_message(complete_mission(drawn))))
    faults = [f"kill {uav} @{KILLED_S:g}" for uav in killed]
    simulation, said = simulated(mission_message(complete_mission(replace(drawn, fault=faults))))
    end, recording = simulation.run(), Recording.from_messages(said)
    metrics, results = compute_metrics(recording), check(recording)
    broken = [result.guarantee for result in results if result.broken]
    waiting = [str(who) for who in metrics.not_home if who.uav not in killed]
    text = f"{seed}: {', '.join(killed)} killed; {end.reason} after {end.slots} slots; broken: {broken}; "
    text += f"{metrics.arrived} of {12 - len(killed)} arrived, {metrics.potential_collisions} overlaps"
    return "\n    ".join([text, *waiting])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=10)
    for seed in range(parser.parse_args().runs):
        print(report(seed), flush=True)


if __name__ == "__main__":
    main()
