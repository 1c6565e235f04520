"""The body of one UAV: what truly flies, and the position that its GPS receiver measures.

`Body` is the interface. `Ideal` moves exactly along its steps; `multirotor.Multirotor` has inertia.

Every UAV process imports this module, so it does not import numpy.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

from msgspec import Struct

from edc_swarm.emulation.energy import step_energy_j
from edc_swarm.emulation.gps import Gps
from edc_swarm.emulation.wind import Turbulence
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.faults import ChangeGps, VehicleFault
from edc_swarm.mission.roster_entry import RosterEntry

Point = tuple[float, float]


class BodyState(Struct, frozen=True, kw_only=True):
    """State of a body with inertia at the end of a slot, which outlives the process.

    Attributes
    ----------
    slot
        The slot, -1 before the first one.
    before_m, at_m
        Waypoints at the start and at the end of the slot, which give the place and the velocity of the reference.
    error_m
        Estimated minus true position.
    grown_m
        What the error may have grown beyond the GPS error bound since GPS was lost.
    """

    slot: int = -1
    before_m: Point
    at_m: Point
    position_m: Point
    velocity_mps: Point = (0.0, 0.0)
    acceleration_mps2: Point = (0.0, 0.0)
    error_m: Point = (0.0, 0.0)
    turbulence: Turbulence = Turbulence()
    grown_m: float = 0.0


@dataclass(frozen=True, slots=True)
class PastFlight:
    """The flight of a slot that is over, as an autopilot reported it.

    Attributes
    ----------
    path_m
        Positions at equal times, from the start to the end of the slot.
    waypoint_m
        The waypoint at the end of the slot.
    """

    slot: int
    path_m: list[Point]
    waypoint_m: Point


@dataclass(frozen=True, slots=True)
class Flown:
    """The true flight of one slot.

    Attributes
    ----------
    from_m, to_m
        True position at both ends of the slot.
    between_m
        True positions at equal times between them; None for straight flight at constant speed.
    measured_m
        Position by GPS at the start of the slot.
    propulsion_j
        Energy of propulsion.
    grown_m
        What the tracked disc needs beyond `r_m`, since GPS is lost or has only just returned.
    saturated
        True if the controller asked for more acceleration than the vehicle has.
    past
        Of an autopilot, which reports what it has flown: the slots before this one that it has reported by now, each
        once. Nothing is known of this slot then but `measured_m`. None for an emulated body.
    charge_share
        Share of the full charge that is left, as an autopilot reports it; None if nothing is known.
    stray_m
        Radius about `measured_m` in which the vehicle is by the end of the slot, if it no longer follows its commands;
        None for one that does.
    on_ground
        True if the vehicle is on the ground for good.
    """

    from_m: Point
    to_m: Point
    between_m: list[Point] | None
    measured_m: Point
    propulsion_j: float
    grown_m: float = 0.0
    saturated: bool = False
    past: list[PastFlight] | None = None
    charge_share: float | None = None
    stray_m: float | None = None
    on_ground: bool = False


class Body(Protocol):
    """A body that flies."""

    @property
    def state(self) -> BodyState | None:
        """The state to persist; None for a body that has none."""

    @property
    def standing(self) -> Flown:
        """A slot at rest where the body is before its first slot."""

    def fly(self, slot: int, from_m: Point, to_m: Point) -> Flown:
        """Fly the step of `slot` between two waypoints, and return what truly happened.

        The slots of a flight come in order, each with its step; the first point is the last one of the slot before.
        """

    def brake(self, slot: int, from_m: Point, to_m: Point) -> None:
        """Fly the step of a `slot` for which the process did not run."""

    def disturb(self, fault: VehicleFault) -> None:
        """Let a fault of the vehicle act from the next slot on."""

    @property
    def next_measured_m(self) -> Point:
        """Position that GPS measures after the last step, if its error stays the same."""


class Ideal:
    """A body that flies each step straight, at constant speed, at a constant offset from the tracked disc's centre."""

    state = None

    def __init__(self, mission: Mission, entry: RosterEntry, at_m: Point) -> None:
        self._mission = mission
        self._gps = Gps(mission, entry)
        self._offset_m = self._gps.true_offset_m
        self._at_m = at_m
        self.standing = Flown(start := self._true_m(at_m), start, None, at_m, 0.0)

    def fly(self, slot: int, from_m: Point, to_m: Point) -> Flown:
        """Move from point to point. Without GPS the error of the last fix stays, since the motion is known."""
        self._gps.next_error_m(slot)
        self._at_m = to_m
        length_m = math.hypot(to_m[0] - from_m[0], to_m[1] - from_m[1])
        propulsion_j = step_energy_j(self._mission, length_m)
        return Flown(self._true_m(from_m), self._true_m(to_m), None, self._measured_m(from_m), propulsion_j)

    def brake(self, slot: int, from_m: Point, to_m: Point) -> None:
        """Move without a fix, which nobody asked for."""
        del slot, from_m  # This body is at the end of its last step, whatever was before.
        self._at_m = to_m

    def disturb(self, fault: VehicleFault) -> None:
        """Change the GPS; wind and weak motors do not concern this body."""
        if isinstance(fault, ChangeGps):
            self._gps.change(fault)

    @property
    def next_measured_m(self) -> Point:
        """Position of the next fix if the error stays."""
        return self._measured_m(self._at_m)

    def _measured_m(self, centre_m: Point) -> Point:
        (x_m, y_m), (ex_m, ey_m) = self._true_m(centre_m), self._gps.error_m
        return x_m + ex_m, y_m + ey_m

    def _true_m(self, centre_m: Point) -> Point:
        return centre_m[0] + self._offset_m[0], centre_m[1] + self._offset_m[1]
