"""Judge of set-points: those that an autopilot received, against the path that the fixes of its UAV declare."""

from __future__ import annotations

from collections.abc import Iterable

from edc_swarm.geodesy import from_wgs84
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.declared_path import declared
from edc_swarm.protocol.messages import Fix

Received = tuple[int, int, int]
"""`time_boot_ms`, `lat_int`, `lon_int`: the time is that of the mission's clock."""
WRAP_MS = 1 << 32


def set_points_off_m(
    mission: Mission, epoch_ns: int, uav: str, fixes: Iterable[Fix], received: Iterable[Received]
) -> float:
    """Return how far set-points are from the path that the fixes of a UAV declare, at most.

    Of each slot the middle half is judged: a step reaches the link shortly after its slot has begun.
    """
    entry = next(entry for entry in mission.roster if entry.uav == uav)
    ends_m = {fix.slot: complex(fix.waypoint_x_m, fix.waypoint_y_m) for fix in fixes if fix.uav == uav}
    ends_m |= dict.fromkeys((-2, -1), complex(entry.start_x_m, entry.start_y_m))
    origin_deg = mission.origin_lat_deg, mission.origin_lon_deg
    off_m: list[float] = []
    for boot_ms, lat, lon in received:
        since_ms = (boot_ms - epoch_ns // 1_000_000 + WRAP_MS // 2) % WRAP_MS - WRAP_MS // 2
        slot, share = divmod(since_ms / (1e3 * mission.dt_s), 1.0)
        known = {int(slot) + step for step in (-2, -1, 0)} <= ends_m.keys()
        if slot >= 0 and 0.25 < share < 0.75 and known:
            path_m = declared(ends_m[int(slot) - 2], ends_m[int(slot) - 1], ends_m[int(slot)], share)
            off_m.append(abs(complex(*from_wgs84(lat / 1e7, lon / 1e7, *origin_deg)) - path_m))
    assert len(off_m) > 10, "too few set-points to judge"
    return max(off_m)
