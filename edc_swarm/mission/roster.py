"""The roster of random missions, and the completion of a mission whose file leaves fields out."""

from __future__ import annotations

import math

import msgspec
import numpy as np
from numpy.typing import NDArray

from edc_swarm.errors import MissionError, PlacementError
from edc_swarm.mission.airspace import Airspace, check_goals, check_zones
from edc_swarm.mission.autopilots import check_autopilots, with_return
from edc_swarm.mission.baselines import check_baselines
from edc_swarm.mission.clustering import with_clusters
from edc_swarm.mission.configuration import Mission, default_tau_s
from edc_swarm.mission.inheritance import with_charges, with_radii
from edc_swarm.mission.passing import check_passing
from edc_swarm.mission.prospect import default_max_slots
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.mission.validation import check_links
from edc_swarm.mission.vehicle_budget import check_vehicles, vehicle_of
from edc_swarm.mission.zone import Zone
from edc_swarm.mission.zone_shapes import check_shapes

TRIES = 10_000
"""Draws after which a mission is rejected because a UAV does not fit."""
SPACING = 1.05
"""Least distance of random starts, and of random targets, in units of R = 2 r."""
FENCE = "area"
"""Name of the zone that is the fence of a random mission."""
_ENERGY_STREAM = 1


def complete_mission(mission: Mission) -> Mission:
    """Return the mission with its roster and fence, drawn if it has none, and with derived values where it states none.

    `tau_s` and `max_slots` are derived if they are 0; `lag_slots` is 1 if a vehicle has inertia.
    An entry of the roster has the radii of the mission and the charge of a random mission where it states none.

    Raises
    ------
    PlacementError
        The UAVs of a random mission do not fit into its area.
    MissionError
        A link or a fault names a UAV that is not in the roster, a fault cannot be read, zones leave a UAV no way, or
        they leave UAVs no room to pass each other.
    """
    fenced = mission if mission.roster else _fenced(mission)
    roster = _inherited(mission) if mission.roster else random_roster(fenced)
    whole = with_clusters(msgspec.structs.replace(fenced, roster=roster, uavs=len(roster)))
    check_links(whole)
    check_vehicles(whole)
    check_autopilots(whole)
    whole = with_return(whole)
    check_baselines(whole)
    check_zones(whole)
    check_goals(whole)
    check_passing(whole)
    max_slots = whole.max_slots or default_max_slots(whole)
    has_inertia = any(not vehicle_of(whole, entry).is_ideal for entry in whole.roster)
    lag_slots = 1 if has_inertia else whole.lag_slots
    return msgspec.structs.replace(whole, tau_s=default_tau_s(whole), max_slots=max_slots, lag_slots=lag_slots)


def random_roster(mission: Mission) -> list[RosterEntry]:
    """Return UAVs u001, u002, ... with starts and targets uniform in the free area, drawn from `seed` alone.

    One generator draws starts, then targets. Another one draws the batteries, so positions do not depend on them.

    Raises
    ------
    PlacementError
    """
    rng = np.random.default_rng(mission.seed)
    starts_m = _placed(rng, mission, "starts")
    targets_m = _placed(rng, mission, "targets")
    energies_j = _charges_j(mission, mission.uavs)
    return [
        RosterEntry(
            uav=uav,
            start_x_m=float(starts_m[index, 0]),
            start_y_m=float(starts_m[index, 1]),
            target_x_m=float(targets_m[index, 0]),
            target_y_m=float(targets_m[index, 1]),
            r_m=mission.r_m,
            body_m=mission.body_m,
            energy_j=energies_j[index],
        )
        for index, uav in enumerate(uav_ids(mission.uavs))
    ]


def _inherited(mission: Mission) -> list[RosterEntry]:
    """Return the mission's roster with nothing left out; the charge of an entry is that of its index."""
    roster = with_radii(mission)
    return roster if all(entry.energy_j for entry in roster) else with_charges(roster, _charges_j(mission, len(roster)))


def _charges_j(mission: Mission, count: int) -> list[float]:
    """Return the charges (count,) of the batteries of a random mission."""
    charge = np.random.default_rng([mission.seed, _ENERGY_STREAM])
    drawn_j: list[float] = charge.uniform(mission.energy.initial_min_j, mission.energy.initial_max_j, count).tolist()
    return drawn_j


def uav_ids(count: int) -> list[str]:
    """Return the ids of a random mission: u001, u002, ..."""
    return [f"u{number:03d}" for number in range(1, count + 1)]


def _fenced(mission: Mission) -> Mission:
    """Return a mission without a roster with the fence that it asks for."""
    if mission.fence == "none":
        return mission
    for index, zone in enumerate(mission.zone):
        if zone.name == FENCE:
            allowed = f'not "{FENCE}", which is the fence of a random mission (or fence = "none")'
            raise MissionError(f"zone[{index}].name", zone.name, allowed)
    x_m, y_m = mission.area_size_m
    fence = Zone(name=FENCE, kind="inclusion", polygon=[(0.0, 0.0), (x_m, 0.0), (x_m, y_m), (0.0, y_m)])
    check_shapes(zones := [*mission.zone, fence])
    return msgspec.structs.replace(mission, zone=zones)


def _placed(rng: np.random.Generator, mission: Mission, what: str) -> NDArray[np.float64]:
    """Return (K, 2) points in metres that zones allow, no two closer than `SPACING` R, by rejection sampling."""
    airspace = Airspace.of(mission.zone)
    points_m = np.empty((mission.uavs, 2))
    for index in range(mission.uavs):
        point_m = _free_point(rng, mission, airspace, points_m[:index])
        if point_m is None:
            area = f"area_m2 = {mission.area_m2:g}"
            if mission.area_x_m:
                area = f"area_x_m = {mission.area_x_m:g}, area_y_m = {mission.area_y_m:g}"
            zones = ", its zones" if len(mission.zone) > (mission.fence == "area") else ""
            raise PlacementError(
                "uavs",
                mission.uavs,
                f"few enough for {area}{zones} and r_m = {mission.r_m:g}"
                f" ({index} {what} found a place, then {TRIES} tries failed{_roomy(mission)})",
            )
        points_m[index] = point_m
    return points_m


def _roomy(mission: Mission) -> str:
    """Return an area that has room for so many UAVs, in words; empty where zones decide.

    Discs that are placed at random jam at 55 % of an area (random sequential adsorption), so 40 % is easy.
    """
    if len(mission.zone) > (mission.fence == "area"):
        return ""
    wanted_m2 = mission.uavs * math.pi * (SPACING * mission.r_m) ** 2 / 0.4
    return f"; area_m2 = {float(f'{1.05 * wanted_m2:.2g}'):.12g} has room"


def _free_point(
    rng: np.random.Generator, mission: Mission, airspace: Airspace, taken_m: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    least_m, r_m = SPACING * 2 * mission.r_m, np.array([mission.r_m])
    for _ in range(TRIES):
        point_m = rng.uniform(0, mission.area_size_m, 2)
        apart = not len(taken_m) or ((taken_m - point_m) ** 2).sum(axis=1).min() >= least_m**2
        if apart and (airspace.lack_m(point_m[None], r_m) <= 0).all():
            return point_m
    return None
