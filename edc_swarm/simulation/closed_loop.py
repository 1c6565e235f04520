"""A planner in closed loop without agents: every UAV flies its planned step, in every slot.

With a good network and one head this is the path that the simulated swarm flies, to the last bit,
at the cost of planning alone; a test holds the two together.
"""

from __future__ import annotations

from itertools import pairwise

import msgspec
import numpy as np

from edc_swarm.geometry import Floats, length_m
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster_entry import ARRIVED_M
from edc_swarm.planner.interface import Plan, Planner, PlanRequest, Stopwatch
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.messages import Command, Event, Fix, Message, MissionMessage
from edc_swarm.recording.model import Recording


def as_printed(mission: Mission, stopwatch: Stopwatch) -> Planner:
    """Make the planner `paper` with eq. 29-43 as printed, none of their variables eliminated."""
    from edc_swarm.planner.paper import Paper  # noqa: PLC0415  (imports OSQP, which few callers of this module need)

    return Paper(mission, stopwatch, eliminate=False)


def recording_of(mission: MissionMessage, path_m: Floats) -> Recording:
    """Return a recording of such a path alone, for the same metrics: each slot's fixes and commands."""
    uavs, said = [entry.uav for entry in mission.roster], list[Message]([mission])
    for slot, (here_m, there_m) in enumerate(pairwise(path_m.tolist())):
        for entry, (x_m, y_m), (to_x_m, to_y_m) in zip(mission.roster, here_m, there_m, strict=True):
            start = {"start_x_m": x_m, "start_y_m": y_m, "target_x_m": to_x_m, "target_y_m": to_y_m}
            waypoint = {"x_m": to_x_m, "y_m": to_y_m, "waypoint_x_m": to_x_m, "waypoint_y_m": to_y_m}
            said.append(Command(head=uavs[0], uav=entry.uav, slot=slot, seq=slot, term=1, **start))
            said.append(Fix(uav=entry.uav, slot=slot, seq=slot, r_m=entry.r_m, executing=True, **waypoint))
    last = len(path_m) - 2
    for uav in uavs:
        tails = {f"uav/{uav}/fix": last}
        if uav == uavs[0]:
            tails |= {f"head/{uav}/command/{other}": last for other in uavs}
        detail = msgspec.json.encode(tails).decode()
        said.append(Event(source=uav, slot=last, kind=EventKind.CLOSED, detail=detail))
    return Recording.from_messages(said)


AS_PRINTED = "edc_swarm.simulation.closed_loop:as_printed"


def closed_loop(mission: Mission, planner: Planner, first_slot: int = 1) -> tuple[Floats, list[Plan]]:
    """Return the positions (S + 1, K, 2) of a completed mission's UAVs, and the plan of every slot.

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
