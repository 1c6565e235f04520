"""The vehicle that each UAV flies, and what it asks of a plan."""

from __future__ import annotations

import msgspec

from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.mission.vehicle_model import SETS, VehicleModel


def vehicle_of(mission: Mission, entry: RosterEntry) -> VehicleModel:
    """Return the vehicle of a UAV, its own or the mission's, with all figures filled in from its parameter set."""
    stated = VehicleModel(model=entry.vehicle) if entry.vehicle else mission.vehicle
    if stated.is_ideal:
        return stated
    figures = msgspec.structs.asdict(SETS[stated.model])
    given = {name: value for name, value in msgspec.structs.asdict(stated).items() if value}
    return VehicleModel(**{**figures, **given})


def a_max_mps2(mission: Mission, entry: RosterEntry) -> float | None:
    """Return the largest acceleration of a UAV's planned motion; None for an `ideal` vehicle, which has no limit."""
    vehicle = vehicle_of(mission, entry)
    return None if vehicle.is_ideal else vehicle.a_max_mps2


def step_change_m(mission: Mission, entry: RosterEntry) -> float | None:
    """Return the largest change of consecutive steps of a UAV, a_max dt^2, in metres; None for an `ideal` vehicle.

    The vehicle flies the uniform quadratic B-spline whose control points are the waypoints. In slot k, from waypoint
    p to p + u after step u', that is a parabola: it begins at p - u' / 2 with velocity u' / dt, ends at p + u / 2 with
    velocity u / dt, and has the constant acceleration (u - u') / dt^2. It stays inside the triangle of the last
    waypoint, p and p + u, so a mission with such vehicles needs `lag_slots = 1`. A vehicle that rests has u' = 0.
    """
    acceleration_mps2 = a_max_mps2(mission, entry)
    return None if acceleration_mps2 is None else acceleration_mps2 * mission.dt_s**2
