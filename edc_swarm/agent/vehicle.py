"""Body and promise of one UAV: its commands, its tracked disc, its battery, its grant.

Rules kept here (named as in ARCHITECTURE.md):

- *promise*: the UAV persists (slot, term, head, waypoint, course) before any other effect; slot and term
  never decrease, and within a term the head never changes;
- *validity*: `refusal` has all reasons for which a UAV rejects a command;
- *flight*: the vehicle completes an accepted step within its slot, even if the process dies;
- *failsafe*: the vehicle lands a fixed time after its last accepted step, even if the process dies, and never flies
  again. The promise and the airframe keep the slot of that step, and `refusal` compares it with the limit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from msgspec import Struct

from edc_swarm.agent.goals import unflyable
from edc_swarm.agent.knowledge import Grant
from edc_swarm.emulation.bodies import body_of
from edc_swarm.emulation.body import Body, BodyState
from edc_swarm.emulation.energy import step_energy_j
from edc_swarm.mission.braking import Point, allows, braked, change_of, rest_point
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.failsafe import LATE_FRACTION, failsafe_of
from edc_swarm.mission.faults import VehicleFault
from edc_swarm.mission.lifelong import next_goal
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.mission.routes import Course
from edc_swarm.mission.vehicle_budget import GROWTH_M
from edc_swarm.protocol.messages import NO_ONE, Command, Goal, MissionMessage


class Promise(Struct, frozen=True, kw_only=True):
    """Promise that a UAV keeps on disk, with its course. Slot, term and goal only grow, and a term has one head.

    `stepped_slot` is the slot of the last accepted step, -1 for none. With the mission's limits it is the promise when
    the UAV lands, which is on the disk before the step is flown. `from_x_m from_y_m` is where the step of `slot` began
    (None: the UAV rests): it tells how the UAV brakes while its process is dead.
    """

    slot: int = -1
    term: int = 0
    head: str = NO_ONE
    waypoint_x_m: float
    waypoint_y_m: float
    stepped_slot: int = -1
    course: Course = Course()
    from_x_m: float | None = None
    from_y_m: float | None = None

    @property
    def grant(self) -> Grant:
        """(term, head)."""
        return (self.term, self.head)


class Airframe(Struct, frozen=True, kw_only=True):
    """Emulated body, which outlives the process: the centre of the tracked disc, the battery, the last step's slot.

    `slot` is the slot at whose end the UAV is at `x_m y_m`; its step in that slot began at `from_x_m from_y_m` (None:
    it rests). `body` is the true motion of a body with inertia.
    """

    x_m: float
    y_m: float
    energy_j: float
    stepped_slot: int = -1
    slot: int = -1
    from_x_m: float | None = None
    from_y_m: float | None = None
    body: BodyState | None = None


def first_promise(entry: RosterEntry) -> Promise:
    """Return the promise of a new UAV: term 0 at the roster start."""
    return Promise(waypoint_x_m=entry.start_x_m, waypoint_y_m=entry.start_y_m)


def first_airframe(entry: RosterEntry) -> Airframe:
    """Return the body of a new UAV: at its roster start with a full battery."""
    return Airframe(x_m=entry.start_x_m, y_m=entry.start_y_m, energy_j=entry.energy_j)


def comes_too_late(after: Airframe, before: Airframe, mission: MissionMessage, now_ns: int) -> bool:
    """Return True if the vehicle does not accept the step that leads to `after`, since it has begun to land.

    A process that freezes between its decision and its write would else accept a step after any time.
    """
    failsafe = failsafe_of(mission)
    if failsafe is None or after.stepped_slot == before.stepped_slot:
        return False
    began_ns = (failsafe.landing_slot(before.stepped_slot) + LATE_FRACTION) * mission.slot_ns
    return now_ns - mission.epoch_ns > began_ns


@dataclass(frozen=True, slots=True)
class Situation:
    """State of a UAV at the tick of `slot`, which decides whether it may fly a command.

    `landing_slot` is the last slot in which it may accept a step, None without a failsafe. Its last step began at
    `from_m` (None: it rests), and the next one may differ from it by `change_m`.
    """

    slot: int
    grant: Grant
    waypoint_m: tuple[float, float]
    u_max_m: float
    late_tick: bool
    energy_j: float
    step_energy_j: float
    landing_slot: int | None = None
    from_m: Point | None = None
    change_m: float = math.inf


def refusal(command: Command, now: Situation) -> str | None:
    """Return the reason why the UAV rejects `command`, or None if the command is valid.

    The caller passes only commands that arrived before their slot began.
    """
    start_m = (command.start_x_m, command.start_y_m)
    length_m = math.hypot(command.target_x_m - start_m[0], command.target_y_m - start_m[1])
    reasons = (
        (command.slot != now.slot, "another slot"),
        ((command.term, command.head) != now.grant, "not from the head granted"),
        (start_m != now.waypoint_m, "does not start at the own waypoint"),
        (length_m > now.u_max_m, "longer than a slot allows"),
        (not _follows(command, now), "changes the speed more than the vehicle can"),
        (now.late_tick, "the tick was late"),
        (now.energy_j < now.step_energy_j, "the battery does not cover it"),
        (now.landing_slot is not None and now.slot > now.landing_slot, "the vehicle has landed"),
    )
    return next((reason for broken, reason in reasons if broken), None)


def _follows(command: Command, now: Situation) -> bool:
    start_m, to_m = (command.start_x_m, command.start_y_m), (command.target_x_m, command.target_y_m)
    return allows(start_m if now.from_m is None else now.from_m, start_m, to_m, now.change_m)


class Vehicle:
    """Tracked disc, body and battery of one UAV.

    Attributes
    ----------
    flown
        True flight of the present slot.
    """

    def __init__(
        self,
        mission: Mission,
        entry: RosterEntry,
        promise: Promise | None,
        airframe: Airframe,
        body: Body | None = None,
    ) -> None:
        self._mission = mission
        self._entry = entry
        self.change_m = change_of(mission, entry)
        self.waypoint_m = (airframe.x_m, airframe.y_m)
        self.from_m, self.slot = _start(airframe, self.waypoint_m), airframe.slot
        if promise is not None:
            self.waypoint_m = (promise.waypoint_x_m, promise.waypoint_y_m)
            self.from_m, self.slot = _start(promise, self.waypoint_m), promise.slot
        self.course = promise.course if promise is not None else Course()
        self.energy_j = airframe.energy_j
        self._body = body if body is not None else body_of(mission, entry, self.waypoint_m, airframe.body)
        self.flown = self._body.standing
        self._has_flown = False
        self.stepped_slot = max(airframe.stepped_slot, promise.stepped_slot if promise is not None else -1)
        self._failsafe = failsafe_of(mission)

    @property
    def airframe(self) -> Airframe:
        """The body to persist."""
        x_m, y_m = self.waypoint_m
        return Airframe(
            x_m=x_m,
            y_m=y_m,
            energy_j=self.energy_j,
            stepped_slot=self.stepped_slot,
            slot=self.slot,
            from_x_m=self.from_m[0],
            from_y_m=self.from_m[1],
            body=self._body.state,
        )

    @property
    def landing_slot(self) -> int | None:
        """Last slot in which the vehicle may accept a step, None without a failsafe."""
        return None if self._failsafe is None else self._failsafe.landing_slot(self.stepped_slot)

    def must_land(self, slot: int) -> bool:
        """Return True if the failsafe lands the vehicle in `slot`, whose step it has accepted by now if at all."""
        return self.landing_slot is not None and slot >= self.landing_slot

    @property
    def rests(self) -> bool:
        """True if the UAV does not move in this slot."""
        return self.from_m == self.waypoint_m

    @property
    def r_m(self) -> float:
        """Radius of the tracked disc, which grows by `GROWTH_M` at a time while the body flies without GPS."""
        return self._entry.r_m + GROWTH_M * math.ceil(self.flown.grown_m / GROWTH_M)

    @property
    def u_max_m(self) -> float:
        """Longest step that this UAV flies in a slot."""
        return self._mission.step_m(self._entry)

    @property
    def arrived(self) -> bool:
        """True if the UAV rests within 0.1 m of the last point of its course, and all others are reached.

        One with inertia rests at its waypoint if its last step is at most its step change long (a_max `dt_s` as a
        speed): without a command it then stays. A faster one flies past.
        """
        rests = rest_point(self.from_m, self.waypoint_m, self.change_m) == self.waypoint_m
        return rests and self.course.arrived(self._entry, self.waypoint_m)

    def refusal_of(self, goal: Goal) -> str:
        """Return why this UAV cannot fly a goal; "" if it accepts it."""
        return unflyable(self._mission, self._entry, self.waypoint_m, self.energy_j, goal.route)

    def step_energy_j(self, length_m: float) -> float:
        """Return the propulsion energy of one slot with a step of `length_m` at constant speed."""
        return step_energy_j(self._mission, length_m)

    def brake_until(self, slot: int) -> None:
        """Brake in the slots before `slot` for which the process did not run, as the vehicle did without it.

        A UAV that lost its memory may begin a slot again whose step its vehicle has flown.
        """
        self._has_flown = self.slot >= slot
        while self.slot < slot - 1 and self.from_m != self.waypoint_m:
            self.from_m, self.waypoint_m = braked(self.from_m, self.waypoint_m, self.change_m)
            self.slot += 1
            self._body.brake(self.slot, self.from_m, self.waypoint_m)
        self.slot = max(self.slot, slot - 1)

    def begin_slot(self, slots: int, command: Command | None) -> None:
        """Fly `command`, or brake; `slots` slots have passed since the last call (more than 1 after a freeze).

        A vehicle that stops at once holds instead, as does one that rests.
        """
        if self._has_flown:
            self._has_flown = False
            return
        if command is not None:
            self.from_m, self.waypoint_m = self.waypoint_m, (command.target_x_m, command.target_y_m)
            self.stepped_slot = command.slot
        else:
            self.from_m, self.waypoint_m = braked(self.from_m, self.waypoint_m, self.change_m)
        self.slot += 1
        self.course = self.course.after_step(self._entry, self.from_m, self.waypoint_m, slots, self._mission.dt_s)
        if self._mission.goals == "lifelong" and self.arrived:
            number = self.course.goal + 1
            target_m = next_goal(self._mission, self._entry.uav, number, self.waypoint_m)
            self.course = Course(goal=number, route=[target_m])
        self.flown = self._body.fly(self.slot, self.from_m, self.waypoint_m)
        if self.flown.charge_share is not None:
            self.energy_j = self.flown.charge_share * self._entry.energy_j
        hovered_j = self.step_energy_j(0.0) * (slots - 1)
        self.energy_j = max(0.0, self.energy_j - self.flown.propulsion_j - hovered_j)

    @property
    def position_m(self) -> tuple[float, float]:
        """Position in the fix of this slot, by GPS."""
        return self.flown.measured_m

    @property
    def next_position_m(self) -> tuple[float, float]:
        """Position in the next fix, after this slot, if the GPS error stays the same."""
        return self._body.next_measured_m

    def spend(self, energy_j: float) -> None:
        """Draw energy from the battery for radio or computation."""
        self.energy_j = max(0.0, self.energy_j - energy_j)

    def disturb(self, fault: VehicleFault) -> None:
        """Let a fault of GPS, wind or motors act from the next slot on."""
        self._body.disturb(fault)


def _start(state: Promise | Airframe, waypoint_m: Point) -> Point:
    """Return the start of a state's step; its end for a UAV that rests."""
    if state.from_x_m is None or state.from_y_m is None:
        return waypoint_m
    return state.from_x_m, state.from_y_m
