"""Faults in the simulator: the table of those that stop and start whole processes.

Faults of a UAV's machine (`emulation.machine`) have one table for the simulator and the real processes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from edc_swarm.agent.node import Disturbed, Tick
from edc_swarm.emulation.links import LinkEmulator
from edc_swarm.emulation.machine import MACHINE_FAULTS
from edc_swarm.mission.fault_handlers import FaultHandlers
from edc_swarm.mission.fault_targets import resolve
from edc_swarm.mission.faults import (
    ROUTER_OUTAGE_S,
    Fault,
    Freeze,
    GiveGoal,
    Kill,
    Partition,
    ProcessFault,
    Restart,
    Resume,
    SlowSolver,
    VehicleFault,
)
from edc_swarm.mission.roles import RECORDER, ROUTER
from edc_swarm.protocol.events import EventKind
from edc_swarm.simulation.computers import FOREVER_NS, Clock, Computer
from edc_swarm.simulation.network import Network
from edc_swarm.simulation.schedule import Schedule


@dataclass(frozen=True, slots=True)
class Swarm:
    """All that a fault can hit."""

    schedule: Schedule
    network: Network
    computers: Mapping[str, Computer]


def inject(swarm: Swarm, fault: Fault) -> None:
    """Record and carry out a fault whose time has come; only record it if no process is its target."""
    monitor = swarm.network.monitor
    concrete = resolve(fault, monitor.head, monitor.standbys, [*swarm.computers], monitor.in_office)
    if concrete is None or RECORDER in concrete.names:
        swarm.network.publish_event(EventKind.FAULT_WITHOUT_TARGET, str(fault))
        return
    swarm.network.publish_event(EventKind.FAULT, str(concrete))
    if isinstance(concrete, ProcessFault):
        PROCESS_FAULTS.carry_out(swarm, concrete)
        return
    if isinstance(concrete, Partition):  # It lasts from the nanosecond at which it is carried out.
        concrete = replace(concrete, at_s=swarm.schedule.mission_s)
    for computer in swarm.computers.values():
        MACHINE_FAULTS.carry_out(SimulatedMachine(computer, swarm.schedule), concrete)


@dataclass(frozen=True, slots=True)
class SimulatedMachine:
    """A computer as faults change it (`emulation.machine.Machine`)."""

    computer: Computer
    schedule: Schedule

    @property
    def uav(self) -> str:
        """Id of the UAV."""
        return self.computer.uav

    @property
    def links(self) -> LinkEmulator:
        """The links into the UAV."""
        return self.computer.links

    def set_clock(self, offset_ns: int, drift_ppm: float) -> None:
        """Let the clock be `offset_ns` ahead from now on, and gain `drift_ppm`."""
        now_ns = self.schedule.now_ns
        self.computer.clock = Clock(now_ns, now_ns + offset_ns, 1.0 + drift_ppm * 1e-6)
        self.computer.step(Tick())

    def disturb(self, fault: VehicleFault) -> None:
        """Let a fault of the vehicle act: of its GPS receiver or its motors, a gust, an order to land."""
        self.computer.step(Disturbed(fault))

    def slow_down(self, fault: SlowSolver) -> None:
        """Let every plan take longer while `fault` lasts."""
        self.computer.slow = fault


PROCESS_FAULTS: FaultHandlers[Swarm] = FaultHandlers()


@PROCESS_FAULTS.of(Kill)
def _kill(swarm: Swarm, fault: Kill) -> None:
    if fault.target == ROUTER:
        _take_router_away(swarm, fault)
    elif not _stops_mid_step(swarm, fault):
        swarm.computers[fault.target].kill(fault.for_s)


@PROCESS_FAULTS.of(Freeze)
def _freeze(swarm: Swarm, fault: Freeze) -> None:
    if fault.target == ROUTER:
        _take_router_away(swarm, fault)
    elif not _stops_mid_step(swarm, fault):
        swarm.computers[fault.target].freeze(fault.for_s)


@PROCESS_FAULTS.of(Restart)
def _restart(swarm: Swarm, fault: Restart) -> None:
    if fault.target == ROUTER:
        swarm.network.router_up_at_ns = swarm.schedule.now_ns + swarm.schedule.duration_ns(ROUTER_OUTAGE_S)
    else:
        swarm.computers[fault.target].restart(lose_memory=fault.lose_memory)


@PROCESS_FAULTS.of(Resume)
def _resume(swarm: Swarm, fault: Resume) -> None:
    if fault.target == ROUTER:
        swarm.network.router_up_at_ns = swarm.schedule.now_ns
    else:
        swarm.computers[fault.target].resume()


@PROCESS_FAULTS.of(GiveGoal)
def _give_goal(swarm: Swarm, fault: GiveGoal) -> None:
    swarm.network.give_goal(fault.target, list(fault.route))


def _take_router_away(swarm: Swarm, fault: Kill | Freeze) -> None:
    swarm.network.router_up_at_ns = swarm.schedule.ns_of(fault.end_s) if math.isfinite(fault.for_s) else FOREVER_NS


def _stops_mid_step(swarm: Swarm, fault: Kill | Freeze) -> bool:
    """Return True if the fault waits for the next step of the process, to stop it within."""
    process = swarm.computers[fault.target].process
    if not fault.mid_step or process is None or process.frozen:
        return False
    process.stop_mid_step = fault
    return True
