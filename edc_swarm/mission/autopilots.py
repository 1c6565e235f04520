"""The autopilots of a mission: which UAVs they fly, at which addresses, and what such a mission must keep to."""

from __future__ import annotations

import re

import msgspec

from edc_swarm.errors import MissionError
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.faults import OrderLanding, VehicleFault, parse_fault
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.mission.vehicle_budget import vehicle_of
from edc_swarm.mission.vehicle_model import MAVLINK, VehicleModel

FORMS = "udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or /dev/DEVICE[,BAUD]"
DESCENT_MPS = 0.5
"""Speed at which autopilots land: LAND_SPEED of ArduCopter, 50 cm/s; MPC_LAND_SPEED of PX4 is 0.7 m/s."""
_NET = re.compile(r"(udpin|udpout|udp|tcp):(\[[0-9a-fA-F:]+\]|[A-Za-z0-9._-]+):(\d{1,5})")
_SERIAL = re.compile(r"(/dev/[A-Za-z0-9._/-]+)(?:,(\d{3,7}))?")
_BRACES = re.compile(r"\{(?:(\d{1,5})\+)?(?:(\d{1,5})\*)?i\}")


def autopilot_of(mission: Mission, index: int) -> VehicleModel | None:
    """Return the vehicle of the UAV at a place in the roster if an autopilot flies it, else None."""
    vehicle = vehicle_of(mission, mission.roster[index])
    return vehicle if vehicle.is_autopilot else None


def autopilots(mission: Mission) -> dict[str, str]:
    """Return the address of the autopilot of each UAV that one flies, by its id, in roster order."""
    flown = ((index, entry, autopilot_of(mission, index)) for index, entry in enumerate(mission.roster))
    return {entry.uav: address(vehicle.autopilot, index) for index, entry, vehicle in flown if vehicle is not None}


def address(pattern: str, index: int) -> str:
    """Return the address that a pattern has for the UAV at a place in the roster."""
    return _BRACES.sub(lambda found: str(int(found[1] or 0) + int(found[2] or 1) * index), pattern)


def takeoff_s(mission: Mission) -> float:
    """Return the longest time from the mission's publication to slot 0 that autopilots ask for; 0 without any."""
    flown = (autopilot_of(mission, index) for index in range(len(mission.roster)))
    return max((vehicle.takeoff_s for vehicle in flown if vehicle is not None), default=0.0)


def check_autopilots(mission: Mission) -> None:
    """Raise `MissionError` unless every autopilot has an address of its own, and the mission flies in real time."""
    found: dict[str, str] = {}
    for index, entry in enumerate(mission.roster):
        vehicle = autopilot_of(mission, index)
        if vehicle is None:
            continue
        place = address(vehicle.autopilot, index)
        _check_address(vehicle.autopilot, place)
        if place in found:
            raise MissionError(
                "vehicle.autopilot",
                vehicle.autopilot,
                "another address for each UAV, such as udpin:0.0.0.0:{14550+10*i}",
            )
        found[place] = entry.uav
        _check_mission(mission, vehicle)
    if mission.vehicle.autopilot and not found:
        raise MissionError("vehicle.autopilot", mission.vehicle.autopilot, f"left out, or vehicle = {MAVLINK}")
    for text in mission.fault if found else ():
        fault = parse_fault(text, mission.dt_s)
        if isinstance(fault, VehicleFault) and not isinstance(fault, OrderLanding):
            raise MissionError(
                "fault", text, "one of processes, links, clocks or goals: no fault bends an autopilot's vehicle"
            )


def _check_mission(mission: Mission, vehicle: VehicleModel) -> None:
    if mission.time_scale != 1.0:
        raise MissionError("time_scale", mission.time_scale, "1 with mavlink, since autopilots fly in real time")
    descent_s = vehicle.altitude_m / DESCENT_MPS
    if mission.failsafe == "land" and mission.landing_s < descent_s:
        raise MissionError(
            "landing_s",
            mission.landing_s,
            f"at least {descent_s:g}: {vehicle.altitude_m:g} m of height at {DESCENT_MPS:g} m/s",
        )


def _check_address(pattern: str, place: str) -> None:
    net, serial = _NET.fullmatch(place), _SERIAL.fullmatch(place)
    if not (serial or (net and 0 < int(net[3]) < 65536)):
        raise MissionError("vehicle.autopilot", pattern, f"{FORMS}, with numbers such as {{14550+10*i}} in braces")


def with_return(mission: Mission) -> Mission:
    """Return the mission with the start as the last point of each route whose autopilot is to return."""
    roster = [
        _returning(entry)
        if (vehicle := autopilot_of(mission, index)) is not None and vehicle.at_end == "return"
        else entry
        for index, entry in enumerate(mission.roster)
    ]
    return msgspec.structs.replace(mission, roster=roster)


def _returning(entry: RosterEntry) -> RosterEntry:
    start_m = (entry.start_x_m, entry.start_y_m)
    if entry.points[-1] == start_m:
        return entry
    hover_s = [*entry.hover_s, 0.0] if entry.hover_s else []
    route = [*entry.points, start_m]
    return msgspec.structs.replace(entry, route=route, hover_s=hover_s, target_x_m=start_m[0], target_y_m=start_m[1])
