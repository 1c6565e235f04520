"""The mission: what a user may choose, its defaults and its limits.

A mission file is TOML; its keys are the fields of `Mission`. Unknown keys, wrong types and
non-finite numbers are refused with the field, the value and what is allowed. The same names are
used by the mission message on the bus (`edc_swarm.protocol.messages.MissionMessage`).
"""

from __future__ import annotations

import math
import re
from codecs import BOM_UTF8
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, cast, get_args, get_origin, get_type_hints

import msgspec
from msgspec import Meta, Struct

from edc_swarm.errors import InputError, MissionError
from edc_swarm.files import open_regular

MAX_UAVS = 2000
MAX_FAULTS = 1000
MAX_LINKS = 1000
MAX_MISSION_BYTES = 4 << 20
MOST_SLOTS = 1_000_000
FOR_GOOD_S = 1e9
"""A link rule that ends then or later never ends."""

PlannerName = Annotated[str, Meta(min_length=1, max_length=200)]
Minimise = Literal["distance", "energy", "time"]
Criterion = Literal["energy", "response-time"]
GpsModel = Literal["none", "bias", "white", "gauss-markov"]
Distribution = Literal["constant", "uniform", "normal", "lognormal"]

UavId = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]{1,32}$(?!\n)")]
MissionId = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]{1,64}$(?!\n)")]
MOST_M = 1e7
MOST = 1e12
"""Largest quantity of any kind: products of a few of them are still finite."""
Metres = Annotated[float, Meta(ge=-MOST_M, le=MOST_M)]
"""A coordinate in the local frame."""
Speed = Annotated[float, Meta(gt=0, le=1e4)]
Positive = Annotated[float, Meta(gt=0, le=MOST)]
NonNegative = Annotated[float, Meta(ge=0, le=MOST)]
Fraction = Annotated[float, Meta(ge=0, le=1)]
LinkEnd = Annotated[str, Meta(max_length=32)]
FaultText = Annotated[str, Meta(max_length=65536)]

OPERATOR, RECORDER, VISUALISER, ROUTER = "operator", "recorder", "viz", "router"
LIVE = "live"
"""A visualiser that only shows: it asks for orders of its own."""
ROLES = frozenset({OPERATOR, RECORDER, VISUALISER, ROUTER})
"""Processes beside the UAVs, by the names under which they speak and are certified."""
JOIN = "join"
"""In the place of a UAV's id in the liveliness token of a claimant (`edc-swarm join`), and its certificate's name."""
RESERVED_IDS = ROLES | {JOIN, "ca"}
"""No UAV may be named like a role, a claimant, or the file of the authority that certifies them."""

NS_PER_S = 1_000_000_000
ARRIVED_M = 0.1
"""A UAV closer than this to its target has arrived."""


class EnergyModel(Struct, frozen=True, kw_only=True):
    """Rotary-wing propulsion power and radio energy.

    P(V) = P0 (1 + 3 V^2 / U_tip^2) + Pi sqrt(sqrt(1 + V^4 / (4 v0^4)) - V^2 / (2 v0^2))
    + d0 rho s A V^3 / 2, from Y. Zeng, J. Xu, R. Zhang, "Energy Minimization for Wireless
    Communication With Rotary-Wing UAV", IEEE Trans. Wireless Commun. 18(4), 2019, eq. 12.
    """

    blade_profile_w: Positive = 79.86
    induced_w: Positive = 88.63
    tip_speed_mps: Positive = 120.0
    induced_velocity_mps: Positive = 4.03
    drag_ratio: NonNegative = 0.6
    air_density_kgpm3: Positive = 1.225
    rotor_solidity: Positive = 0.05
    rotor_area_m2: Positive = 0.503
    radio_j_per_message: NonNegative = 0.005
    initial_min_j: Positive = 50_000.0
    initial_max_j: Positive = 100_000.0


class HeadModel(Struct, frozen=True, kw_only=True):
    """What being the cluster head costs: power drawn per second of measured processor time."""

    p_active_w: NonNegative = 5.0


