"""A planner that lets nobody move."""

from __future__ import annotations

from edc_swarm.mission.configuration import Mission
from edc_swarm.planner.interface import Plan, PlanRequest, Stopwatch


class Resting:
    """All stay where they are, in every slot."""

    def __init__(self, mission: Mission, stopwatch: Stopwatch) -> None:
        del mission, stopwatch

    def plan(self, request: PlanRequest) -> Plan:
        """Nobody is to move."""
        return Plan([(float(x), float(y)) for x, y in request.position_m], "no-qp-needed")
