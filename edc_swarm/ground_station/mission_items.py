"""Mission items of one UAV: its route, and the zones of the airspace as fences."""

from __future__ import annotations

import math

from edc_swarm.geodesy import to_wgs84
from edc_swarm.ground_station.frames import Command, Value
from edc_swarm.ground_station.vehicle import FLIGHT_HEIGHT_M
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.field_types import Point
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.mission.routes import Course
from edc_swarm.mission.zone import Zone

Item = dict[str, Value]
"""Fields of MISSION_ITEM_INT, but those of its protocol."""

RELATIVE_ALT = 6
"""MAV_FRAME_GLOBAL_RELATIVE_ALT_INT."""
GLOBAL = 5
"""MAV_FRAME_GLOBAL_INT."""


def route_items(mission: Mission, entry: RosterEntry, course: Course) -> list[Item]:
    """Return a way point for each point of the UAV's route; of a later goal, for each point that is left."""
    points = course.route if course.goal else entry.points
    hovers_s = entry.hover_s if course.goal == 0 else []
    return [
        _item(mission, point, Command.NAV_WAYPOINT, RELATIVE_ALT)
        | {
            "param1": hovers_s[index] if index < len(hovers_s) else 0.0,
            "param2": entry.accept_m,
            "param4": math.nan,
            "z": FLIGHT_HEIGHT_M,
        }
        for index, point in enumerate(points)
    ]


def fence_items(mission: Mission) -> list[Item]:
    """Return the corners of all polygons and the circles among the zones, in order."""
    return [item for zone in mission.zone for item in _zone_items(mission, zone)]


def _zone_items(mission: Mission, zone: Zone) -> list[Item]:
    inside = zone.kind == "inclusion"
    if not zone.polygon:
        circle = Command.FENCE_INCLUSION_CIRCLE if inside else Command.FENCE_EXCLUSION_CIRCLE
        return [_item(mission, (zone.centre[0], zone.centre[1]), circle, GLOBAL) | {"param1": zone.radius_m}]
    corner = Command.FENCE_INCLUSION_CORNER if inside else Command.FENCE_EXCLUSION_CORNER
    corners = float(len(zone.polygon))
    return [_item(mission, point, corner, GLOBAL) | {"param1": corners} for point in zone.polygon]


def _item(mission: Mission, point: Point, command: Command, frame: int) -> Item:
    lat_deg, lon_deg = to_wgs84(*point, mission.origin_lat_deg, mission.origin_lon_deg)
    return {
        "frame": frame,
        "command": int(command),
        "autocontinue": 1,
        "param1": 0.0,
        "param2": 0.0,
        "param3": 0.0,
        "param4": 0.0,
        "x": round(lat_deg * 1e7),
        "y": round(lon_deg * 1e7),
        "z": 0.0,
    }
