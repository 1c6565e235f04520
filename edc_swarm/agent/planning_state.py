"""Remembers, for a UAV that plans, whether it has its planner, its own newest command, and its last problem."""

from __future__ import annotations

from edc_swarm.planner.interface import Planner
from edc_swarm.protocol.messages import Command


class PlanningState:
    """One UAV's planner and what has come of its plans, alike for a head and for a UAV under local control.

    Attributes
    ----------
    planner
        The planner, None until the shell has loaded it.
    gone
        UAVs that have left the bus: nobody waits for their fixes.
    own_command
        The newest command to itself, which the UAV receives in the step after planning.
    """

    def __init__(self) -> None:
        self.planner: Planner | None = None
        self.gone: set[str] = set()
        self.own_command: Command | None = None
        self._planner_wanted = False
        self._problem = ""

    def is_new(self, problem: str) -> bool:
        """Return True for a problem other than that of the plan before."""
        before, self._problem = self._problem, problem
        return bool(problem) and problem != before

    def take_own_command(self, slot: int) -> Command | None:
        """Return the own command, once, if its slot is after `slot`: planning may have taken too long."""
        own, self.own_command = self.own_command, None
        return own if own is not None and slot < own.slot else None

    def wants_planner(self) -> bool:
        """Return True, once, if this UAV may plan and has no planner."""
        wants = self.may_plan_soon and not self._planner_wanted and self.planner is None
        self._planner_wanted = self._planner_wanted or wants
        return wants

    @property
    def may_plan_soon(self) -> bool:
        """True if this UAV may have to plan."""
        return True
