"""The fields of a mission: each with its type, default, limits, unit and documentation, declared once.

A mission file is TOML; its keys are the fields of `Mission`. The mission message on the bus
(`edc_swarm.protocol.messages.MissionMessage`) uses the same names.

Everything that presents a field derives from its declaration here: the options of `run` and `sim` with their help,
docs/mission.md and scenarios/reference.toml (`declarations`, `reference`), and what an error says is allowed
(`wording`). The docstring below a field says in its first line what the field is, then what it does, with limits that
depend on other fields; "Default:" says what the default stands for, where the value alone does not; "Source:" says
where the default comes from, where that differs from the source of the class. The suffix of a name is its unit
(`declarations.UNITS`). `Option` names the option that sets the field.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from msgspec import Meta, Struct

MAX_UAVS = 2000
MAX_FAULTS = 1000
MAX_LINKS = 1000
MAX_ZONES = 1000
MAX_CORNERS = 1000
MAX_ALL_CORNERS = 5000
"""Most corners of all zones together, so that the mission with 2000 UAVs still fits into one message."""
RIM_CORNERS = 64
"""Corners of the polygon inscribed in a circular inclusion zone. It is smaller than the circle by at most 0.12 %."""
AREA_M2 = 10_000.0
"""Default of `area_m2`."""
MOST_SLOTS = 1_000_000
FOR_GOOD_S = 1e9
"""A link rule that ends then or later never ends."""

PlannerName = Annotated[str, Meta(min_length=1, max_length=200)]
Minimise = Literal["distance", "energy", "time"]
Criterion = Literal["energy", "response-time"]
GpsModel = Literal["none", "bias", "white", "gauss-markov"]
Distribution = Literal["constant", "uniform", "normal", "lognormal"]
ZoneKind = Literal["inclusion", "exclusion"]
ZoneRule = Literal["", "disc", "centre"]
Fence = Literal["area", "none"]

UavId = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]{1,32}$(?!\n)")]
MissionId = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]{1,64}$(?!\n)")]
MOST_M = 1e7
MOST = 1e12
"""Largest quantity of any kind: products of a few of them are still finite."""
Metres = Annotated[float, Meta(ge=-MOST_M, le=MOST_M)]
"""A coordinate in the local frame."""
Point = tuple[Metres, Metres]
"""A point (x, y) in the local frame."""
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


@dataclass(frozen=True, slots=True)
class Option:
    """The option of `edc-swarm run` and `sim` that sets the annotated field, by its name without dashes."""

    name: str


class EnergyModel(Struct, frozen=True, kw_only=True):
    """Rotary-wing propulsion power, radio energy, and the batteries of random missions.

    P(V) = P0 (1 + 3 V^2 / U_tip^2) + Pi sqrt(sqrt(1 + V^4 / (4 v0^4)) - V^2 / (2 v0^2))
    + d0 rho s A V^3 / 2, from Y. Zeng, J. Xu, R. Zhang, "Energy Minimization for Wireless
    Communication With Rotary-Wing UAV", IEEE Trans. Wireless Commun. 18(4), 2019, eq. 12.

    Source: Zeng, Xu, Zhang 2019, eq. 12.
    """

    blade_profile_w: Positive = 79.86
    """Blade profile power in hover, P0."""
    induced_w: Positive = 88.63
    """Induced power in hover, Pi."""
    tip_speed_mps: Positive = 120.0
    """Speed of the rotor blade's tip, U_tip."""
    induced_velocity_mps: Positive = 4.03
    """Mean velocity that the rotor induces in hover, v0."""
    drag_ratio: NonNegative = 0.6
    """Fuselage drag ratio, d0."""
    air_density_kgpm3: Positive = 1.225
    """Density of the air, rho."""
    rotor_solidity: Positive = 0.05
    """Rotor solidity, s."""
    rotor_area_m2: Positive = 0.503
    """Area of the rotor disc, A."""
    radio_j_per_message: NonNegative = 0.005
    """Energy that a UAV spends on each message that it publishes.

    Source: this project.
    """
    initial_min_j: Positive = 50_000.0
    """Least charge of a battery at the start of a random mission.

    Charges are drawn uniformly from `initial_min_j` to `initial_max_j`. At most `initial_max_j`.

    Source: this project.
    """
    initial_max_j: Positive = 100_000.0
    """Greatest charge of a battery at the start of a random mission.

    Source: this project.
    """


class HeadModel(Struct, frozen=True, kw_only=True):
    """Power that leading costs.

    Source: this project.
    """

    p_active_w: NonNegative = 5.0
    """Power that the head draws while its processor plans.

    Its energy is this power times the processor time that planning has taken.
    """


