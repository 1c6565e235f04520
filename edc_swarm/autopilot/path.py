"""The set-points of a UAV: position, velocity and acceleration on its declared path, as MAVLink has them.

One frame for all: latitude and longitude by the project's one geodesy, and the height above the autopilot's own home
(MAV_FRAME_GLOBAL_RELATIVE_ALT_INT). So neither the origin of the autopilot's local frame nor the height of the ground
matters.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from edc_swarm.geodesy import to_wgs84
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.declared_path import declared

RELATIVE_ALT = 6
"""MAV_FRAME_GLOBAL_RELATIVE_ALT_INT."""
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


def set_point(mission: Mission, altitude_m: float, step: Step, now_ns: int) -> Mapping[str, int | float]:
    """Return the fields of SET_POSITION_TARGET_GLOBAL_INT for now; after the end of the step, those of its end at rest.

    MAVLink's axes are north, east, down.
    """
    share = (now_ns - step.start_ns) / mission.slot_ns
    place, change, bend = step.place(share)
    over = share > 1.0
    velocity = 0j if over else change / mission.dt_s
    acceleration = 0j if over or share < 0 else bend / mission.dt_s**2
    lat_deg, lon_deg = to_wgs84.__wrapped__(place.real, place.imag, mission.origin_lat_deg, mission.origin_lon_deg)
    return {
        "time_boot_ms": (now_ns // 1_000_000) & 0xFFFFFFFF,
        "coordinate_frame": RELATIVE_ALT,
        "type_mask": IGNORE_YAW,
        "lat_int": round(lat_deg * 1e7),
        "lon_int": round(lon_deg * 1e7),
        "alt": altitude_m,
        "vx": velocity.imag,
        "vy": velocity.real,
        "vz": 0.0,
        "afx": acceleration.imag,
        "afy": acceleration.real,
        "afz": 0.0,
        "yaw": 0.0,
        "yaw_rate": 0.0,
    }
