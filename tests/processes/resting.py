"""A planner that moves no UAV."""

from __future__ import annotations

from edc_swarm.mission.configuration import Mission
from edc_swarm.planner.interface import Plan, PlanRequest, Stopwatch


class Resting:
    """Planner that keeps all UAVs in their places, in every slot."""

    def __init__(self, mission: Mission, stopwatch: Stopwatch) -> None:
        del mission, stopwatch

    def plan(self, request: PlanRequest) -> Plan:
        """Return a plan in which no UAV moves."""
        return Plan([(float(x), float(y)) for x, y in request.position_m], "no-qp-needed")
