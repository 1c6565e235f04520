"""Faults that a UAV process applies to itself on an event of the operator: links, clock, GPS receiver, planner.

The launcher kills and freezes processes from outside.
"""

from __future__ import annotations

from typing import cast

from edc_swarm.agent.node import GpsChanged, NodeEvent, Tick
from edc_swarm.emulation.links import LinkEmulator, cut_pair
from edc_swarm.errors import MissionError
from edc_swarm.mission.configuration import GpsModel, Mission
from edc_swarm.mission.faults import Fault, parse_fault
from processes.runtime.clock import MissionClock
from processes.uav.planner_loader import SlowPlanner

NS_PER_MS = 1_000_000


class LocalFaults:
    """The operator's faults, applied to one UAV's links, clock, GPS receiver and planner."""

    def __init__(self, mission: Mission, uav: str, links: LinkEmulator, clock: MissionClock) -> None:
        self._mission = mission
        self._uav = uav
        self._links = links
        self._clock = clock
        self.planner: SlowPlanner | None = None

    def apply(self, text: str) -> list[NodeEvent]:
        """Apply the fault in `text` if it concerns this UAV; return the events for the node that follow."""
        try:
            fault = parse_fault(text, self._mission.dt_s)
        except MissionError:
            return []
        match fault.verb:
            case "partition" | "heal" | "link":
                self._change_links(fault)
            case "clock" | "gps" | "slow" if fault.target == self._uav:
                return self._change_self(fault)
        return []

    def _change_links(self, fault: Fault) -> None:
        if fault.verb == "heal":
            self._links.heal()
        elif fault.verb == "link":
            self._links.add_rule(fault.link())
        else:
            for cut in cut_pair(fault.left, fault.right, fault.at_s, fault.end_s, "one-way" in fault.flags):
                self._links.add_cut(cut)

    def _change_self(self, fault: Fault) -> list[NodeEvent]:
        if fault.verb == "gps":
            return [GpsChanged(cast("GpsModel", fault.flags[0]))]
        if fault.verb == "clock":
            self._clock.set_off(round(fault.number("offset_ms") * NS_PER_MS), fault.number("drift_ppm"))
        elif self.planner is not None:
            self.planner.slow_down(fault.number("by_ms") / 1e3, fault.for_s / self._mission.time_scale)
        return [Tick()]