class RosterEntry(Struct, frozen=True, kw_only=True):
    """One UAV of the mission: where it starts, where it must go, its radii and its battery."""

    uav: UavId
    start_x_m: Metres
    start_y_m: Metres
    target_x_m: Metres
    target_y_m: Metres
    r_m: Positive
    body_m: Positive
    energy_j: Positive
    compute_factor: Positive = 1.0

    @property
    def straight_m(self) -> float:
        """Length of the straight line from start to target, in metres."""
        return math.hypot(self.target_x_m - self.start_x_m, self.target_y_m - self.start_y_m)


class Link(Struct, frozen=True, kw_only=True):
    """Quality of the directed links from `sender` to `receiver` ("*" is every UAV).

    Delay is in milliseconds of wall time. `distribution` shapes the jitter: `constant` adds none,
    `uniform` adds U(0, jitter), `normal` adds |N(0, jitter)| clipped at three jitters,
    `lognormal` adds a lognormal of median `jitter`/2. Loss is independent with probability
    `loss`, or bursty (Gilbert-Elliott) when `burst_enter` > 0: the link enters its bad state with
    that probability per message, leaves it with `burst_leave`, and loses `burst_loss` there. A message
    is delayed by up to three slots more with probability `reorder`, so that later ones overtake it.
    Where `range_m` > 0, messages are also lost to distance: half of them at `range_m`, more beyond it,
    fewer within (`links.fading_loss`; `shadowing_db` 0 is a sharp edge).
    """

    sender: LinkEnd = "*"
    receiver: LinkEnd = "*"
    delay_ms: NonNegative = 0.0
    jitter_ms: NonNegative = 0.0
    distribution: Distribution = "uniform"
    loss: Fraction = 0.0
    burst_enter: Fraction = 0.0
    burst_leave: Fraction = 0.5
    burst_loss: Fraction = 1.0
    duplicate: Fraction = 0.0
    reorder: Fraction = 0.0
    range_m: NonNegative = 0.0
    path_loss_exponent: Positive = 2.0
    shadowing_db: NonNegative = 4.0
    start_s: NonNegative = 0.0
    end_s: NonNegative = FOR_GOOD_S


class Mission(Struct, frozen=True, kw_only=True):
    """Everything that decides how a mission goes. See `defaults` in each field.

    `tau_s`, `max_slots` and `roster` may be left out (0, 0, empty): they are then derived
    (`prospect.default_max_slots`), or drawn at random from `seed`.
    """

    name: MissionId = "mission"
    seed: Annotated[int, Meta(ge=0, le=(1 << 63) - 1)] = 0
    uavs: Annotated[int, Meta(ge=1, le=MAX_UAVS)] = 10
    area_m2: Positive = 10_000.0
    r_m: Positive = 5.0
    body_m: Positive = 0.25
    v_max_mps: Speed = 5.0
    dt_s: Annotated[float, Meta(ge=0.02, le=60)] = 0.5
    tau_s: NonNegative = 0.0
    guard_s: NonNegative = 0.0
    max_slots: Annotated[int, Meta(ge=0, le=MOST_SLOTS)] = 0
    time_scale: Annotated[float, Meta(ge=1e-3, le=1000)] = 1.0
    planner: PlannerName = "edc"
    minimise: Minimise = "distance"
    elect: Criterion = "energy"
    gps_model: GpsModel = "bias"
    standbys: Annotated[int, Meta(ge=0, le=100)] = 3
    lease_slots: Annotated[int, Meta(ge=1, le=1000)] = 2
    lag_slots: Annotated[int, Meta(ge=0, le=1)] = 0
    handover_margin: NonNegative = 0.1
    origin_lat_deg: Annotated[float, Meta(ge=-89, le=89)] = 60.1841
    origin_lon_deg: Annotated[float, Meta(ge=-180, le=180)] = 24.8301
    link: Annotated[list[Link], Meta(max_length=MAX_LINKS)] = []
    fault: Annotated[list[FaultText], Meta(max_length=MAX_FAULTS)] = []
    roster: Annotated[list[RosterEntry], Meta(max_length=MAX_UAVS)] = []
    energy: EnergyModel = EnergyModel()
    head: HeadModel = HeadModel()

    @property
    def u_max_m(self) -> float:
        """Longest step in one slot, v_max (dt - 2 guard), in metres."""
        return self.v_max_mps * (self.dt_s - 2 * self.guard_s)

    @property
    def quorum(self) -> int:
        """Grants that a head needs: more than half of the roster."""
        return len(self.roster) // 2 + 1

    @property
    def slot_ns(self) -> int:
        """Wall-clock length of a slot in nanoseconds (mission time over `time_scale`)."""
        return round(self.dt_s * NS_PER_S / self.time_scale)


