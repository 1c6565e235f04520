"""Faults of one UAV's machine, carried out: links, clock, GPS receiver and solver.

The simulator and the real processes call the same functions, so a fault of this kind has one handler.
"""

from __future__ import annotations

from typing import Protocol

from edc_swarm.emulation.links import NS_PER_MS, LinkEmulator, cut_pair
from edc_swarm.mission.fault_handlers import FaultHandlers
from edc_swarm.mission.faults import (
    ChangeClock,
    ChangeGps,
    ChangeLink,
    Gust,
    Heal,
    OrderLanding,
    Partition,
    SlowSolver,
    VehicleFault,
    WeakMotor,
)


class Machine(Protocol):
    """A UAV's machine, as far as faults change it."""

    @property
    def uav(self) -> str:
        """Id of the UAV."""

    @property
    def links(self) -> LinkEmulator:
        """The links into the UAV."""

    def set_clock(self, offset_ns: int, drift_ppm: float) -> None:
        """Let the clock be `offset_ns` ahead from now on, and gain `drift_ppm`."""

    def disturb(self, fault: VehicleFault) -> None:
        """Let a fault of the vehicle act: of its GPS receiver or its motors, a gust, an order to land."""

    def slow_down(self, fault: SlowSolver) -> None:
        """Let every plan take longer while `fault` lasts."""


MACHINE_FAULTS: FaultHandlers[Machine] = FaultHandlers()


@MACHINE_FAULTS.of(Partition)
def _partition(machine: Machine, fault: Partition) -> None:
    for cut in cut_pair(fault.left, fault.right, fault.at_s, fault.end_s, fault.one_way):
        machine.links.add_cut(cut)


@MACHINE_FAULTS.of(Heal)
def _heal(machine: Machine, _: Heal) -> None:
    machine.links.heal()


@MACHINE_FAULTS.of(ChangeLink)
def _change_link(machine: Machine, fault: ChangeLink) -> None:
    machine.links.add_rule(fault.rule())


@MACHINE_FAULTS.of(ChangeClock)
def _change_clock(machine: Machine, fault: ChangeClock) -> None:
    if fault.target == machine.uav:
        machine.set_clock(round(fault.offset_ms * NS_PER_MS), fault.drift_ppm)


def _disturb(machine: Machine, fault: VehicleFault) -> None:
    if fault.target == machine.uav:
        machine.disturb(fault)


MACHINE_FAULTS.of(ChangeGps)(_disturb)
MACHINE_FAULTS.of(Gust)(_disturb)
MACHINE_FAULTS.of(WeakMotor)(_disturb)
MACHINE_FAULTS.of(OrderLanding)(_disturb)


@MACHINE_FAULTS.of(SlowSolver)
def _slow_solver(machine: Machine, fault: SlowSolver) -> None:
    if fault.target == machine.uav:
        machine.slow_down(fault)
