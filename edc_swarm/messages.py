"""What is said on the bus: structs, keys, and a codec that never lets bad bytes in.

Messages are JSON. Field names are fixed, since recordings outlive code; new fields get defaults,
unknown fields are ignored. `seq` counts from 0 without holes per publisher `instance` and key;
`sent_ns` is wall time in nanoseconds since 1970 (beyond 2^53: readers in JavaScript round it).
"""

from __future__ import annotations

import re
from collections.abc import Set
from typing import Annotated, Any, Literal, get_args

import msgspec
from msgspec import Meta, Struct

from edc_swarm.config import (
    MAX_UAVS,
    MOST,
    Metres,
    Mission,
    MissionId,
    NonNegative,
    Positive,
    RosterEntry,
    UavId,
    check_links,
    validate_mission,
)
from edc_swarm.errors import MessageError, MissionError
from edc_swarm.faults import parse_faults

MAX_MESSAGE_BYTES = 1 << 20
PREFIX = "swarm"
NO_ONE = ""

Instance = Annotated[str, Meta(max_length=64)]
Seq = Annotated[int, Meta(ge=0, lt=1 << 53)]
Slot = Annotated[int, Meta(ge=-1, lt=1 << 40)]
Term = Annotated[int, Meta(ge=0, lt=1 << 40)]
Ns = Annotated[int, Meta(ge=0, le=(1 << 63) - 1)]
HeadId = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]{0,32}$(?!\n)")]
Latitude = Annotated[float, Meta(ge=-90, le=90)]
Longitude = Annotated[float, Meta(ge=-180, le=180)]
UavIds = Annotated[list[UavId], Meta(max_length=MAX_UAVS)]
Claimants = Annotated[tuple[Annotated[str, Meta(pattern=r"^([0-9a-f]{16})?$(?!\n)")], ...], Meta(max_length=MAX_UAVS)]
Coordinates = Annotated[list[Metres], Meta(max_length=MAX_UAVS)]
Radii = Annotated[list[NonNegative], Meta(max_length=MAX_UAVS)]
Quantity = Annotated[float, Meta(ge=-MOST, le=MOST)]
"""A number of any sign; like all others it is finite, which is what its limits are for."""
Count = Annotated[int, Meta(ge=0, lt=1 << 53)]
CountOrNone = Annotated[int, Meta(ge=-1, lt=1 << 53)]
Status = Literal["planned", "no-qp-needed", "failed", "no-quorum", "claim"]


class Fix(Struct, frozen=True, kw_only=True, gc=False):
    """A UAV's report for one slot: GPS position, heartbeat and grant at once.

    `x_m y_m` is the noisy position as the slot begins, `waypoint_*` the centre of the tracked disc once
    the current command is done, `from_*` that centre before it. `term, head` is the grant; `suspects` says
    that the head is no longer heard; `voter` is false when the promise on disk was lost.
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


class Truth(Struct, frozen=True, kw_only=True, gc=False):
    """The emulator's ground truth of a slot: the true motion, equal points when held."""

    uav: UavId
    instance: Instance = ""
    seq: Seq = 0
    sent_ns: Ns = 0
    slot: Slot
    from_x_m: Metres
    from_y_m: Metres
    to_x_m: Metres
    to_y_m: Metres


