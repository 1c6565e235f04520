"""The planner as a library: a small swarm in a loop, without processes, bus or clock.

    python examples/plan_without_processes.py

The loop calls the planner once per slot. The planner returns waypoints that are safe for any execution: late, uneven,
half-way or none. In this example one UAV is silent for a while. The loop gives the planner the set of places where it
can be (a `Hull`), and the planner leads the others around it.
"""

from __future__ import annotations

import math

from edc_swarm.mission.configuration import Mission
from edc_swarm.planner.interface import Hull, PlanRequest
from edc_swarm.planner.registry import make_planner

RADIUS_M = 5.0
UAVS = 8
SILENT, SILENT_FROM, SILENT_UNTIL = 3, 6, 20


def on_circle(index: int, radius_m: float) -> tuple[float, float]:
    angle = 2 * math.pi * index / UAVS
    return radius_m * math.cos(angle), radius_m * math.sin(angle)


def main() -> int:
    # Each UAV swaps places with the opposite one, so all straight lines meet in the middle.
    mission = Mission(uavs=UAVS, r_m=RADIUS_M, v_max_mps=5.0, dt_s=0.5, minimise="distance")
    planner = make_planner("edc", mission)
    position = [on_circle(k, 40.0) for k in range(UAVS)]
    target = [on_circle(k + UAVS // 2, 40.0) for k in range(UAVS)]
    least_gap_m = math.inf

    slot = 0
    while any(math.dist(p, t) > 0.1 for p, t in zip(position, target, strict=True)):
        silent = {SILENT} if SILENT_FROM <= slot < SILENT_UNTIL else set()
        heard = [k for k in range(UAVS) if k not in silent]
        plan = planner.plan(
            PlanRequest(
                slot=slot,
                uav=heard,
                position_m=[position[k] for k in heard],
                target_m=[target[k] for k in heard],
                r_m=[RADIUS_M] * len(heard),
                # A silent UAV holds, so its hull is its present point.
                hulls=[Hull(k, *position[k], *position[k], radius_m=0.0, r_m=RADIUS_M) for k in silent],
            )
        )
        for k, waypoint in zip(heard, plan.waypoint_m, strict=True):
            position[k] = waypoint
        least_gap_m = min(least_gap_m, plan.min_gap_m)
        slot += 1

    print(f"{UAVS} UAVs arrived after {slot} slots; least gap between discs {least_gap_m:.3f} m")
    return slot


if __name__ == "__main__":
    main()