class RosterEntry(Struct, frozen=True, kw_only=True):
    """One UAV: its start, its target, its radii and its battery.

    Source: the user; a random mission draws it.
    """

    uav: UavId
    """Id of the UAV, which no other UAV has.

    Ids of processes are reserved: operator, recorder, viz, router, join, ca.
    """
    start_x_m: Metres
    """Start, first coordinate in the local frame (east).

    The discs of all UAVs at their starts are disjoint.
    """
    start_y_m: Metres
    """Start, second coordinate in the local frame (north)."""
    target_x_m: Metres
    """Target, first coordinate in the local frame (east).

    The discs of all UAVs at their targets are disjoint.
    """
    target_y_m: Metres
    """Target, second coordinate in the local frame (north)."""
    r_m: Positive
    """GPS error radius of this UAV, as `r_m` of the mission."""
    body_m: Positive
    """Radius of the vehicle itself, as `body_m` of the mission.

    At most `r_m`.
    """
    energy_j: Positive
    """Charge of the battery at the start.

    A UAV whose battery is empty lands where it is and stays an obstacle. The charge covers at least one step at full
    speed, unless the UAV starts at its target.
    """
    compute_factor: Positive = 1.0
    """Factor on the response time that the UAV reports, for the election criterion `response-time`.

    Source: this project.
    """

    @property
    def straight_m(self) -> float:
        """Length of the straight line from start to target, in metres."""
        return math.hypot(self.target_x_m - self.start_x_m, self.target_y_m - self.start_y_m)


class Link(Struct, frozen=True, kw_only=True):
    """One rule of the emulated network: the quality of the directed links from `sender` to `receiver`.

    The last rule that matches a sender, a receiver and a time decides. A link without a rule is perfect.

    Source: this project.
    """

    sender: LinkEnd = "*"
    """Id of the sending UAV; "*" is every UAV."""
    receiver: LinkEnd = "*"
    """Id of the receiving UAV; "*" is every UAV."""
    delay_ms: Annotated[NonNegative, Option("delay-ms")] = 0.0
    """One-way delay of a link.

    It comes on top of the delay of the real transport. The emulator applies it in the receiving agent.
    """
    jitter_ms: Annotated[NonNegative, Option("jitter-ms")] = 0.0
    """Jitter of a link: an additional delay, drawn for each message as `distribution` says."""
    distribution: Distribution = "uniform"
    """Distribution of the jitter J.

    `constant` adds none, `uniform` adds U(0, J), `normal` adds |N(0, J)| clipped at 3 J, `lognormal` adds a lognormal
    delay of median J / 2.
    """
    loss: Annotated[Fraction, Option("loss")] = 0.0
    """Fraction of the messages that a link loses, each independently."""
    burst_enter: Fraction = 0.0
    """Probability per message that the link enters its bad state (Gilbert-Elliott); 0: no bursts.

    Source: E. N. Gilbert, Bell Syst. Tech. J. 39(5), 1960; E. O. Elliott, ibid. 42(5), 1963.
    """
    burst_leave: Fraction = 0.5
    """Probability per message that the link leaves its bad state."""
    burst_loss: Fraction = 1.0
    """Fraction of the messages that the link loses in its bad state, in place of `loss`."""
    duplicate: Fraction = 0.0
    """Probability that a message arrives twice."""
    reorder: Fraction = 0.0
    """Probability that a message is delayed by up to three slots more, so that later messages overtake it."""
    range_m: NonNegative = 0.0
    """Radio range: the distance at which half of the messages are lost; 0: no limit.

    More messages are lost beyond it, fewer within.

    Source: T. S. Rappaport, "Wireless Communications", 2nd ed., 2002, sections 4.9.1-4.9.3.
    """
    path_loss_exponent: Positive = 2.0
    """Exponent of the path loss: the received power falls as distance to this power.

    Source: free space.
    """
    shadowing_db: NonNegative = 4.0
    """Standard deviation of the received power, drawn for each message; 0: every message beyond `range_m` is lost."""
    start_s: NonNegative = 0.0
    """Mission time at which the rule begins."""
    end_s: NonNegative = FOR_GOOD_S
    """Mission time at which the rule ends; from 1e9 on it never ends."""