T = TypeVar("T", bound=Struct)
_NAME_PATTERN = re.compile(r"Expected `str` matching regex '\^\[A-Za-z0-9_-\]\{(\d+),(\d+)\}\$.*'")
"""How msgspec refuses a name, in place of which users are told in words what a name may be."""


def load_mission(path: str | Path, what: str = "mission file") -> Mission:
    """Read and validate a mission file; `what` names it to the user.

    Raises
    ------
    MissionError
        The file is missing, too large, not TOML, or a field is not acceptable.
    """
    return mission_from_dict(read_toml(what, path, MissionError))


def read_toml(what: str, path: str | Path, refused: type[InputError] = InputError) -> dict[str, Any]:
    """The content of a TOML file of moderate size, not checked yet; `what` names it to the user.

    Raises
    ------
    InputError
        As `refused`: the file cannot be read, is too large, or is not TOML.
    """
    file = Path(path)
    try:
        with open_regular(file) as opened:
            text = opened.read(MAX_MISSION_BYTES + 1)
        if len(text) > MAX_MISSION_BYTES:
            raise refused(what, str(file), f"at most {MAX_MISSION_BYTES} bytes, not {file.stat().st_size}")
        return cast("dict[str, Any]", msgspec.toml.decode(text.removeprefix(BOM_UTF8)))
    except OSError as error:
        raise refused(what, str(file), f"a readable file ({error.strerror})") from None
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise refused(what, str(file), f"valid TOML ({error})") from None


def mission_from_dict(raw: Mapping[str, Any]) -> Mission:
    """Validate plain data as a mission (units as in the field names).

    Raises
    ------
    MissionError
        With the field, the value and what is allowed.
    """
    refuse_unknown(raw, Mission)
    refuse_non_finite(raw)
    roster = raw.get("roster")
    if isinstance(roster, list) and roster:
        raw = {"uavs": len(roster), **raw}
    mission = convert(raw, Mission)
    validate_mission(mission)
    return mission


def with_options(mission: Mission, options: Mapping[str, Any]) -> Mission:
    """`mission` with the given fields replaced, validated as a whole again."""
    return mission_from_dict({**msgspec.to_builtins(mission), **options})


def convert(raw: Any, kind: type[T]) -> T:
    """`msgspec.convert` whose errors name field, value and what is allowed.

    Raises
    ------
    MissionError
    """
    try:
        return msgspec.convert(raw, kind)
    except msgspec.ValidationError as error:
        message, _, path = str(error).partition(" - at `$")
        path = path.rstrip("`").removeprefix(".")
        allowed = _NAME_PATTERN.sub(r"\1 to \2 of the letters a-z and A-Z, digits, - and _", message)
        allowed = allowed.removeprefix("Expected ").replace("`", "")
        raise MissionError(path or "mission", _at(raw, path), allowed) from None


def refuse_unknown(raw: Any, kind: Any, where: str = "") -> None:
    """Raise `MissionError` for a key of `raw` that `kind` (a Struct type) does not have."""
    if get_origin(kind) is Annotated:
        kind = get_args(kind)[0]
    if get_origin(kind) is list and isinstance(raw, list):
        for index, item in enumerate(raw):
            refuse_unknown(item, get_args(kind)[0], f"{where}[{index}]")
    elif isinstance(kind, type) and issubclass(kind, Struct) and isinstance(raw, Mapping):
        hints = get_type_hints(kind, include_extras=True)
        for key, value in raw.items():
            name = f"{where}.{key}" if where else str(key)
            if key not in hints:
                raise MissionError(name, value, f"one of the known keys: {', '.join(sorted(hints))}")
            refuse_unknown(value, hints[key], name)


