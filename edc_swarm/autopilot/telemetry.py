"""Telemetry of one autopilot: the newest of what its messages say, and the track that it reports.

One thread feeds it; others read its attributes, each of which is replaced as a whole.
"""

from __future__ import annotations

import math
import struct
from bisect import bisect_left
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from edc_swarm.geodesy import from_wgs84
from edc_swarm.mission.configuration import NS_PER_S, Mission

ARDUPILOT, PX4 = 3, 12
"""MAV_AUTOPILOT."""
FIRMWARE = {ARDUPILOT: "ArduPilot", PX4: "PX4"}
MULTICOPTERS = frozenset({2, 3, 4, 13, 14, 15, 29, 35, 43})
"""MAV_TYPE of what flies like a multicopter: quad, coaxial, helicopter, hexa, octo, tri, dodeca, deca, generic."""
NO_AUTOPILOTS = frozenset({8})
"""MAV_AUTOPILOT_INVALID: ground stations, cameras, gimbals."""
COPTER_GUIDED, PX4_OFFBOARD = 4, 6
ARMED_FLAG = 128
PREARM_CHECK = 0x10000000
"""MAV_SYS_STATUS_PREARM_CHECK."""
TRACK_S, TRACK_SLOTS = 4.0, 3
"""Least time and least number of slots for which reported positions are kept."""
MAX_TRACK = 10_000
"""Most reported positions that are kept."""
TEXTS_KEPT = 5
JUMPS_KEPT, MOST_JUMPS = 64, 8
"""Of so many messages, how many may have a number that is not after the one before: links lose, and seldom reorder."""
MAX_PARAMETERS = 100
"""Most parameters that are kept."""
INT32 = 6
"""MAV_PARAM_TYPE_INT32."""
COPTER_MODES = {
    0: "STABILIZE", 1: "ACRO", 2: "ALT_HOLD", 3: "AUTO", 4: "GUIDED", 5: "LOITER", 6: "RTL", 7: "CIRCLE", 9: "LAND",
    11: "DRIFT", 13: "SPORT", 15: "AUTOTUNE", 16: "POSHOLD", 17: "BRAKE", 18: "THROW", 20: "GUIDED_NOGPS",
    21: "SMART_RTL", 27: "AUTO_RTL",
}  # fmt: skip
"""Modes of ArduCopter."""
PX4_MODES = {
    (1, 0): "MANUAL", (2, 0): "ALTCTL", (3, 0): "POSCTL", (4, 2): "TAKEOFF", (4, 3): "HOLD", (4, 4): "MISSION",
    (4, 5): "RTL", (4, 6): "LAND", (5, 0): "ACRO", (6, 0): "OFFBOARD", (7, 0): "STABILIZED",
}  # fmt: skip
"""Main and sub modes of PX4."""


@dataclass(frozen=True, slots=True)
class Sighting:
    """A reported position in the mission's frame, `height_m` above the autopilot's home, at `at_ns`."""

    at_ns: int
    x_m: float
    y_m: float
    height_m: float


def track_s(mission: Mission) -> float:
    """Return for how long reported positions are kept."""
    return max(TRACK_S, TRACK_SLOTS * mission.dt_s)


