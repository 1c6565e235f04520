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
from typing import Annotated

from msgspec import Meta, Struct

from edc_swarm.mission.field_types import (
    MAX_CLUSTERS,
    MAX_FAULTS,
    MAX_LINKS,
    MAX_UAVS,
    MAX_ZONES,
    MOST_M,
    MOST_SLOTS,
    Control,
    FailsafeAction,
    FaultText,
    Fence,
    Goals,
    GoalSource,
    Minimise,
    MissionId,
    NonNegative,
    Option,
    PartName,
    PlannerName,
    Positive,
    Speed,
)
from edc_swarm.mission.link import Link
from edc_swarm.mission.power_models import EnergyModel, HeadModel
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.mission.trace import MAX_TRACES, Trace
from edc_swarm.mission.vehicle_model import VehicleModel
from edc_swarm.mission.wind_model import WindModel
from edc_swarm.mission.zone import Zone

AREA_M2 = 10_000.0
"""Default of `area_m2`."""

NS_PER_S = 1_000_000_000


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
    """GPS error radius: radius of the disc around the reported position in which the true position is.

    No two of these discs may overlap (eq. 16).

    Source: the paper, section IV.
    """
    body_m: Positive = 0.25
    """Radius of the vehicle itself.

    It decides what a true collision is. The disc of radius `r_m` holds the whole vehicle, so the GPS error is at most
    `r_m` - `body_m`. At most `r_m`.
    """
    gps_m: NonNegative = 0.0
    """GPS error bound: largest distance of a measured position from the true one.

    The disc of radius `r_m` holds the GPS error, the tracking bound of the vehicle (0 for `ideal`) and the body, so
    `gps_m` + tracking bound + `body_m` is at most `r_m`.

    Default: 0, which stands for all that tracking bound and body leave of `r_m`.
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
    """Planner: edc, straight, paper, orca, bvc, cbf, priority, or package.module:Class.

    `edc` keeps all discs apart, `straight` avoids nothing, `paper` is eq. 29-43 as printed. The baselines `orca`,
    `bvc`, `cbf` and `priority` are published methods of others (docs/baselines.md). They plan
    without zones, without `lag_slots`, and for vehicles that stop at once.
    """
    control: Annotated[Control, Option("control")] = "head"
    """Control of the swarm: a `head` plans for all UAVs, or each UAV is `local` and plans its own steps.

    With `local` there is no head and no election. Every UAV hears the fixes of all others over the same links, and
    plans its next step with planner `orca`, `bvc`, `cbf` or package.module:Class. Separation is measured, not promised.

    Source: the paper, section I, names decentralised control as the alternative.
    """
    clusters: Annotated[int, Meta(ge=1, le=MAX_CLUSTERS), Option("clusters")] = 1
    """Number of clusters, each with a head, a quorum and terms of its own, in one airspace.

    UAVs whose starts and targets are near each other form a cluster (k-means, drawn from `seed`), unless the entries of
    the roster name their clusters. At most `uavs`. Planner `edc` keeps the UAVs of all clusters apart
    (docs/clusters.md).

    Source: this project; the paper has one cluster.
    """
    minimise: Annotated[Minimise, Option("minimise")] = "distance"
    """Quantity that the guidance of planner `edc` minimises.

    Source: the paper, section III-B, minimises the distance.
    """
    responses: Annotated[int, Meta(ge=1, le=8), Option("responses")] = 1
    """Largest number of rounds of best responses in a slot, in the guidance of planner `edc`.

    UAVs whose tracks conflict answer the tracks of the others in turn; a further round is made while conflicts are
    left. Crowds fly less far with 3, and a plan takes up to three times as long (docs/planner.md has both).

    Source: this project.
    """
    elect: Annotated[PartName, Option("elect")] = "energy"
    """Criterion by which a head is elected: energy, response-time, or package.module:Class.

    `energy` elects the fullest battery, `response-time` the shortest response time.

    Source: the paper, section III-A, offers both.
    """
    gps_model: Annotated[PartName, Option("gps-model")] = "bias"
    """Model of the GPS error: none, bias, white, gauss-markov, or package.module:Class.

    `none`: no error. `bias`: one error for the whole flight. `white`: at each fix a new error, uniform in the disc, as
    in the paper (section II). `gauss-markov`: an error correlated over 30 s.
    """
    failsafe: Annotated[FailsafeAction, Option("failsafe")] = "land"
    """What a UAV does that has accepted no step for `land_after_s`: land where it is, or hold there for ever.

    The vehicle itself lands, although its process is dead, frozen or cut off. It leaves the airspace and never flies
    again in the mission, and heads soon plan as if it were not there. With `hold` it stays an obstacle.
    """
    land_after_s: Annotated[float, Meta(gt=0, le=1e6), Option("land-after")] = 10.0
    """Time without an accepted step after which a UAV lands.

    It counts in whole slots, and never fewer than `lease_slots` + 4, since a fail-over must not make anybody land.

    Source: the data link loss time of the autopilot PX4 (COM_DL_LOSS_T), whose default is 10 s. With the default slot
    it is ten times a fail-over.
    """
    landing_s: Annotated[float, Meta(ge=0, le=1e6)] = 10.0
    """Longest time that a UAV takes from the decision to land until it is on the ground.

    A head takes a UAV for landed when `land_after_s`, this time and a guard for clocks are over.

    Source: this project; 7 m of height at 0.7 m/s.
    """
    standbys: Annotated[int, Meta(ge=0, le=100)] = 3
    """Number of standbys that the head names, best first.

    Only a standby claims to lead before all others may, so without standbys a fail-over takes longer.
    """
    lease_slots: Annotated[int, Meta(ge=1, le=1000)] = 2
    """Slots without a report of the head after which a UAV suspects the head.

    Fewer slots make a fail-over faster, and suspicion by mere loss of messages likelier.
    """
    resends: Annotated[int, Meta(ge=0, le=1000), Option("resends")] = 0
    """Largest number of messages of each UAV in a slot that repeat others: half its fixes, half commands to it.

    Fixes, commands, claims and, while UAVs are unheard, reports are repeated within their slot, so often that all
    copies are lost with a probability of 2 % by the loss that the UAVs measure. Without loss nothing is repeated, but
    by UAVs that no command has reached for `lease_slots` + 2 slots. 10 suffice for 50 % loss, 40 for 90 %.

    Default: 0, each message is sent once, as in the paper; on a channel that is full, repeats displace other messages.
    Source: this project.
    """
    lag_slots: Annotated[int, Meta(ge=0, le=1)] = 0
    """Slots by which a vehicle may finish its step late.

    With 1, each UAV is treated as the segment from its previous waypoint to its present one, which needs more room.
    A mission with vehicles that have inertia always has 1.
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
    goals: Goals = "once"
    """Goals of a UAV: `once`, its route alone, or `lifelong`, a new target whenever it has arrived.

    `seed`, the UAV and the number of the goal draw a new target; the discs of all UAVs at their targets are disjoint
    where there is room, and inside all inclusion and outside all exclusion zones. A lifelong mission lasts `max_slots`.
    """
    goals_from: GoalSource = "operator"
    """Senders of new goals that a UAV accepts in flight: the `operator` alone, or `any` process of the bus."""
    link: Annotated[list[Link], Meta(max_length=MAX_LINKS)] = []
    """Rules of the emulated network, tables `[[link]]`."""
    trace: Annotated[list[Trace], Meta(max_length=MAX_TRACES)] = []
    """Measured networks that links play back, tables `[[trace]]`, which the program makes from files."""
    zone: Annotated[list[Zone], Meta(max_length=MAX_ZONES)] = []
    """Zones of the airspace, tables `[[zone]]`.

    All zones together have at most 5000 corners. A circle counts as one corner, as an inclusion zone as 64.
    """
    fault: Annotated[list[FaultText], Meta(max_length=MAX_FAULTS), Option("fault")] = []
    """Faults of the mission, each a text such as "kill head @10"; `edc-swarm faults` lists all."""
    roster: Annotated[list[RosterEntry], Meta(max_length=MAX_UAVS)] = []
    """UAVs of the mission, tables `[[roster]]`.

    Default: empty, which stands for `uavs` UAVs drawn from `seed`.
    """
    energy: EnergyModel = EnergyModel()
    """Propulsion, radio and batteries, table `[energy]`."""
    head: HeadModel = HeadModel()
    """Cost of leading, table `[head]`."""
    vehicle: VehicleModel = VehicleModel()
    """Vehicle of the UAVs that name none of their own, table `[vehicle]`."""
    wind: WindModel = WindModel()
    """Wind, table `[wind]`."""

    @property
    def area_size_m(self) -> tuple[float, float]:
        """Width and height of the rectangle of a random mission, in metres."""
        side_m = math.sqrt(self.area_m2)
        return self.area_x_m or side_m, self.area_y_m or side_m

    @property
    def u_max_m(self) -> float:
        """Longest step in one slot of a UAV without a speed of its own, v_max (dt - 2 guard), in metres."""
        return self.v_max_mps * (self.dt_s - 2 * self.guard_s)

    def speed_mps(self, entry: RosterEntry) -> float:
        """Return the largest speed of a UAV: its own, else the mission's."""
        return entry.v_max_mps or self.v_max_mps

    def step_m(self, entry: RosterEntry) -> float:
        """Return the longest step of a UAV in one slot, v_k,max (dt - 2 guard), in metres."""
        return self.speed_mps(entry) * (self.dt_s - 2 * self.guard_s)

    @property
    def speeds_mps(self) -> list[float]:
        """Largest speed of every UAV, in roster order; the mission's for all UAVs if there is no roster yet."""
        return [self.speed_mps(entry) for entry in self.roster] or [self.v_max_mps] * self.uavs

    @property
    def steps_m(self) -> list[float]:
        """Longest step of every UAV in one slot, in the order of `speeds_mps`, in metres."""
        return [speed_mps * (self.dt_s - 2 * self.guard_s) for speed_mps in self.speeds_mps]

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
