"""Flight of one UAV: it keeps the commands for later slots and flies the valid one of each slot."""

from __future__ import annotations

import math

from edc_swarm.agent.knowledge import Grant
from edc_swarm.agent.vehicle import Promise, Situation, Vehicle, refusal
from edc_swarm.mission.faults import OrderLanding, VehicleFault
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.messages import Command

MAX_PENDING = 4
"""Most commands that a UAV keeps for later slots."""


class Flight:
    """Pending commands of one UAV, the command that it flies, and its counts of held slots and late ticks.

    Parameters
    ----------
    vehicle
        The vehicle that flies.
    voter
        False for a UAV that lost its promise: it flies no command.
    """

    def __init__(self, vehicle: Vehicle, voter: bool) -> None:
        self._vehicle = vehicle
        self.voter = voter
        self._ordered_down = False
        self._pending: dict[int, Command] = {}
        self.flown: Command | None = None
        self.held_slots = 0
        self.late_ticks = 0

    def keep(self, command: Command) -> bool:
        """Keep the first command of its slot, which is to come; return False if there are too many."""
        if len(self._pending) >= MAX_PENDING:
            return False
        self._pending.setdefault(command.slot, command)
        return True

    def discard(self) -> None:
        """Discard the pending commands."""
        self._pending.clear()

    def disturb(self, fault: VehicleFault) -> None:
        """Let a fault act. A UAV that is ordered to land flies no command from now on, and lands once it rests."""
        if isinstance(fault, OrderLanding):
            self._ordered_down = True
        else:
            self._vehicle.disturb(fault)

    def give_up(self) -> None:
        """Give up the vote, and all commands: the vehicle follows them no more."""
        self.voter = False
        self.discard()

    def begin_slot(self, slot: int, slots: int, grant: Grant, late: bool) -> None:
        """Fly the pending command of `slot` if it is valid, else brake; the last call was `slots` slots ago."""
        self._vehicle.brake_until(slot)
        command = self._pending.pop(slot, None)
        refused = command is not None and refusal(command, self._situation(slot, command, grant, late)) is not None
        if refused or self._ordered_down:
            command = None
        self._pending = {later: kept for later, kept in self._pending.items() if later > slot}
        self._vehicle.begin_slot(slots, command)
        self.flown = command
        self.late_ticks += late
        self.held_slots += slots - 1 + (command is None)

    def ending(self, slot: int) -> tuple[EventKind, str] | None:
        """Return why the UAV lands in `slot`, as the event that says so; None if it flies on."""
        if self._vehicle.energy_j <= 0.0:
            return EventKind.BATTERY_EMPTY, ""
        if self._ordered_down and self._vehicle.rests:
            return EventKind.LANDED, "the operator ordered it to land"
        if self._vehicle.must_land(slot):
            since = f"since slot {self._vehicle.stepped_slot}" if self._vehicle.stepped_slot >= 0 else "at all"
            return EventKind.LANDED, f"no accepted step {since}"
        return None

    def promise(self, slot: int, grant: Grant) -> Promise | None:
        """Return the promise to persist; None for a UAV that lost its promise."""
        if not self.voter:
            return None
        (x_m, y_m), (from_x_m, from_y_m) = self._vehicle.waypoint_m, self._vehicle.from_m
        return Promise(
            slot=slot,
            term=grant[0],
            head=grant[1],
            waypoint_x_m=x_m,
            waypoint_y_m=y_m,
            stepped_slot=self._vehicle.stepped_slot,
            course=self._vehicle.course,
            from_x_m=from_x_m,
            from_y_m=from_y_m,
        )

    def _situation(self, slot: int, command: Command, grant: Grant, late: bool) -> Situation:
        length_m = math.dist((command.start_x_m, command.start_y_m), (command.target_x_m, command.target_y_m))
        return Situation(
            slot=slot,
            grant=grant if self.voter else (-1, ""),
            waypoint_m=self._vehicle.waypoint_m,
            u_max_m=self._vehicle.u_max_m,
            late_tick=late,
            energy_j=self._vehicle.energy_j,
            step_energy_j=self._vehicle.step_energy_j(length_m),
            landing_slot=self._vehicle.landing_slot,
            from_m=self._vehicle.from_m,
            change_m=self._vehicle.change_m,
        )
