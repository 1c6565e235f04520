"""Messages of the bus, as structs; `keys` has their keys, `codec` their bytes.

Messages are JSON. Field names are fixed, since recordings outlive code; new fields get defaults,
readers ignore unknown fields. `seq` counts from 0 without gaps per publisher `instance` and key;
`sent_ns` is wall time in nanoseconds since 1970 (beyond 2^53: readers in JavaScript round it).
"""

from __future__ import annotations

import re
from collections.abc import Sequence, Set
from itertools import chain
from typing import Annotated, Literal, get_args

from msgspec import UNSET, Meta, Struct, UnsetType

from edc_swarm.mission.configuration import NS_PER_S, Mission
from edc_swarm.mission.field_types import (
    MAX_GOAL_POINTS,
    MAX_UAVS,
    MOST,
    FailsafeAction,
    Metres,
    NonNegative,
    Point,
    Positive,
    UavId,
)
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.mission.routes import Course

NO_ONE = ""
EPOCH_NS = 1_700_000_000 * NS_PER_S
"""Wall time at which every simulated mission begins."""

Instance = Annotated[str, Meta(max_length=64)]
Seq = Annotated[int, Meta(ge=0, lt=1 << 53)]
Slot = Annotated[int, Meta(ge=-1, lt=1 << 40)]
Term = Annotated[int, Meta(ge=0, lt=1 << 40)]
Ns = Annotated[int, Meta(ge=0, le=(1 << 63) - 1)]
HeadId = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]{0,32}$(?!\n)")]
Latitude = Annotated[float, Meta(ge=-90, le=90)]
Longitude = Annotated[float, Meta(ge=-180, le=180)]
UavIds = Annotated[list[UavId], Meta(max_length=MAX_UAVS)]
ReportedIds = Annotated[list[Annotated[str, Meta(min_length=1, max_length=32)]], Meta(max_length=MAX_UAVS)]
"""Ids of UAVs in a report, whose characters the codec checks at once (`Report.has_ids`): a pattern for each id took
a third of the time that a UAV needs for a slot of a mission with 200 UAVs."""
Claimants = Annotated[tuple[Annotated[str, Meta(pattern=r"^([0-9a-f]{16})?$(?!\n)")], ...], Meta(max_length=MAX_UAVS)]
Coordinates = Annotated[list[Metres], Meta(max_length=MAX_UAVS)]
Radii = Annotated[list[NonNegative], Meta(max_length=MAX_UAVS)]
Quantity = Annotated[float, Meta(ge=-MOST, le=MOST)]
"""A number of any sign. Its limits keep it finite, as for all numbers of messages."""
Share = Annotated[float, Meta(ge=0, le=1)]
Count = Annotated[int, Meta(ge=0, lt=1 << 53)]
CountOrNone = Annotated[int, Meta(ge=-1, lt=1 << 53)]
PlanStatus = Literal["planned", "no-qp-needed", "failed"]
"""Status of a report that carries a plan, as the planner gave it (`planner.interface.PlanStatus`)."""
Status = Literal[PlanStatus, "no-quorum", "claim"]
PLANNED: frozenset[Status] = frozenset(get_args(PlanStatus))
"""Every status of a report that carries a plan."""


class Fix(Struct, frozen=True, kw_only=True, gc=False):
    """A UAV's message for one slot: GPS position, heartbeat and grant.

    `x_m y_m` is the noisy position at the start of the slot, `waypoint_*` the centre of the tracked disc after
    the current command, `from_*` that centre before it. `term, head` is the grant; `suspects` is true if
    the UAV suspects that head; `voter` is false if the promise on disk was lost, or if the UAV strays. `course` is the
    UAV's goal and its place in it, as its promise has it. A UAV whose vehicle no longer follows its commands strays: by
    the end of the slot it is within `stray_m` of `x_m y_m`, or `on_ground` for good. `missed` is the share of the
    head's newest messages that the UAV did not hear; `next_slot` the slot of the command that it holds, in a repeat
    that acknowledges it.
    """

    uav: UavId
    instance: Instance = ""
    seq: Seq = 0
    sent_ns: Ns = 0
    slot: Slot
    x_m: Metres
    y_m: Metres
    lat_deg: Latitude = 0.0
    lon_deg: Longitude = 0.0
    r_m: Positive
    waypoint_x_m: Metres
    waypoint_y_m: Metres
    executing: bool = False
    command_term: CountOrNone = -1
    command_seq: CountOrNone = -1
    arrived: bool = False
    term: Term = 0
    head: HeadId = NO_ONE
    suspects: bool = False
    voter: bool = True
    from_x_m: Metres = 0.0
    from_y_m: Metres = 0.0
    energy_j: NonNegative = 0.0
    response_ms: NonNegative = 0.0
    held_slots: Count = 0
    late_ticks: Count = 0
    cpu_s: NonNegative = 0.0
    course: Course = Course()
    stray_m: NonNegative | UnsetType = UNSET
    on_ground: bool | UnsetType = UNSET
    missed: Share | UnsetType = UNSET
    next_slot: Slot | UnsetType = UNSET


