"""A planner in closed loop without agents: everybody flies what was planned, every slot.

With a good network and one head this is the path that the simulated swarm flies, to the last bit,
at the cost of planning alone; a test holds the two together.
"""

from __future__ import annotations

import numpy as np

from edc_swarm.config import ARRIVED_M, Mission
from edc_swarm.geometry import Floats, length_m
from edc_swarm.planner.interface import Plan, Planner, PlanRequest, Stopwatch
from edc_swarm.planner.paper import Paper


def as_printed(mission: Mission, stopwatch: Stopwatch) -> Paper:
    """Make the planner `paper` with eq. 29-43 as printed, none of their variables eliminated."""
    return Paper(mission, stopwatch, eliminate=False)


AS_PRINTED = "edc_swarm.figures.closed_loop:as_printed"


def closed_loop(mission: Mission, planner: Planner, first_slot: int = 1) -> tuple[Floats, list[Plan]]:
    """Positions (S + 1, K, 2) of a completed mission's UAVs, and the plan of every slot.

    `first_slot` is the first slot that has commands.
    """
    roster = mission.roster
    position_m = np.array([(entry.start_x_m, entry.start_y_m) for entry in roster])
    target_m = np.array([(entry.target_x_m, entry.target_y_m) for entry in roster])
    r_m, uav = [entry.r_m for entry in roster], range(len(roster))
    path_m, plans = [position_m], list[Plan]()
    for slot in range(first_slot, mission.max_slots):
        if (length_m(path_m[-1] - target_m) <= ARRIVED_M).all():
            break
        plan = planner.plan(PlanRequest(slot, uav, path_m[-1], target_m, r_m))
        plans.append(plan)
        path_m.append(np.array(plan.waypoint_m))
    return np.stack(path_m), plans