class Zone(Struct, frozen=True, kw_only=True):
    """One zone of the airspace: a polygon or a circle that UAVs must not leave, or must not enter.

    A UAV stays inside all inclusion zones and outside all exclusion zones.

    Source: the user.
    """

    name: Annotated[str, Meta(min_length=1, max_length=64)]
    """Name of the zone, which no other zone has."""
    kind: ZoneKind
    """Kind of the zone: `inclusion` (a fence that no UAV leaves) or `exclusion` (no UAV enters)."""
    polygon: Annotated[list[Point], Meta(max_length=MAX_CORNERS)] = []
    """Corners (x, y) of a simple polygon, at least three, in either sense of rotation; or else `centre`, `radius_m`."""
    centre: Annotated[list[Metres], Meta(max_length=2)] = []
    """Centre (x, y) of a circle, for a zone without `polygon`."""
    radius_m: NonNegative = 0.0
    """Radius of the circle about `centre`, for a zone without `polygon`."""
    keep: ZoneRule = ""
    """Part of a UAV that keeps to the zone: its whole tracked `disc`, or the `centre` of the disc.

    Default: "", which stands for `centre` at an inclusion zone and `disc` at an exclusion zone.
    """

    @property
    def keeps_disc(self) -> bool:
        """True if the whole tracked disc keeps to the zone, False if only its centre does."""
        return self.keep == "disc" or (self.keep == "" and self.kind == "exclusion")

    @property
    def corners(self) -> int:
        """Number of corners, which a circle has too: one as an exclusion zone, else those of its rim."""
        return len(self.polygon) or (RIM_CORNERS if self.kind == "inclusion" else 1)

    @property
    def bounds_m(self) -> tuple[float, float, float, float]:
        """Left, low, right and high edge of the box around the zone, in metres."""
        corners = self.polygon or [
            (self.centre[0] - self.radius_m, self.centre[1] - self.radius_m),
            (self.centre[0] + self.radius_m, self.centre[1] + self.radius_m),
        ]
        xs_m, ys_m = zip(*corners, strict=True)
        return min(xs_m), min(ys_m), max(xs_m), max(ys_m)


