"""Requests of a ground station that steer a UAV, as orders to the operator.

===========================================  =====================================================================
Request                                      Order
===========================================  =====================================================================
DO_PAUSE_CONTINUE                            pause (param1 = 0), go on (param1 = 1)
DO_SET_MODE, SET_MODE: PX4's hold, mission   pause, go on: what MAVSDK's and QGroundControl's buttons send
MISSION_START                                go on
DO_REPOSITION as COMMAND_INT, or as          a new goal; the height is ignored, since a mission is planar
COMMAND_LONG with degrees
NAV_LAND                                     land where it is
===========================================  =====================================================================
"""

from __future__ import annotations

import math

from edc_swarm.geodesy import from_wgs84
from edc_swarm.ground_station.frames import Command, Request
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.field_types import MOST_M
from edc_swarm.protocol.ground_orders import GroundOrder, Wish

CUSTOM_MODE_ENABLED = 1
"""MAV_MODE_FLAG_CUSTOM_MODE_ENABLED."""
PX4_AUTO, PX4_MISSION, PX4_HOLD = 4, 4, 3
"""PX4's main mode `auto` and two of its sub modes."""
PLAIN: dict[int, Wish] = {Command.MISSION_START: "go on", Command.NAV_LAND: "land"}
"""Commands that say all that there is to say."""
FARTHEST_DEG = 1.0
"""A goal farther than this from the origin is no goal of a mission on a plane."""


def order_of(mission: Mission, uav: str, request: Request) -> GroundOrder | None:
    """Return the order to the operator that a request amounts to; None if it is none of the table."""
    if request.name == "set_mode":
        custom = _number(request, "custom_mode")
        return _by_mode(uav, int(custom) >> 16 & 0xFF, int(custom) >> 24 & 0xFF)
    match _number(request, "command"):
        case Command.DO_SET_MODE if int(_number(request, "param1")) & CUSTOM_MODE_ENABLED:
            return _by_mode(uav, int(_number(request, "param2")), int(_number(request, "param3")))
        case Command.DO_REPOSITION:
            return _reposition(mission, uav, request)
        case Command.DO_PAUSE_CONTINUE:
            wish: Wish | None = "go on" if _number(request, "param1") else "pause"
        case command:
            wish = PLAIN.get(int(command))
    return None if wish is None else GroundOrder(uav=uav, wish=wish)


def _by_mode(uav: str, main: int, sub: int) -> GroundOrder | None:
    if main != PX4_AUTO or sub not in {PX4_HOLD, PX4_MISSION}:
        return None
    return GroundOrder(uav=uav, wish="pause" if sub == PX4_HOLD else "go on")


def _reposition(mission: Mission, uav: str, request: Request) -> GroundOrder | None:
    if request.name == "command_int":
        lat_deg, lon_deg = _number(request, "x") / 1e7, _number(request, "y") / 1e7
    else:
        lat_deg, lon_deg = _number(request, "param5"), _number(request, "param6")
    away_deg = abs(lat_deg - mission.origin_lat_deg), abs(math.remainder(lon_deg - mission.origin_lon_deg, 360.0))
    if not max(away_deg) <= FARTHEST_DEG:
        return None
    x_m, y_m = from_wgs84(lat_deg, lon_deg, mission.origin_lat_deg, mission.origin_lon_deg)
    if max(abs(x_m), abs(y_m)) > MOST_M:
        return None
    return GroundOrder(uav=uav, wish="goal", x_m=round(x_m, 3), y_m=round(y_m, 3))


def _number(request: Request, field: str) -> float:
    """Return a number of a request, 0 where it is missing or not finite."""
    value = request.fields.get(field, 0)
    return float(value) if isinstance(value, int | float) and math.isfinite(value) else 0.0
