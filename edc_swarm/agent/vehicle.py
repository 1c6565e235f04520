"""One UAV's body and promise: what it flies, where its disc is, what it has promised.

Rules kept here (named as in ARCHITECTURE.md):

- *promise*: (slot, term, head, waypoint) is persisted before anything else happens; slot and term
  never decrease, and within a term the head never changes;
- *validity*: the reasons for which a command is refused are all in `refusal`;
- *flight*: an accepted step is completed within its slot whatever happens to the process.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from msgspec import Struct

from edc_swarm.agent.knowledge import Grant
from edc_swarm.emulation.energy import step_energy_j
from edc_swarm.emulation.gps import GpsReceiver
from edc_swarm.mission.configuration import ARRIVED_M, GpsModel, Mission, RosterEntry
from edc_swarm.protocol.messages import NO_ONE, Command

LATE_FRACTION = 0.2
"""A tick later than this part of the slot flies nothing and is counted."""


class Promise(Struct, frozen=True, kw_only=True):
    """What a UAV keeps on disk. None but the waypoint is ever undone."""

    slot: int = -1
    term: int = 0
    head: str = NO_ONE
    waypoint_x_m: float
    waypoint_y_m: float

    @property
    def grant(self) -> Grant:
        """(term, head)."""
        return (self.term, self.head)


class Airframe(Struct, frozen=True, kw_only=True):
    """The emulated body, which outlives the process: where the tracked disc is, and the battery."""

    x_m: float
    y_m: float
    energy_j: float


def first_promise(entry: RosterEntry) -> Promise:
    """What whoever creates a UAV writes for it: term 0 and the roster start."""
    return Promise(waypoint_x_m=entry.start_x_m, waypoint_y_m=entry.start_y_m)


def first_airframe(entry: RosterEntry) -> Airframe:
    """A fresh UAV at its roster start with a full battery."""
    return Airframe(x_m=entry.start_x_m, y_m=entry.start_y_m, energy_j=entry.energy_j)


@dataclass(frozen=True, slots=True)
class Situation:
    """What decides whether a command may be flown at the tick of `slot`."""

    slot: int
    grant: Grant
    waypoint_m: tuple[float, float]
    u_max_m: float
    late_tick: bool
    energy_j: float
    step_energy_j: float


def refusal(command: Command, now: Situation) -> str | None:
    """Why `command` must not be flown, or None when it is valid.

    That it was received before its slot began is seen to by the caller: only what has arrived when
    the slot begins is looked at.
    """
    start_m = (command.start_x_m, command.start_y_m)
    length_m = math.hypot(command.target_x_m - start_m[0], command.target_y_m - start_m[1])
    reasons = (
        (command.slot != now.slot, "another slot"),
        ((command.term, command.head) != now.grant, "not from the head granted"),
        (start_m != now.waypoint_m, "does not start at the own waypoint"),
        (length_m > now.u_max_m, "longer than a slot allows"),
        (now.late_tick, "the tick was late"),
        (now.energy_j < now.step_energy_j, "the battery does not cover it"),
    )
    return next((reason for broken, reason in reasons if broken), None)


class Vehicle:
    """The tracked disc, the true position and the battery of one UAV.

    The disc's centre and the true position move by the same vector, so their offset never changes.
    """

    def __init__(self, mission: Mission, entry: RosterEntry, promise: Promise | None, airframe: Airframe) -> None:
        self._mission = mission
        self._entry = entry
        self._gps = self._receiver(mission.gps_model, "gps")
        self._offset_m = self._gps.true_offset_m
        self.waypoint_m = (airframe.x_m, airframe.y_m)
        if promise is not None:
            self.waypoint_m = (promise.waypoint_x_m, promise.waypoint_y_m)
        self.from_m = self.waypoint_m
        self.energy_j = airframe.energy_j
        self.position_m = self.waypoint_m

    @property
    def airframe(self) -> Airframe:
        """The body as it is to be persisted."""
        return Airframe(x_m=self.waypoint_m[0], y_m=self.waypoint_m[1], energy_j=self.energy_j)

    @property
    def r_m(self) -> float:
        """Radius of the tracked disc."""
        return self._entry.r_m

    @property
    def arrived(self) -> bool:
        """Whether the waypoint is within 0.1 m of the target."""
        entry = self._entry
        return math.hypot(entry.target_x_m - self.waypoint_m[0], entry.target_y_m - self.waypoint_m[1]) <= ARRIVED_M

    @property
    def truth_m(self) -> tuple[float, float, float, float]:
        """True motion of the slot: from x, from y, to x, to y."""
        (fx, fy), (wx, wy), (ox, oy) = self.from_m, self.waypoint_m, self._offset_m
        return (fx + ox, fy + oy, wx + ox, wy + oy)

    def step_energy_j(self, length_m: float) -> float:
        """Propulsion energy of one slot in which `length_m` is flown at constant speed."""
        return step_energy_j(self._mission, length_m)

    def begin_slot(self, slots: int, command: Command | None) -> None:
        """Fly `command`, or hold; `slots` have passed since the last call (more than 1 after a freeze)."""
        self.from_m = self.waypoint_m
        if command is not None:
            self.waypoint_m = (command.target_x_m, command.target_y_m)
        length_m = math.hypot(self.waypoint_m[0] - self.from_m[0], self.waypoint_m[1] - self.from_m[1])
        hovered_j = self.step_energy_j(0.0) * (slots - 1)
        self.energy_j = max(0.0, self.energy_j - self.step_energy_j(length_m) - hovered_j)
        self.position_m = self._reported_m(self.from_m, self._gps.next_error_m())

    @property
    def next_position_m(self) -> tuple[float, float]:
        """What the next fix will say, when this slot is over, if the GPS error stays what it is."""
        return self._reported_m(self.waypoint_m, self._gps.error_m)

    def _reported_m(self, centre_m: tuple[float, float], error_m: tuple[float, float]) -> tuple[float, float]:
        (x_m, y_m), (ox_m, oy_m), (ex_m, ey_m) = centre_m, self._offset_m, error_m
        return x_m + ox_m + ex_m, y_m + oy_m + ey_m

    def spend(self, energy_j: float) -> None:
        """Draw energy for radio or computation."""
        self.energy_j = max(0.0, self.energy_j - energy_j)

    def use_gps_model(self, model: GpsModel) -> None:
        """Change the GPS error model in flight (a fault); neither disc nor truth moves."""
        self._gps = self._receiver(model, f"gps-{model}")

    def _receiver(self, model: GpsModel, stream: str) -> GpsReceiver:
        entry, mission = self._entry, self._mission
        return GpsReceiver(model, entry.r_m - entry.body_m, mission.dt_s, f"{mission.seed}/{entry.uav}/{stream}")
