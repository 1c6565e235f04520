"""The vehicle that each UAV flies, what it asks of a plan, and the budget of its disc.

`r_m` = GPS error bound + tracking bound + body. `Budget` has the three parts and what the tracking bound consists of;
`check_vehicles` refuses a mission whose vehicles cannot keep to theirs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import msgspec

from edc_swarm.errors import MissionError
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.control_loop import MOST_SETTLING_S, LoopBounds, loop_bounds, loop_step
from edc_swarm.mission.fault_syntax import ONE_UAV
from edc_swarm.mission.faults import OUTAGE, ChangeGps, Gust, parse_fault
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.mission.vehicle_model import MAVLINK, OF_AUTOPILOTS, SETS, VehicleModel

GROWTH_M = 0.25
"""Least growth of a tracked disc: a planner computes ways round zones anew for each radius."""
LEAST_SHARE = 0.25
"""Least share of a vehicle's `a_max_mps2` that wind and controller may leave for the plan."""
LEAST_A_MAX_MPS2 = 0.05
"""Least `a_max_mps2`: with less, a vehicle needs more than a minute and a half to reach 5 m/s."""


@dataclass(frozen=True, slots=True)
class Budget:
    """The parts of one UAV's disc, in metres, and the accelerations behind them.

    Attributes
    ----------
    turn_m
        Deviation while the reference accelerates, since the acceleration lags.
    gust_m
        Deviation by turbulence and by the mission's gusts.
    correction_m
        Deviation by a GPS error that changes: the vehicle follows the correction of its estimate late.
    between_m
        What the deviation can grow between two steps of the controller.
    outage_m
        Drift in the first slot of an outage, of which no fix has told yet; 0 in a mission without outages.
    stated_m
        Tracking bound that the mission states in place of these; 0 for none.
    a_max_mps2
        Acceleration of the plan, after wind and controller have taken theirs.
    others_mps2
        Largest command of the controller beside the part that follows the plan.
    command_per_plan
        Largest command of the controller for each m/s² of the plan's acceleration.
    """

    r_m: float
    body_m: float
    gps_m: float
    turn_m: float = 0.0
    gust_m: float = 0.0
    correction_m: float = 0.0
    between_m: float = 0.0
    outage_m: float = 0.0
    stated_m: float = 0.0
    a_max_mps2: float = 0.0
    others_mps2: float = 0.0
    command_per_plan: float = 0.0

    @property
    def tracking_m(self) -> float:
        """Largest distance of the vehicle from its reference, less the error of its estimated position."""
        return self.stated_m or self.turn_m + self.gust_m + self.correction_m + self.between_m + self.outage_m

    @property
    def needed_m(self) -> float:
        """Radius that the three parts need together."""
        return self.gps_m + self.tracking_m + self.body_m

    def __str__(self) -> str:
        """Return the arithmetic of the disc."""
        sign = ">" if self.needed_m > self.r_m + 1e-9 else "<="
        return f"gps {self.gps_m:.2f} + tracking {self.tracking_m:.2f} + body {self.body_m:g} {sign} r {self.r_m:g}"


def vehicle_of(mission: Mission, entry: RosterEntry) -> VehicleModel:
    """Return the vehicle of a UAV, its own or the mission's, with all figures filled in from its parameter set."""
    own, common = entry.vehicle, mission.vehicle
    if own == MAVLINK != common.model:
        return _filled_in(VehicleModel(model="mavlink", **{name: getattr(common, name) for name in OF_AUTOPILOTS}))
    return _filled_in(VehicleModel(model=own) if own and own != common.model else common)


def a_max_mps2(mission: Mission, entry: RosterEntry) -> float | None:
    """Return the largest acceleration of a UAV's planned motion; None for an `ideal` vehicle, which has no limit.

    It is the vehicle's `a_max_mps2`, or less where wind and controller leave less of what the largest tilt gives.
    """
    return None if vehicle_of(mission, entry).is_ideal else budget_of(mission, entry).a_max_mps2


def step_change_m(mission: Mission, entry: RosterEntry) -> float | None:
    """Return the largest change of consecutive steps of a UAV, a_max dt^2, in metres; None for an `ideal` vehicle.

    The vehicle flies the uniform quadratic B-spline whose control points are the waypoints. In slot k, from waypoint
    p to p + u after step u', that is a parabola: it begins at p - u' / 2 with velocity u' / dt, ends at p + u / 2 with
    velocity u / dt, and has the constant acceleration (u - u') / dt^2. It stays inside the triangle of the last
    waypoint, p and p + u, so a mission with such vehicles needs `lag_slots = 1`. A vehicle that rests has u' = 0.
    """
    acceleration_mps2 = a_max_mps2(mission, entry)
    return None if acceleration_mps2 is None else acceleration_mps2 * mission.dt_s**2


def tracking_m(mission: Mission, entry: RosterEntry) -> float:
    """Return the tracking bound of a UAV (`Budget.tracking_m`): 0 for an `ideal` vehicle, else stated or computed."""
    return budget_of(mission, entry).tracking_m