class Telemetry:
    """What one autopilot says.

    Attributes
    ----------
    system
        Its MAVLink system and component; None before its first heartbeat.
    version
        Of MAVLink, in its heartbeats: 1 or 2.
    others
        Other autopilots that speak at the same address: systems, or a second sender with this one's number.
    parameters
        Values of the parameters that it has told, by name.
    battery_share
        Charge left, as a share; None if unknown.
    """

    def __init__(self, mission: Mission) -> None:
        self._track_ns = round(track_s(mission) * NS_PER_S)
        self._origin_deg = (mission.origin_lat_deg, mission.origin_lon_deg)
        self.system: tuple[int, int] | None = None
        self.version = 2
        self.others: set[int] = set()
        self.parameters: dict[str, float] = {}
        self.firmware = 0
        self.kind = 0
        self.custom_mode = 0
        self.armed = False
        self.was_armed = False
        self.beat_ns = 0
        self.gps_fix: int | None = None
        self.battery_share: float | None = None
        self.prearm_ok: bool | None = None
        self.home: tuple[float, float, float] | None = None
        self.track: deque[Sighting] = deque(maxlen=MAX_TRACK)
        self.texts: deque[str] = deque(maxlen=TEXTS_KEPT)
        self.acks: dict[int, int] = {}
        self._number: int | None = None
        self._jumps: deque[bool] = deque(maxlen=JUMPS_KEPT)

    @property
    def newest(self) -> Sighting | None:
        """The newest reported position."""
        return self.track[-1] if self.track else None

    @property
    def is_px4(self) -> bool:
        """True for PX4."""
        return self.firmware == PX4

    @property
    def home_text(self) -> str:
        """The home in words."""
        home = self.home
        return "unknown" if home is None else f"{home[0]:.7f} {home[1]:.7f}, {home[2]:.1f} m above the sea"

    @property
    def is_guided(self) -> bool:
        """True in the mode in which it follows set-points: GUIDED of ArduCopter, OFFBOARD of PX4."""
        if self.firmware == PX4:
            return self.custom_mode >> 16 & 0xFF == PX4_OFFBOARD
        return self.custom_mode == COPTER_GUIDED

    @property
    def mode(self) -> str:
        """Name of the mode."""
        if self.firmware == PX4:
            main, sub = self.custom_mode >> 16 & 0xFF, self.custom_mode >> 24 & 0xFF
            return PX4_MODES.get((main, sub), PX4_MODES.get((main, 0), f"mode {main}.{sub}"))
        return COPTER_MODES.get(self.custom_mode, f"mode {self.custom_mode}")

    @property
    def name(self) -> str:
        """Firmware and system in words."""
        system = f"system {self.system[0]}" if self.system is not None else "nobody"
        return f"{FIRMWARE.get(self.firmware, f'autopilot type {self.firmware}')}, {system}"

    def hear(
        self,
        name: str,
        fields: Mapping[str, Any],
        sender: tuple[int, int],
        now_ns: int,
        *,
        number: int | None = None,
        version: int = 2,
    ) -> None:
        """Take in a message; those of other systems and components are noted and left out.

        `number` is the sender's count of its messages (0 to 255), None if unknown; `version` that of MAVLink.
        """
        if name == "HEARTBEAT" and fields["autopilot"] not in NO_AUTOPILOTS:
            self._hear_heartbeat(fields, sender, now_ns)
        if self.system is None or sender != self.system:
            return
        self.version = version
        if number is not None:
            self._count(number)
        match name:
            case "PARAM_VALUE":
                self._hear_parameter(fields)
            case "GLOBAL_POSITION_INT":
                self._hear_position(fields, now_ns)
            case "GPS_RAW_INT":
                self.gps_fix = int(fields["fix_type"])
            case "SYS_STATUS":
                self._hear_status(fields)
            case "BATTERY_STATUS" if fields["id"] == 0 and fields["battery_remaining"] >= 0:
                self.battery_share = fields["battery_remaining"] / 100
            case "HOME_POSITION":
                self.home = fields["latitude"] / 1e7, fields["longitude"] / 1e7, fields["altitude"] / 1e3
            case "STATUSTEXT":
                self.texts.append(str(fields["text"]).strip("\0 "))
            case "COMMAND_ACK":
                self.acks[int(fields["command"])] = int(fields["result"])

    def _count(self, number: int) -> None:
        """Note a second sender with the same system number: two counts of messages take turns."""
        if self._number is not None:
            self._jumps.append((number - self._number - 1) % 256 >= 128)
            if sum(self._jumps) >= MOST_JUMPS and self.system is not None:
                self.others.add(self.system[0])
        self._number = number

    def _hear_parameter(self, fields: Mapping[str, Any]) -> None:
        """Keep a parameter; PX4 puts the bytes of an integer where ArduPilot puts its value."""
        value = float(fields["param_value"])
        if self.firmware == PX4 and fields["param_type"] == INT32:
            (value,) = struct.unpack("<i", struct.pack("<f", value))
        if len(self.parameters) < MAX_PARAMETERS and math.isfinite(value):
            self.parameters[str(fields["param_id"]).strip("\0 ")] = value

    def _hear_heartbeat(self, fields: Mapping[str, Any], sender: tuple[int, int], now_ns: int) -> None:
        if self.system is None:
            self.system = sender
        if sender != self.system:
            self.others.add(sender[0])
            return
        self.firmware, self.kind = int(fields["autopilot"]), int(fields["type"])
        self.custom_mode, self.beat_ns = int(fields["custom_mode"]), now_ns
        self.armed = bool(int(fields["base_mode"]) & ARMED_FLAG)
        self.was_armed = self.was_armed or self.armed

    def _hear_position(self, fields: Mapping[str, Any], now_ns: int) -> None:
        lat_deg, lon_deg = fields["lat"] / 1e7, fields["lon"] / 1e7
        if not (abs(lat_deg) <= 90 and abs(lon_deg) <= 180) or (lat_deg == 0 and lon_deg == 0):
            return
        x_m, y_m = from_wgs84(lat_deg, lon_deg, *self._origin_deg)
        self.track.append(Sighting(now_ns, x_m, y_m, fields["relative_alt"] / 1e3))
        while now_ns - self.track[0].at_ns > self._track_ns:
            self.track.popleft()

    def _hear_status(self, fields: Mapping[str, Any]) -> None:
        if fields["battery_remaining"] >= 0:
            self.battery_share = fields["battery_remaining"] / 100
        if (
            int(fields["onboard_control_sensors_present"])
            & int(fields["onboard_control_sensors_enabled"])
            & PREARM_CHECK
        ):
            self.prearm_ok = bool(int(fields["onboard_control_sensors_health"]) & PREARM_CHECK)

    def at(self, when_ns: int) -> tuple[float, float] | None:
        """Return the reported position at a time, between two reports at most half a second apart; None if unknown."""
        track = list(self.track)
        place = bisect_left(track, when_ns, key=lambda sighting: sighting.at_ns)
        if place == len(track) or (place == 0 and track[0].at_ns > when_ns):
            return None
        before, after = track[max(0, place - 1)], track[place]
        if after.at_ns - before.at_ns > NS_PER_S // 2:
            return None
        share = (when_ns - before.at_ns) / max(1, after.at_ns - before.at_ns)
        return before.x_m + share * (after.x_m - before.x_m), before.y_m + share * (after.y_m - before.y_m)

    def apart_m(self, x_m: float, y_m: float) -> float:
        """Return the distance of the newest position from a point; infinite before the first one."""
        newest = self.newest
        return math.inf if newest is None else math.hypot(newest.x_m - x_m, newest.y_m - y_m)
