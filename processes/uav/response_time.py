"""The response time of this computer: its processor time for planning a reference slot."""

from __future__ import annotations

import math
import statistics
import time

from edc_swarm.mission.configuration import Mission
from edc_swarm.planner.interface import PlanRequest
from processes.uav.planner_loader import warm_planner

UAVS = 12
TRIALS = 3


def measured_response_ms() -> float:
    """Return the milliseconds of the reference slot, which is the same for every UAV and mission.

    The function measures processor time: wall time would include the other processes that measure at
    the same time.
    """
    mission = Mission(uavs=UAVS)
    warm_planner(mission)
    from edc_swarm.planner.registry import make_planner  # noqa: PLC0415  (imports numpy)

    request = _reference_slot(mission)
    times_ns = []
    for _ in range(TRIALS):
        planner = make_planner("edc", mission)
        start_ns = time.thread_time_ns()
        planner.plan(request)
        times_ns.append(time.thread_time_ns() - start_ns)
    return statistics.median(times_ns) / 1e6


def _reference_slot(mission: Mission) -> PlanRequest:
    """Return the plan request for UAVs on a ring, as close as allowed, each bound for the opposite side."""
    radius_m = 1.1 * mission.r_m / math.sin(math.pi / UAVS)
    angles = [math.tau * k / UAVS for k in range(UAVS)]
    ring_m = [(radius_m * math.cos(angle), radius_m * math.sin(angle)) for angle in angles]
    return PlanRequest(
        slot=0,
        uav=range(UAVS),
        position_m=ring_m,
        target_m=[(-x_m, -y_m) for x_m, y_m in ring_m],
        r_m=[mission.r_m] * UAVS,
    )