def gps_bound_m(mission: Mission, entry: RosterEntry) -> float:
    """Return the GPS error bound of a UAV: stated, else all that tracking bound and body leave of its disc."""
    return budget_of(mission, entry).gps_m


def grown_r_m(mission: Mission, entry: RosterEntry) -> float:
    """Return the largest radius that the disc of a UAV can have: the outages of the mission's faults let it grow."""
    vehicle = vehicle_of(mission, entry)
    if vehicle.is_ideal:
        return entry.r_m
    *_, outage_s = _faults_of(tuple(mission.fault), mission.dt_s, entry.uav)
    slots = min(mission.max_slots, outage_s / mission.dt_s)
    return entry.r_m + GROWTH_M * math.ceil(vehicle.drift_mps * mission.dt_s * slots / GROWTH_M)


def budget_of(mission: Mission, entry: RosterEntry) -> Budget:
    """Return the budget of one UAV's disc.

    The deviation of the true position x from the reference x_ref at a step of the controller is the sum of the loop's
    responses to its inputs (`control_loop.loop_bounds`), since the loop is linear as long as the command stays below
    what the largest tilt gives. With |.| the peak gains of the responses:

    - |turn| a_max: the reference's acceleration is constant in each slot and at most a_max (`step_change_m`);
    - |gust| (turbulence + the strongest gust of the mission's faults): the mean wind is trimmed before take-off, since
      the controller cancels the force that the inertial unit feels;
    - the error e of the estimated position: the vehicle flies at x_ref - e, late. The filter moves the estimate towards
      the fix and not beyond it. So e moves within the disc of radius `gps_m` that both it and the error of the fix lie
      in, a convex set, whatever the errors of the fixes are; and it moves at most at `correction_mps`. So |x - x_ref|
      is at most `gps_m` + |correction| `correction_mps`. It is also at most `gps_m` (1 + overshoot), which is less for
      a small `gps_m`; but without GPS e drifts out of that disc, so this form serves only if the mission has no outage;
    - without GPS, e drifts at `drift_mps`. Each fix tells how far it can have drifted by the end of its slot, and heads
      plan the next slot with that; so the drift of one slot is part of the bound;
    - between two steps of the controller, half a step h from the nearer one: h / 2 times the largest speed of the
      deviation, the sum of the same inputs' responses.

    With the peak gains of the command in place of those of the deviation, the command is at most |turn| a_max + |gust|
    (turbulence + gust) + |correction| `correction_mps` + drag at the speed `v_max` against the mean wind. Where
    g tan(tilt) is less, the plan's a_max is lowered to fit. Weak motors are a fault that no budget has room for.
    """
    vehicle = vehicle_of(mission, entry)
    r_m, body_m = entry.r_m or mission.r_m, entry.body_m or mission.body_m
    stated_gps_m = entry.gps_m or mission.gps_m
    if vehicle.is_ideal:
        return Budget(r_m, body_m, stated_gps_m or r_m - body_m)
    gust_mps, outage_s = _faults_of(tuple(mission.fault), mission.dt_s, entry.uav)
    winds = (mission.wind.mean_mps, mission.wind.gust_mps + gust_mps)
    speed_mps = mission.speed_mps(entry)
    return _budget(vehicle, mission.dt_s, speed_mps, winds, (r_m, body_m, stated_gps_m), outage_s > 0)


@cache
def _budget(
    vehicle: VehicleModel,
    dt_s: float,
    speed_mps: float,
    winds: tuple[float, float],
    disc: tuple[float, float, float],
    has_outage: bool,
) -> Budget:
    """Return the budget for the mean and the greatest other wind, and for radius, body and stated GPS bound."""
    mean_mps, gust_mps = winds
    r_m, body_m, stated_gps_m = disc
    loop = settled_loop(vehicle, dt_s)
    shift_mps = vehicle.correction_mps
    others_mps2 = (
        loop.gust.command * gust_mps + loop.correction.command * shift_mps + vehicle.drag_per_s * (speed_mps + mean_mps)
    )
    left_mps2 = (vehicle.limit_mps2 - others_mps2) / loop.acceleration.command
    plan_mps2 = min(vehicle.a_max_mps2, left_mps2)
    turn_m, gust_m = loop.acceleration.deviation * plan_mps2, loop.gust.deviation * gust_mps
    deviation_mps = loop.acceleration.speed * plan_mps2 + loop.gust.speed * gust_mps + loop.correction.speed * shift_mps
    between_m = 0.5 * loop_step(vehicle.lag_s, vehicle.drag_per_s, dt_s).step_s * deviation_mps
    most_m = loop.correction.deviation * shift_mps
    outage_m = vehicle.drift_mps * dt_s if has_outage else 0.0
    left_m = r_m - body_m - (vehicle.tracking_m or turn_m + gust_m + between_m + outage_m)
    factor = float("inf") if has_outage else loop.overshoot
    gps_m = stated_gps_m or max(0.0, left_m if vehicle.tracking_m else max(left_m - most_m, left_m / (1 + factor)))
    return Budget(
        r_m=r_m,
        body_m=body_m,
        gps_m=gps_m,
        turn_m=turn_m,
        gust_m=gust_m,
        correction_m=min(most_m, factor * gps_m) if gps_m else 0.0,
        between_m=between_m,
        outage_m=outage_m,
        stated_m=vehicle.tracking_m,
        a_max_mps2=plan_mps2,
        others_mps2=others_mps2,
        command_per_plan=loop.acceleration.command,
    )


