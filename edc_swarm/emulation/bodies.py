"""The kinds of body, by the vehicle of a UAV."""

from __future__ import annotations

from edc_swarm.emulation.body import Body, BodyState, Ideal, Point
from edc_swarm.emulation.multirotor import Multirotor
from edc_swarm.errors import MissionError
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.mission.vehicle_budget import vehicle_of


def body_of(mission: Mission, entry: RosterEntry, at_m: Point, state: BodyState | None) -> Body:
    """Return the emulated body of a UAV, in `state` if it has flown before, else at rest at the waypoint `at_m`.

    Raises
    ------
    MissionError
        An autopilot flies the UAV: nothing of it is emulated.
    """
    vehicle = vehicle_of(mission, entry)
    if vehicle.is_autopilot:
        raise MissionError("vehicle.model", vehicle.model, "an emulated one here: autopilots fly in real time")
    if vehicle.is_ideal:
        return Ideal(mission, entry, at_m)
    return Multirotor(mission, entry, at_m, state)
