"""A planner that measures its plan times, for simulated runs.

The times are those of the thread (`time.thread_time_ns`): what other programs do on the machine does not count.
"""

from __future__ import annotations

import time

from edc_swarm.analysis.timings import Timing
from edc_swarm.mission.configuration import Mission
from edc_swarm.planner.interface import Plan, Planner, PlanRequest, timeless
from edc_swarm.planner.registry import make_planner


class TimedPlanner:
    """A planner that keeps its plan times in a list, not in its plans, since simulated recordings must lack them."""

    def __init__(self, mission: Mission, timings: list[Timing]) -> None:
        self._planner: Planner = make_planner(mission.planner, mission, time.thread_time_ns)
        self._timings = timings

    def plan(self, request: PlanRequest) -> Plan:
        """Return the plan of the wrapped planner with a plan time of 0."""
        start_ns = time.thread_time_ns()
        plan = self._planner.plan(request)
        self._timings.append(
            Timing(
                slot=request.slot - 1,
                plan_ms=(time.thread_time_ns() - start_ns) / 1e6,
                guidance_ms=plan.guidance_ms,
                assemble_ms=plan.assemble_ms,
                solve_ms=plan.solve_ms,
            )
        )
        return timeless(plan)