def check_vehicles(mission: Mission) -> None:
    """Raise `MissionError` for a vehicle that cannot fly: its lag, its gains, the wind, or the budget of its disc."""
    for index, entry in enumerate(mission.roster):
        vehicle = vehicle_of(mission, entry)
        if not vehicle.is_ideal:
            if mission.planner == "paper":
                raise MissionError(
                    "planner", "paper", f"edc, straight or an own one: it plans no acceleration of {vehicle.model}"
                )
            _check_vehicle(mission, vehicle)
        _check_budget(mission, index, entry, vehicle)


def _check_vehicle(mission: Mission, vehicle: VehicleModel) -> None:
    if vehicle.a_max_mps2 < LEAST_A_MAX_MPS2:
        allowed = f"at least {LEAST_A_MAX_MPS2:g}, or left out for the figure of {vehicle.model}"
        raise MissionError("vehicle.a_max_mps2", vehicle.a_max_mps2, allowed)
    if vehicle.lag_s > mission.dt_s:
        raise MissionError("vehicle.lag_s", vehicle.lag_s, f"at most a slot, dt_s ({mission.dt_s:g} s)")
    if vehicle.drift_mps > vehicle.correction_mps:
        raise MissionError(
            "vehicle.drift_mps", vehicle.drift_mps, f"at most correction_mps ({vehicle.correction_mps:g})"
        )
    if mission.guard_s:
        raise MissionError(
            "guard_s", mission.guard_s, f"0 with {vehicle.model}, which cannot stand still between steps"
        )
    settled_loop(vehicle, mission.dt_s)


def _check_budget(mission: Mission, index: int, entry: RosterEntry, vehicle: VehicleModel) -> None:
    budget = budget_of(mission, entry)
    if budget.a_max_mps2 < LEAST_SHARE * vehicle.a_max_mps2:
        wind = mission.wind
        raise MissionError(
            "wind.mean_mps, gust_mps",
            (wind.mean_mps, wind.gust_mps),
            f"less than {vehicle.model} can hold: {budget.others_mps2:.2f} m/s2 for wind, drag and control + "
            f"{budget.command_per_plan:.2f} x {LEAST_SHARE:g} a_max_mps2 ({vehicle.a_max_mps2:g}) > "
            f"{vehicle.limit_mps2:.2f} m/s2 at a tilt of {vehicle.tilt_deg:g} degrees",
        )
    if budget.needed_m > budget.r_m + 1e-9 or (not budget.gps_m and not vehicle.is_ideal):
        lower = "gps_m" if vehicle.is_ideal else "gps_m, gust_mps or vehicle.a_max_mps2"
        raise MissionError(
            f"roster[{index}].r_m" if entry.r_m != mission.r_m else "r_m",
            budget.r_m,
            f"enough for {entry.uav}: {budget}: lower {lower}, or raise r_m to {budget.needed_m:.2f}",
        )


def settled_loop(vehicle: VehicleModel, dt_s: float) -> LoopBounds:
    """Return the responses of a vehicle's closed loop.

    Raises
    ------
    MissionError
        The loop does not settle.
    """
    loop = loop_bounds(vehicle, dt_s)
    if loop is None:
        gains = (vehicle.position_gain_per_s, vehicle.velocity_gain_per_s)
        allowed = f"gains that settle within {MOST_SETTLING_S:g} s with lag_s = {vehicle.lag_s:g}"
        raise MissionError("vehicle.position_gain_per_s, velocity_gain_per_s", gains, allowed)
    return loop


@cache
def _filled_in(stated: VehicleModel) -> VehicleModel:
    if stated.is_ideal:
        return stated
    figures = msgspec.structs.asdict(SETS[stated.model])
    given = {name: value for name, value in msgspec.structs.asdict(stated).items() if value}
    return VehicleModel(**{**figures, **given})


@cache
def _faults_of(texts: tuple[str, ...], dt_s: float, uav: str) -> tuple[float, float]:
    """Return the speed of the strongest gust of the mission's faults that can hit `uav`, and its time without GPS.

    An outage may last a slot more than it says, since it begins and ends with a slot.

    `head` and `standby` can be any UAV.
    """
    faults = [parse_fault(text, dt_s) for text in texts]
    hits = [fault for fault in faults if isinstance(fault, Gust | ChangeGps) and fault.target in {uav, *ONE_UAV}]
    gust_mps = max((fault.speed_mps for fault in hits if isinstance(fault, Gust)), default=0.0)
    return gust_mps, sum(fault.for_s + dt_s for fault in hits if isinstance(fault, ChangeGps) and fault.model == OUTAGE)
