"""Faults of a UAV's machine, carried out in its process when the operator announces them.

Hosts kill and freeze processes from outside; links, clocks, GPS receivers and solvers go wrong in here.
"""

from __future__ import annotations

from edc_swarm.agent.node import Disturbed, NodeEvent, Tick
from edc_swarm.emulation.links import LinkEmulator
from edc_swarm.emulation.machine import MACHINE_FAULTS
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.faults import ProcessFault, SlowSolver, VehicleFault, read_fault
from processes.runtime.clock import MissionClock
from processes.uav.planner_loader import SlowPlanner


class LocalFaults:
    """One UAV's links, clock, GPS receiver and planner, as faults change them (`emulation.machine.Machine`).

    Attributes
    ----------
    planner
        The planner that a fault slows down; None until it is loaded.
    """

    def __init__(self, mission: Mission, uav: str, links: LinkEmulator, clock: MissionClock) -> None:
        self._mission = mission
        self._clock = clock
        self._events: list[NodeEvent] = []
        self.uav = uav
        self.links = links
        self.planner: SlowPlanner | None = None

    def apply(self, text: str) -> list[NodeEvent]:
        """Carry out the fault in `text` if it concerns this UAV; return the events for the node that follow."""
        fault = read_fault(text, self._mission.dt_s)
        if fault is not None and not isinstance(fault, ProcessFault):
            MACHINE_FAULTS.carry_out(self, fault)
        events, self._events = self._events, []
        return events

    def set_clock(self, offset_ns: int, drift_ppm: float) -> None:
        """Let the clock be `offset_ns` ahead from now on, and gain `drift_ppm`."""
        self._clock.set_off(offset_ns, drift_ppm)
        self._events.append(Tick())

    def disturb(self, fault: VehicleFault) -> None:
        """Let a fault of the vehicle act: of its GPS receiver or its motors, a gust, an order to land."""
        self._events.append(Disturbed(fault))

    def slow_down(self, fault: SlowSolver) -> None:
        """Let every plan take longer while `fault` lasts."""
        if self.planner is not None:
            self.planner.slow_down(fault.by_ms / 1e3, fault.for_s / self._mission.time_scale)
        self._events.append(Tick())