class Command(Struct, frozen=True, kw_only=True, gc=False):
    """One UAV's step for one slot, with the paper's action (eq. 10, 11).

    `speed_mps` is V_k, `heading_rad` theta_k (direction of the velocity), `deviation_rad` alpha_k,
    its deviation from the bearing to the target. `fix_seq` is the number of the UAV's fix of the slot before
    that the head planned with, -1 where it is not told (older recordings).
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


class Report(Struct, frozen=True, kw_only=True, gc=False):
    """The head's account of slot `slot` (its commands carry slot + 1).

    `hull_*` are parallel lists over the unheard UAVs and, last, the head itself: the segment a-b and the
    radius about it that contain the UAV through slot + 1. `min_gap_m` is the least planned centre
    distance minus R. `status` "claim" is a standby's claim of a new term, `grants` then listing the UAVs
    that suspect the old head.
    """

    head: UavId
    instance: Instance = ""
    seq: Seq = 0
    sent_ns: Ns = 0
    slot: Slot
    term: Term
    planner: Annotated[str, Meta(max_length=200)] = ""
    status: Status
    heard: UavIds = []
    unheard: UavIds = []
    grants: UavIds = []
    quorum: Annotated[int, Meta(ge=0, le=MAX_UAVS)]
    plan_ms: NonNegative = 0.0
    guidance_ms: NonNegative = 0.0
    assemble_ms: NonNegative = 0.0
    solve_ms: NonNegative = 0.0
    iterations: Count = 0
    min_gap_m: Quantity = 0.0
    standby: UavIds = []
    successor: HeadId = NO_ONE
    next_term: Term = 0
    hull_uav: UavIds = []
    hull_ax_m: Coordinates = []
    hull_ay_m: Coordinates = []
    hull_bx_m: Coordinates = []
    hull_by_m: Coordinates = []
    hull_r_m: Radii = []

    @property
    def has_quorum(self) -> bool:
        """Whether this report proves that a quorum granted (term, head) in its slot."""
        return self.status in {"planned", "no-qp-needed", "failed"} and len(self.grants) >= self.quorum

    @property
    def hull_columns(self) -> tuple[list[float], ...]:
        """The lists beside `hull_uav`: both ends of the segment, then the radius."""
        return (self.hull_ax_m, self.hull_ay_m, self.hull_bx_m, self.hull_by_m, self.hull_r_m)

    def is_backed(self, roster: Set[str], quorum: int) -> bool:
        """Whether the UAVs that it names as its support are enough; a head's own word is not.

        `roster` and `quorum` are the mission's: nobody believes a report about how many it takes.
        """
        return self.quorum == quorum and self.head in self.grants and len(roster & set(self.grants)) >= quorum


class Event(Struct, frozen=True, kw_only=True, gc=False):
    """Something worth telling: a fault injected, a transition, a warning, the end of a publisher."""

    source: Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]{1,32}$(?!\n)")]
    instance: Instance = ""
    seq: Seq = 0
    sent_ns: Ns = 0
    slot: Slot = -1
    kind: Annotated[str, Meta(max_length=64)]
    detail: Annotated[str, Meta(max_length=65536)] = ""


class MissionMessage(Mission, frozen=True, kw_only=True):
    """The mission as run: the mission file's fields with the roster filled in, plus the epoch.

    `claimants`, in the order of the roster, say who may fly each UAV ("": whoever launched the
    mission); a process of another claimant leaves. Empty when nobody but the launcher flies.
    """

    epoch_ns: Ns
    claimants: Claimants = ()
    instance: Instance = ""
    seq: Seq = 0
    sent_ns: Ns = 0

    def claimant_of(self, uav: str) -> str:
        """Who may fly `uav`: a claimant, or "" for whoever launched the mission."""
        claimants = zip(self.roster, self.claimants, strict=False)
        return next((claimant for entry, claimant in claimants if entry.uav == uav), "")


Message = Fix | Truth | Command | Report | Event | MissionMessage

_KINDS: dict[tuple[str, int], type[Struct]] = {
    ("fix", 3): Fix,
    ("truth", 3): Truth,
    ("command", 4): Command,
    ("report", 3): Report,
    ("event", 2): Event,
    ("mission", 1): MissionMessage,
}
_DECODERS: dict[type[Struct], msgspec.json.Decoder[Any]] = {
    kind: msgspec.json.Decoder(kind) for kind in _KINDS.values()
}
_ENCODER = msgspec.json.Encoder()
_is_mission_id = re.compile(get_args(MissionId)[1].pattern).search


class Keys:
    """Key expressions of one mission, all below `swarm/{mission}`."""

    def __init__(self, mission_id: str) -> None:
        self.root = f"{PREFIX}/{mission_id}"
        self.mission = f"{self.root}/mission"
        self.all_fixes = f"{self.root}/uav/*/fix"
        self.all_truths = f"{self.root}/uav/*/truth"
        self.all_reports = f"{self.root}/head/*/report"
        self.all_alive = f"{self.root}/alive/**"
        self.everything = f"{self.root}/**"

    def fix(self, uav: str) -> str:
        """Key of a UAV's fixes."""
        return f"{self.root}/uav/{uav}/fix"

    def truth(self, uav: str) -> str:
        """Key of the emulator's ground truth of a UAV."""
        return f"{self.root}/uav/{uav}/truth"

    def command(self, head: str, uav: str) -> str:
        """Key of `head`'s commands to `uav`."""
        return f"{self.root}/head/{head}/command/{uav}"

    def commands_to(self, uav: str) -> str:
        """Key expression of every head's commands to `uav`."""
        return f"{self.root}/head/*/command/{uav}"

    def report(self, head: str) -> str:
        """Key of a head's slot reports."""
        return f"{self.root}/head/{head}/report"

    def event(self, source: str) -> str:
        """Key of a publisher's events."""
        return f"{self.root}/event/{source}"

    @property
    def claims(self) -> str:
        """Key on which the operator answers claims to fly a UAV."""
        return f"{self.root}/claims"

    def orders(self, name: str) -> str:
        """Key on which a part that nobody launched, such as the recorder, is told what to do."""
        return f"{self.root}/orders/{name}"

    def again(self, source: str, instance: str) -> str:
        """Key on which a publisher is asked for messages that have not arrived."""
        return f"{self.root}/again/{source}/{instance}"

    def alive(self, uav: str, instance: str) -> str:
        """Key of a process's liveliness token."""
        return f"{self.root}/alive/{uav}/{instance}"

    def of(self, message: Message) -> str:
        """Key on which `message` is published."""
        match message:
            case Fix():
                return self.fix(message.uav)
            case Truth():
                return self.truth(message.uav)
            case Command():
                return self.command(message.head, message.uav)
            case Report():
                return self.report(message.head)
            case Event():
                return self.event(message.source)
            case MissionMessage():
                return self.mission