class Truth(Struct, frozen=True, kw_only=True, gc=False):
    """The emulator's ground truth of a slot: the true motion, with equal points for a hold.

    Of an autopilot: the motion that it reported, told one or two slots later, without an energy.

    A vehicle with inertia also tells the waypoint at the end of its step (`waypoint_*`), its true positions at equal
    times between the two ends (`between_*`), at most 0.1 s apart, its energy of propulsion, and whether the controller
    asked for more acceleration than the vehicle has. Between two of these positions it is at most h^2 / 8 times its
    acceleration from their straight line, h apart: 0.01 m at 8 m/s2.
    """

    uav: UavId
    instance: Instance = ""
    seq: Seq = 0
    sent_ns: Ns = 0
    slot: Slot
    from_x_m: Metres
    from_y_m: Metres
    to_x_m: Metres
    to_y_m: Metres
    waypoint_x_m: Metres | UnsetType = UNSET
    waypoint_y_m: Metres | UnsetType = UNSET
    between_x_m: Coordinates | UnsetType = UNSET
    between_y_m: Coordinates | UnsetType = UNSET
    propulsion_j: NonNegative | UnsetType = UNSET
    saturated: bool | UnsetType = UNSET


class Command(Struct, frozen=True, kw_only=True, gc=False):
    """One UAV's step for one slot, with the paper's action (eq. 10, 11).

    `speed_mps` is V_k, `heading_rad` theta_k (direction of the velocity), `deviation_rad` alpha_k,
    its deviation from the bearing to the target. `fix_seq` is the number of the UAV's fix of the slot before
    from which the head planned, -1 if unknown (older recordings). `missed` is the share of the UAV's newest fixes that
    the head did not hear.
    """

    head: UavId
    uav: UavId
    instance: Instance = ""
    seq: Seq = 0
    sent_ns: Ns = 0
    slot: Slot
    term: Term
    start_x_m: Metres
    start_y_m: Metres
    target_x_m: Metres
    target_y_m: Metres
    vx_mps: Quantity = 0.0
    vy_mps: Quantity = 0.0
    speed_mps: NonNegative = 0.0
    heading_rad: Quantity = 0.0
    deviation_rad: Quantity = 0.0
    fix_seq: CountOrNone = -1
    missed: Share | UnsetType = UNSET


class Report(Struct, frozen=True, kw_only=True, gc=False):
    """The head's report of slot `slot` (its commands carry slot + 1).

    `hull_*` are parallel lists over the unheard UAVs and, last, the head itself: each UAV stays within
    the radius of the segment a-b through slot + 1. `landed` has the unheard UAVs without a hull: the failsafe has
    taken them out of the airspace before slot + 1 begins. `strays` has the unheard UAVs that do not follow their
    commands: their hulls grow. `min_gap_m` is the least planned centre distance minus R, or 0 if no two UAVs are near
    each other.
    `status` "claim" is a standby's claim of a new term; `grants` then has the UAVs that suspect the old head.
    """

    head: UavId
    instance: Instance = ""
    seq: Seq = 0
    sent_ns: Ns = 0
    slot: Slot
    term: Term
    planner: Annotated[str, Meta(max_length=200)] = ""
    status: Status
    heard: ReportedIds = []
    unheard: ReportedIds = []
    grants: ReportedIds = []
    quorum: Annotated[int, Meta(ge=0, le=MAX_UAVS)]
    plan_ms: NonNegative = 0.0
    guidance_ms: NonNegative = 0.0
    assemble_ms: NonNegative = 0.0
    solve_ms: NonNegative = 0.0
    iterations: Count = 0
    min_gap_m: Quantity = 0.0
    standby: ReportedIds = []
    successor: HeadId = NO_ONE
    next_term: Term = 0
    hull_uav: ReportedIds = []
    hull_ax_m: Coordinates = []
    hull_ay_m: Coordinates = []
    hull_bx_m: Coordinates = []
    hull_by_m: Coordinates = []
    hull_r_m: Radii = []
    landed: ReportedIds = []
    strays: ReportedIds | UnsetType = UNSET

    @property
    def has_quorum(self) -> bool:
        """True if this report proves that a quorum granted (term, head) in its slot."""
        return self.status in PLANNED and len(self.grants) >= self.quorum

    @property
    def hull_columns(self) -> tuple[list[float], ...]:
        """The lists parallel to `hull_uav`: both ends of the segment, then the radius."""
        return (self.hull_ax_m, self.hull_ay_m, self.hull_bx_m, self.hull_by_m, self.hull_r_m)

    def is_backed(self, roster: Set[str], quorum: int) -> bool:
        """Return True if the UAVs that grant it, with the head, are a quorum of the mission.

        `roster` and `quorum` are the mission's: no receiver believes the quorum that a report states.
        """
        return self.quorum == quorum and self.head in self.grants and len(roster & set(self.grants)) >= quorum

    @property
    def id_lists(self) -> tuple[list[str], ...]:
        """The lists of UAVs."""
        strays = [] if self.strays is UNSET else self.strays
        return (self.heard, self.unheard, self.grants, self.standby, self.hull_uav, self.landed, strays)

    @property
    def has_ids(self) -> bool:
        """True if the lists of UAVs have no characters that no id has."""
        return _id_characters("".join(chain(*self.id_lists))) is not None


