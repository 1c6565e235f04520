"""The set-points of a UAV: position, velocity and acceleration on its declared path, as MAVLink has them.

Latitude and longitude by the project's one geodesy, and the height above the autopilot's own home. So neither the
origin of the autopilot's local frame nor the height of the ground matters. ArduPilot gets that height as it is
(MAV_FRAME_GLOBAL_RELATIVE_ALT_INT); PX4 as a height above the sea (MAV_FRAME_GLOBAL_INT), since in the other frame it
takes the difference between home and its own origin with the wrong sign (`mavlink_receiver.cpp`, 1.12 to 1.14).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from edc_swarm.geodesy import to_wgs84
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.declared_path import declared

ABOVE_SEA, ABOVE_HOME = 5, 6
"""MAV_FRAME_GLOBAL_INT, MAV_FRAME_GLOBAL_RELATIVE_ALT_INT."""
IGNORE_YAW = 1024 | 2048
"""POSITION_TARGET_TYPEMASK of a set-point with position, velocity and acceleration, but without yaw and its rate."""
Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Step:
    """A step between two waypoints in a slot that begins at `start_ns`, after one from `before_m`."""

    start_ns: int
    before_m: Point
    here_m: Point
    there_m: Point

    def place(self, share: float) -> tuple[complex, complex, complex]:
        """Return place, change a slot, and change of that a slot, after a share of the slot; x + i y, in metres."""
        before, here, there = complex(*self.before_m), complex(*self.here_m), complex(*self.there_m)
        share = min(1.0, max(0.0, share))
        change = (1 - share) * (here - before) + share * (there - here)
        return declared(before, here, there, share), change, there - 2 * here + before


def _place_deg(mission: Mission, step: Step, share: float) -> tuple[float, float]:
    """Return latitude and longitude of the place after a share of the slot: the path of the three waypoints' own.

    They are converted once in a slot, not twenty times in a second. On steps of 10 m this is 1e-5 m from the exact
    conversion of each place.
    """
    origin_deg = mission.origin_lat_deg, mission.origin_lon_deg
    points_deg = [to_wgs84(*point_m, *origin_deg) for point_m in (step.before_m, step.here_m, step.there_m)]
    near_deg = points_deg[1][1]
    before, here, there = (
        complex(lat_deg, near_deg + math.remainder(lon_deg - near_deg, 360.0)) for lat_deg, lon_deg in points_deg
    )
    place_deg = declared(before, here, there, min(1.0, max(0.0, share)))
    return place_deg.real, math.remainder(place_deg.imag, 360.0)


def set_point(
    mission: Mission, altitude_m: float, step: Step, now_ns: int, home_m: float | None = None
) -> Mapping[str, int | float]:
    """Return the fields of SET_POSITION_TARGET_GLOBAL_INT for now; after the end of the step, those of its end at rest.

    MAVLink's axes are north, east, down. With `home_m`, the height of home above the sea, the set-point's height is
    above the sea too, else above home.
    """
    share = (now_ns - step.start_ns) / mission.slot_ns
    _, change, bend = step.place(share)
    over = share > 1.0
    velocity = 0j if over else change / mission.dt_s
    acceleration = 0j if over or share < 0 else bend / mission.dt_s**2
    lat_deg, lon_deg = _place_deg(mission, step, share)
    return {
        "time_boot_ms": (now_ns // 1_000_000) & 0xFFFFFFFF,
        "coordinate_frame": ABOVE_HOME if home_m is None else ABOVE_SEA,
        "type_mask": IGNORE_YAW,
        "lat_int": round(lat_deg * 1e7),
        "lon_int": round(lon_deg * 1e7),
        "alt": altitude_m + (home_m or 0.0),
        "vx": velocity.imag,
        "vy": velocity.real,
        "vz": 0.0,
        "afx": acceleration.imag,
        "afy": acceleration.real,
        "afz": 0.0,
        "yaw": 0.0,
        "yaw_rate": 0.0,
    }