def kind_of(key: str) -> type[Struct] | None:
    """Type of the messages on `key` (with or without the `swarm/{mission}` prefix), or None.

    A key that stands for many, such as `swarm/*/mission`, is no mission's.
    """
    parts = key.split("/")
    if parts[0] == PREFIX:
        if not _is_mission_id(parts[1] if len(parts) > 1 else ""):
            return None
        parts = parts[2:]
    if not parts:
        return None
    name = parts[0]
    if (name == "uav" and len(parts) == 3) or (name == "head" and len(parts) in {3, 4}):
        name = parts[2]
    return _KINDS.get((name, len(parts)))


def encode(message: Message) -> bytes:
    """The bytes of a message (JSON, shortest round-trip floats)."""
    return _ENCODER.encode(message)


def decode(key: str, payload: bytes) -> Message:
    """The message in `payload`, checked against the type, the limits and the sender in its key.

    Raises
    ------
    MessageError
        Unknown key, too large, malformed, a number beyond its limits (which no infinity is within), a
        sender or receiver that is not the one in the key, or a mission that no file could describe.
    """
    kind = kind_of(key)
    if kind is None:
        raise MessageError(key, "no message is defined for this key")
    if len(payload) > MAX_MESSAGE_BYTES:
        raise MessageError(key, f"{len(payload)} bytes, more than {MAX_MESSAGE_BYTES}")
    try:
        message: Message = _DECODERS[kind].decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise MessageError(key, str(error)) from None
    _check_key(key, message)
    if isinstance(message, MissionMessage):
        _check_mission(key, message)
    return message


def roster_index(roster: list[RosterEntry]) -> dict[str, int]:
    """Position of every UAV in the roster, by id."""
    return {entry.uav: index for index, entry in enumerate(roster)}


def _check_key(key: str, message: Message) -> None:
    parts = key.split("/")
    if parts[0] != PREFIX:
        return
    if Keys(parts[1]).of(message) != key:
        raise MessageError(key, "sender or receiver is not the one in the key")
    if isinstance(message, MissionMessage) and message.name != parts[1]:
        raise MessageError(key, "another mission's")


def _check_mission(key: str, mission: MissionMessage) -> None:
    """What is refused as a file is refused from the bus."""
    try:
        validate_mission(mission)
        check_links(mission)
        parse_faults(mission)
    except MissionError as error:
        raise MessageError(key, str(error)) from None
    if not (mission.roster and mission.max_slots and mission.tau_s):
        raise MessageError(key, "a mission without roster, max_slots or tau_s")
    if len(mission.claimants) not in {0, len(mission.roster)}:
        raise MessageError(key, "claimants must be none, or one for every UAV of the roster")


__all__ = [
    "MAX_MESSAGE_BYTES",
    "NO_ONE",
    "Command",
    "Event",
    "Fix",
    "Keys",
    "Message",
    "MissionMessage",
    "Report",
    "Truth",
    "decode",
    "encode",
    "kind_of",
    "roster_index",
]