def refuse_non_finite(raw: Any, where: str = "") -> None:
    """Raise `MissionError` for any infinite or NaN number inside plain data."""
    if isinstance(raw, float) and not math.isfinite(raw):
        raise MissionError(where, raw, "a finite number")
    if isinstance(raw, Mapping):
        for key, value in raw.items():
            refuse_non_finite(value, f"{where}.{key}" if where else str(key))
    elif isinstance(raw, list):
        for index, value in enumerate(raw):
            refuse_non_finite(value, f"{where}[{index}]")


def default_tau_s(mission: Mission) -> float:
    """Wait of the head for late fixes: 0.4 of the slot unless the mission says otherwise."""
    return mission.tau_s or 0.4 * mission.dt_s


def validate_mission(mission: Mission) -> None:
    """Raise `MissionError` unless the fields fit together."""
    if mission.roster and mission.uavs != len(mission.roster):
        raise MissionError("uavs", mission.uavs, f"the length of the roster ({len(mission.roster)})")
    if 2 * mission.guard_s >= mission.dt_s:
        raise MissionError("guard_s", mission.guard_s, f"less than half of dt_s ({mission.dt_s})")
    if mission.tau_s >= mission.dt_s:
        raise MissionError("tau_s", mission.tau_s, f"less than dt_s ({mission.dt_s})")
    if mission.body_m > mission.r_m:
        raise MissionError("body_m", mission.body_m, f"at most r_m ({mission.r_m})")
    if mission.energy.initial_min_j > mission.energy.initial_max_j:
        raise MissionError("energy.initial_min_j", mission.energy.initial_min_j, "at most initial_max_j")
    _validate_roster(mission.roster)


def check_links(mission: Mission) -> None:
    """Raise `MissionError` for a link that names a UAV which is not in the roster."""
    known = {"*", *(entry.uav for entry in mission.roster)}
    for index, link in enumerate(mission.link):
        for end in ("sender", "receiver"):
            value = getattr(link, end)
            if value not in known:
                raise MissionError(f"link[{index}].{end}", value, 'the id of a UAV of the roster, or "*"')


def _validate_roster(roster: list[RosterEntry]) -> None:
    seen: set[str] = set()
    for index, entry in enumerate(roster):
        if entry.uav in seen:
            raise MissionError(f"roster[{index}].uav", entry.uav, "an id that no other UAV has")
        if entry.uav in RESERVED_IDS:
            raise MissionError(f"roster[{index}].uav", entry.uav, f"none of {', '.join(sorted(RESERVED_IDS))}")
        if entry.body_m > entry.r_m:
            raise MissionError(f"roster[{index}].body_m", entry.body_m, f"at most r_m ({entry.r_m})")
        seen.add(entry.uav)
    _validate_separation(roster, "start")
    _validate_separation(roster, "target")


def _validate_separation(roster: list[RosterEntry], which: str) -> None:
    """Starts and targets must be disjoint discs: otherwise no plan is safe, or none can end."""
    points = sorted((getattr(e, f"{which}_x_m"), getattr(e, f"{which}_y_m"), e.r_m, i) for i, e in enumerate(roster))
    widest_m = 2 * max((e.r_m for e in roster), default=0.0)
    for position, (x_m, y_m, r_m, index) in enumerate(points):
        for other_x_m, other_y_m, other_r_m, other in points[position + 1 :]:
            if other_x_m - x_m >= widest_m:
                break
            gap_m = math.hypot(other_x_m - x_m, other_y_m - y_m)
            if gap_m < r_m + other_r_m:
                raise MissionError(
                    f"roster[{index}].{which}_x_m, {which}_y_m",
                    (x_m, y_m),
                    f"at least {r_m + other_r_m:g} m from the {which} of {roster[other].uav}, not {gap_m:.3f} m",
                )


def _at(raw: Any, path: str) -> Any:
    """The value at a msgspec path such as `roster[2].r_m`, or None where it cannot be followed."""
    for part in re.findall(r"[^.\[\]]+", path):
        if isinstance(raw, Mapping):
            raw = raw.get(part)
        elif isinstance(raw, list) and part.isdigit():
            raw = raw[int(part)]
        else:
            return None
    return raw
