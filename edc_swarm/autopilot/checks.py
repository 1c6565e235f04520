"""Checks of an autopilot: why it may not be armed, and why a UAV in flight does not follow any more."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from edc_swarm.autopilot.path import Point
from edc_swarm.autopilot.telemetry import FIRMWARE, MULTICOPTERS, PX4, Telemetry
from edc_swarm.mission.configuration import NS_PER_S
from edc_swarm.mission.roster_entry import RosterEntry

SILENT_S = 1.5
"""Time without a position after which an autopilot counts as silent. It is asked for 20 in a second."""
HEARTBEAT_LOST_S = 3.5
"""Time without a heartbeat after which an autopilot counts as silent. It sends one in a second."""
LEAST_BATTERY = 0.3
"""Least share of the charge with which an autopilot is armed."""
LEAST_GPS_FIX = 3
"""GPS_FIX_TYPE_3D_FIX."""
OVER_START_M = 2.0
"""Least distance from its start that an autopilot may report before take-off; more with a larger disc."""
MAX_TEXT = 200


def objections(seen: Telemetry, entry: RosterEntry, now_ns: int) -> Iterator[str]:
    """Yield why the vehicle of a UAV may not be armed."""
    if seen.system is None:
        yield "no heartbeat of an autopilot"
        return
    if others := seen.others - {seen.system[0]}:
        yield f"more than one autopilot speaks there: systems {sorted({*others, seen.system[0]})}"
    elif seen.others:
        yield f"two autopilots speak there with system number {seen.system[0]}, or its messages come twice"
    if seen.version == 1:
        yield "it speaks MAVLink 1: set SERIALn_PROTOCOL (ArduPilot) or MAV_PROTO_VER (PX4) to 2"
    if seen.firmware not in FIRMWARE:
        yield f"{seen.name} is neither ArduPilot nor PX4"
    elif seen.kind not in MULTICOPTERS:
        yield f"vehicle type {seen.kind} is no multicopter"
    if seen.armed:
        yield "it is armed already"
    yield from _of_place(seen, entry, now_ns)
    if seen.home is None:
        yield "it has no home position"
    if seen.battery_share is None:
        yield "it says nothing of its battery"
    elif seen.battery_share < LEAST_BATTERY:
        yield f"its battery has {100 * seen.battery_share:.0f} %, less than {100 * LEAST_BATTERY:.0f} %"
    if seen.prearm_ok is False:
        yield "it fails its own checks before arming" + texts(seen)


def _of_place(seen: Telemetry, entry: RosterEntry, now_ns: int) -> Iterator[str]:
    newest = seen.newest
    if seen.gps_fix is None:
        yield "it says nothing of its GPS"
    elif seen.gps_fix < LEAST_GPS_FIX:
        yield f"its GPS has no 3D fix (type {seen.gps_fix})"
    if newest is None or now_ns - newest.at_ns > SILENT_S * NS_PER_S:
        yield "it reports no position"
        return
    apart_m, most_m = seen.apart_m(entry.start_x_m, entry.start_y_m), max(OVER_START_M, 0.5 * entry.r_m)
    if apart_m > most_m:
        here = f"start_x_m = {newest.x_m:.2f}, start_y_m = {newest.y_m:.2f}"
        yield f"it is {apart_m:.1f} m from its start (at most {most_m:g} m), at {here}"


def failings(seen: Telemetry, entry: RosterEntry, path_at: Callable[[int], Point | None], now_ns: int) -> Iterator[str]:
    """Yield why the vehicle of a UAV in flight does not follow its commands; `path_at` is its declared path."""
    newest = seen.newest
    if newest is None or now_ns - newest.at_ns > SILENT_S * NS_PER_S:
        yield f"it has reported no position for {SILENT_S:g} s"
        return
    if now_ns - seen.beat_ns > HEARTBEAT_LOST_S * NS_PER_S:
        yield f"it has sent no heartbeat for {HEARTBEAT_LOST_S:g} s"
    if not seen.is_guided:
        yield f"it has left {'OFFBOARD' if seen.firmware == PX4 else 'GUIDED'} for {seen.mode}" + texts(seen)
    if not seen.armed:
        yield "it has disarmed in flight"
    if seen.gps_fix is not None and seen.gps_fix < LEAST_GPS_FIX:
        yield f"its GPS has lost its fix (type {seen.gps_fix})"
    place_m = path_at(newest.at_ns)
    if place_m is not None and (off_m := seen.apart_m(*place_m)) > entry.r_m:
        yield f"it is {off_m:.1f} m from its declared path, outside its disc of {entry.r_m:g} m"


def texts(seen: Telemetry) -> str:
    """Return what an autopilot has said lately, to follow other words."""
    return "".join(f": {text}" for text in list(dict.fromkeys(seen.texts))[-2:])[:MAX_TEXT]