class Mission(Struct, frozen=True, kw_only=True):
    """Everything that decides how a mission goes.

    `tau_s`, `max_slots` and `roster` may be left out (0, 0, empty): `roster.complete_mission` then derives them, or
    draws them from `seed`.

    Source: this project.
    """

    name: MissionId = "mission"
    """Name of the mission, part of its keys on the bus and of its recording's name."""
    seed: Annotated[int, Meta(ge=0, le=(1 << 63) - 1), Option("seed")] = 0
    """Seed of everything that is drawn at random: positions, batteries, GPS errors, links, rights of way."""
    uavs: Annotated[int, Meta(ge=1, le=MAX_UAVS), Option("uavs")] = 10
    """Number of UAVs.

    The paper's K. Where there is a roster, it is the length of the roster.
    """
    area_m2: Annotated[Positive, Option("area")] = AREA_M2
    """Area of the square in which a random mission draws starts and targets.

    Starts are at least 1.05 * 2 `r_m` apart, targets too. A mission with `area_x_m` and `area_y_m` leaves it out.

    Source: the paper, section IV (sweep of the number of UAVs).
    """
    area_x_m: Annotated[float, Meta(ge=0, le=MOST_M), Option("area-x")] = 0.0
    """Width (east) of the rectangle in which a random mission draws starts and targets, in place of `area_m2`.

    The rectangle has a corner at the origin. Both `area_x_m` and `area_y_m` are given, or neither.

    Default: 0, which stands for the side of the square of `area_m2`.
    Source: the paper, section II (an area X x Y).
    """
    area_y_m: Annotated[float, Meta(ge=0, le=MOST_M), Option("area-y")] = 0.0
    """Height (north) of the rectangle in which a random mission draws starts and targets, in place of `area_m2`.

    Default: 0, which stands for the side of the square of `area_m2`.
    Source: the paper, section II (an area X x Y).
    """
    fence: Annotated[Fence, Option("fence")] = "area"
    """Fence of a random mission: its `area`, or `none`.

    `area` adds an inclusion zone named "area" to a random mission. A mission with a roster has only the zones that it
    states.
    """
    r_m: Annotated[Positive, Option("gps-error")] = 5.0
    """GPS error radius: of the disc around the reported position that holds the true one.

    No two of these discs may overlap (eq. 16).

    Source: the paper, section IV.
    """
    body_m: Positive = 0.25
    """Radius of the vehicle itself.

    It decides what a true collision is. The disc of radius `r_m` holds the whole vehicle, so the GPS error is at most
    `r_m` - `body_m`. At most `r_m`.
    """
    v_max_mps: Annotated[Speed, Option("speed-max")] = 5.0
    """Largest speed of a UAV.

    Longest step in a slot: `v_max_mps` (`dt_s` - 2 `guard_s`).
    """
    dt_s: Annotated[float, Meta(ge=0.02, le=60), Option("slot")] = 0.5
    """Length of a slot, the paper's Delta t.

    Within a slot all fixes reach the head, the head plans, and its commands reach the UAVs. Shorter slots leave less
    time for it; longer slots make longer steps, which need more room.
    """
    tau_s: NonNegative = 0.0
    """Longest wait of the head for late fixes, from the start of the slot.

    The rest of the slot is left for planning and for the commands. Less than `dt_s`.

    Default: 0, which stands for 0.4 `dt_s`.
    Source: the paper's tau (section III-A), without a value there.
    """
    guard_s: NonNegative = 0.0
    """Time at both ends of a slot in which UAVs stand still.

    Clocks that differ from the mission's by at most this cannot break the separation (G3). It shortens the steps.
    Less than half of `dt_s`.
    """
    max_slots: Annotated[int, Meta(ge=0, le=MOST_SLOTS), Option("max-slots")] = 0
    """Slots after which the mission is given up.

    Default: 0, which stands for as many as G7 needs for a verdict: after the last fault 20 times the longest straight
    flight, plus 200, and more where links lose messages for good.
    """
    time_scale: Annotated[float, Meta(ge=1e-3, le=1000), Option("time-scale")] = 1.0
    """Speed of the mission's time relative to the wall clock.

    A slot takes `dt_s` / `time_scale` of wall time; delays and jitters of links stay as they are.
    """
    planner: Annotated[PlannerName, Option("planner")] = "edc"
    """Planner: edc, straight, paper, or package.module:Class.

    `edc` keeps all discs apart, `straight` avoids nothing, `paper` is eq. 29-43 as printed.
    """
    minimise: Annotated[Minimise, Option("minimise")] = "distance"
    """Quantity that the guidance of planner `edc` minimises.

    Source: the paper, section III-B, minimises the distance.
    """
    elect: Annotated[Criterion, Option("elect")] = "energy"
    """Criterion by which a head is elected: the fullest battery, or the shortest response time.

    Source: the paper, section III-A, offers both.
    """
    gps_model: Annotated[GpsModel, Option("gps-model")] = "bias"
    """Model of the GPS error.

    `none`: no error. `bias`: one error for the whole flight. `white`: at each fix a new error, uniform in the disc, as
    in the paper (section II). `gauss-markov`: an error correlated over 30 s.
    """
    standbys: Annotated[int, Meta(ge=0, le=100)] = 3
    """Number of standbys that the head names, best first.

    Only a standby claims to lead before all others may, so without standbys a fail-over takes longer.
    """
    lease_slots: Annotated[int, Meta(ge=1, le=1000)] = 2
    """Slots without a report of the head after which a UAV suspects the head.

    Fewer slots make a fail-over faster, and suspicion by mere loss of messages likelier.
    """
    lag_slots: Annotated[int, Meta(ge=0, le=1)] = 0
    """Slots by which a vehicle may finish its step late.

    With 1, each UAV is treated as the segment from its previous waypoint to its present one, which needs more room.
    """
    handover_margin: NonNegative = 0.1
    """Lead of a standby at which the head hands over to it, as a fraction of the head's own criterion.

    With 0.1 and criterion `energy`, the head hands over when the standby's battery holds 10 % more.
    """
    origin_lat_deg: Annotated[float, Meta(ge=-89, le=89)] = 60.1841
    """Latitude of the origin of the local frame, WGS 84.

    Fixes carry latitude and longitude for viewers; no plan depends on them.

    Source: Aalto University, Espoo, where authors of the paper worked.
    """
    origin_lon_deg: Annotated[float, Meta(ge=-180, le=180)] = 24.8301
    """Longitude of the origin of the local frame, WGS 84.

    Source: Aalto University, Espoo.
    """
    link: Annotated[list[Link], Meta(max_length=MAX_LINKS)] = []
    """Rules of the emulated network, tables `[[link]]`."""
    zone: Annotated[list[Zone], Meta(max_length=MAX_ZONES)] = []
    """Zones of the airspace, tables `[[zone]]`.

    All zones together have at most 5000 corners. A circle counts as one corner, as an inclusion zone as 64.
    """
    fault: Annotated[list[FaultText], Meta(max_length=MAX_FAULTS), Option("fault")] = []
    """Faults of the mission, each a text such as "kill head @10".

    `edc-swarm run --fault-help` and docs/faults.md list them.
    """
    roster: Annotated[list[RosterEntry], Meta(max_length=MAX_UAVS)] = []
    """UAVs of the mission, tables `[[roster]]`.

    Default: empty, which stands for `uavs` UAVs drawn from `seed`.
    """
    energy: EnergyModel = EnergyModel()
    """Propulsion, radio and batteries, table `[energy]`."""
    head: HeadModel = HeadModel()
    """Cost of leading, table `[head]`."""

    @property
    def area_size_m(self) -> tuple[float, float]:
        """Width and height of the rectangle of a random mission, in metres."""
        side_m = math.sqrt(self.area_m2)
        return self.area_x_m or side_m, self.area_y_m or side_m

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


def default_tau_s(mission: Mission) -> float:
    """Return `tau_s` of the mission, or what its default stands for: 0.4 of the slot."""
    return mission.tau_s or 0.4 * mission.dt_s