_id_characters = re.compile(r"[A-Za-z0-9_-]*").fullmatch


class Event(Struct, frozen=True, kw_only=True, gc=False):
    """Notable occurrence: an injected fault, a transition, a warning, the end of a publisher."""

    source: Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]{1,32}$(?!\n)")]
    instance: Instance = ""
    seq: Seq = 0
    sent_ns: Ns = 0
    slot: Slot = -1
    kind: Annotated[str, Meta(max_length=64)]
    detail: Annotated[str, Meta(max_length=65536)] = ""


class Goal(Struct, frozen=True, kw_only=True, gc=False):
    """A new route for one UAV, from the operator, or from any process where the mission permits it.

    The UAV flies it from where it is, in place of all that it had still to fly, if `number` is higher than that of its
    goal. The UAV persists the goal, then acknowledges it by the `course` of its next fix, or says in an event
    `goal-refused` why it does not accept it. A sender that hears neither sends the goal again. `sent_ns` is after the
    mission message was sent.
    """

    source: Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]{1,32}$(?!\n)")]
    uav: UavId
    instance: Instance = ""
    seq: Seq = 0
    sent_ns: Ns = 0
    number: Annotated[int, Meta(ge=1, lt=1 << 40)]
    route: Annotated[list[Point], Meta(min_length=1, max_length=MAX_GOAL_POINTS)]


class MissionMessage(Mission, frozen=True, kw_only=True):
    """The mission as run: the mission file's fields with the roster filled in, plus the epoch.

    `claimants` has, in roster order, the claimant that may fly each UAV ("": the launcher of the mission);
    a process of another claimant leaves. It is empty if the launcher flies all UAVs. A message without `failsafe` is
    of a version whose UAVs held.
    """

    failsafe: FailsafeAction = "hold"
    epoch_ns: Ns
    claimants: Claimants = ()
    instance: Instance = ""
    seq: Seq = 0
    sent_ns: Ns = 0

    def claimant_of(self, uav: str) -> str:
        """Return the claimant that may fly `uav`, or "" for the launcher of the mission."""
        claimants = zip(self.roster, self.claimants, strict=False)
        return next((claimant for entry, claimant in claimants if entry.uav == uav), "")


Message = Fix | Truth | Command | Report | Event | Goal | MissionMessage


def roster_index(roster: Sequence[RosterEntry]) -> dict[str, int]:
    """Return the position of every UAV in the roster, by id."""
    return {entry.uav: index for index, entry in enumerate(roster)}


def mission_message(mission: Mission, epoch_ns: int = EPOCH_NS, name: str | None = None) -> MissionMessage:
    """Return the message that publishes a completed mission on the bus."""
    fields = {field: getattr(mission, field) for field in mission.__struct_fields__}
    return MissionMessage(**{**fields, "name": name or mission.name}, epoch_ns=epoch_ns)


__all__ = [
    "EPOCH_NS",
    "NO_ONE",
    "Command",
    "Event",
    "Fix",
    "Goal",
    "Message",
    "MissionMessage",
    "Report",
    "Truth",
    "mission_message",
    "roster_index",
]
