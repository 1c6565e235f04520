"""The set-points of a UAV: position, velocity and acceleration on its declared path, as MAVLink has them.

Latitude and longitude by the project's one geodesy, and the height above the autopilot's own home. So neither the
origin of the autopilot's local frame nor the height of the ground matters. ArduPilot gets that height as it is
(MAV_FRAME_GLOBAL_RELATIVE_ALT_INT); PX4 as a height above the sea (MAV_FRAME_GLOBAL_INT), since in the other frame it
takes the difference between home and its own origin with the wrong sign (`mavlink_receiver.cpp`, 1.12 to 1.14).
"""

from __future__ import annotations

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


def set_point(
    mission: Mission, altitude_m: float, step: Step, now_ns: int, home_m: float | None = None
) -> Mapping[str, int | float]:
    """Return the fields of SET_POSITION_TARGET_GLOBAL_INT for now; after the end of the step, those of its end at rest.

    MAVLink's axes are north, east, down. With `home_m`, the height of home above the sea, the set-point's height is
    above the sea too, else above home.
    """
    share = (now_ns - step.start_ns) / mission.slot_ns
    place, change, bend = step.place(share)
    over = share > 1.0
    velocity = 0j if over else change / mission.dt_s
    acceleration = 0j if over or share < 0 else bend / mission.dt_s**2
    lat_deg, lon_deg = to_wgs84.__wrapped__(place.real, place.imag, mission.origin_lat_deg, mission.origin_lon_deg)
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
