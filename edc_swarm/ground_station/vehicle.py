"""Telemetry of one UAV: the MAVLink messages that its fixes amount to.

Everything comes from messages of the UAV itself. A UAV that is not heard sends no heartbeat, so a ground station says
that it has lost the UAV. A mission is planar: `FLIGHT_HEIGHT_M` stands for the height of a UAV that flies.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from edc_swarm.geodesy import to_wgs84
from edc_swarm.ground_station.frames import Frame, MessageId, Value
from edc_swarm.mission.configuration import NS_PER_S, Mission
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.protocol.messages import Fix

FLIGHT_HEIGHT_M = 7.0
"""Height above the start at which a flying UAV is shown: that from which `landing_s` takes a UAV to the ground."""
HEARTBEAT_NS = NS_PER_S
SILENT_AFTER_SLOTS = 2
"""Slots without a fix after which a UAV sends no heartbeat."""

QUADROTOR = 2
AUTOPILOT_GENERIC = 0
ARMED, GUIDED, AUTO = 128, 8, 4
ACTIVE, STANDBY = 4, 3
ON_GROUND, IN_AIR = 1, 2
GPS_FIX_3D = 3
SENSORS = 0x20 | 0x2000000
"""Flags of SYS_STATUS: GPS and battery."""
CAPABILITIES = 4 | 64 | 8192 | 16384
"""Flags of AUTOPILOT_VERSION: integer mission items, integer commands, MAVLink 2, fence."""
UNKNOWN_U16, UNKNOWN_I16, UNKNOWN_I32 = 0xFFFF, 0x7FFF, 0x7FFFFFFF
UNKNOWN_VOLTAGES = [UNKNOWN_U16] * 10


class VehicleView:
    """One UAV as a MAVLink system."""

    def __init__(self, mission: Mission, entry: RosterEntry, system: int) -> None:
        self._mission = mission
        self._entry = entry
        self._system = system
        self._fix: Fix | None = None
        self._heard_ns = 0
        self._heading_deg: float | None = None
        self._landed = False
        self._next_beat_ns = 0

    @property
    def course_fix(self) -> Fix | None:
        """The newest fix."""
        return self._fix

    @property
    def flies(self) -> bool:
        """True if the UAV has been heard and has not landed."""
        return self._fix is not None and not self._landed

    def hear_fix(self, fix: Fix, now_ns: int) -> list[Frame]:
        """Take in a fix; return position, attitude and GPS, or nothing for a fix that is not the newest."""
        if self._fix is not None and fix.slot <= self._fix.slot:
            return []
        self._fix, self._heard_ns = fix, now_ns
        east_mps, north_mps = self._velocity_mps(fix)
        if east_mps or north_mps:
            self._heading_deg = math.degrees(math.atan2(east_mps, north_mps)) % 360
        return [self._position(fix), self._attitude(fix), self._gps(fix)]

    def land(self) -> None:
        """Note that the UAV has landed, and is disarmed."""
        self._landed = True

    def advance(self, now_ns: int) -> list[Frame]:
        """Return heartbeat, state and battery if they are due and the UAV is heard."""
        fix = self._fix
        silent_ns = (SILENT_AFTER_SLOTS + 1) * self._mission.slot_ns
        if fix is None or now_ns < self._next_beat_ns or now_ns - self._heard_ns > silent_ns:
            return []
        self._next_beat_ns = now_ns + HEARTBEAT_NS
        return [self._heartbeat(), self._state(), self._status(fix), self._battery(fix)]

    def asked_for(self, message: int) -> list[Frame]:
        """Return the message with this number; nothing if there is none, or if nothing is known yet."""
        if message == MessageId.AUTOPILOT_VERSION:
            return [self._version()]
        if message == MessageId.HOME_POSITION:
            return [self._home()]
        fix = self._fix
        if fix is None:
            return []
        makers: Mapping[int, Callable[[], Frame]] = {
            MessageId.SYS_STATUS: lambda: self._status(fix),
            MessageId.GPS_RAW_INT: lambda: self._gps(fix),
            MessageId.ATTITUDE: lambda: self._attitude(fix),
            MessageId.GLOBAL_POSITION_INT: lambda: self._position(fix),
            MessageId.BATTERY_STATUS: lambda: self._battery(fix),
            MessageId.EXTENDED_SYS_STATE: self._state,
        }
        return [makers[message]()] if message in makers else []

    # --- messages ----------------------------------------------------------------------------

    def _frame(self, name: str, **fields: Value) -> Frame:
        return Frame(self._system, name, fields)

    def _boot_ms(self, fix: Fix) -> int:
        """Return the mission time of a fix."""
        return round(fix.slot * self._mission.dt_s * 1e3)

    def _height_m(self) -> float:
        return 0.0 if self._landed else FLIGHT_HEIGHT_M

    def _velocity_mps(self, fix: Fix) -> tuple[float, float]:
        """Return the velocity (east, north) of the step that the UAV flies in the slot of the fix."""
        if not fix.executing:
            return 0.0, 0.0
        flown_s = self._mission.dt_s - 2 * self._mission.guard_s
        return (fix.waypoint_x_m - fix.from_x_m) / flown_s, (fix.waypoint_y_m - fix.from_y_m) / flown_s

    def _heartbeat(self) -> Frame:
        mode = GUIDED | AUTO | (0 if self._landed else ARMED)
        status = STANDBY if self._landed else ACTIVE
        return self._frame(
            "heartbeat",
            type=QUADROTOR,
            autopilot=AUTOPILOT_GENERIC,
            base_mode=mode,
            custom_mode=0,
            system_status=status,
            mavlink_version=3,
        )

    def _state(self) -> Frame:
        return self._frame("extended_sys_state", vtol_state=0, landed_state=ON_GROUND if self._landed else IN_AIR)

    def _position(self, fix: Fix) -> Frame:
        east_mps, north_mps = self._velocity_mps(fix)
        height_mm = round(self._height_m() * 1e3)
        return self._frame(
            "global_position_int",
            time_boot_ms=self._boot_ms(fix),
            lat=round(fix.lat_deg * 1e7),
            lon=round(fix.lon_deg * 1e7),
            alt=height_mm,
            relative_alt=height_mm,
            vx=_clipped(100 * north_mps),
            vy=_clipped(100 * east_mps),
            vz=0,
            hdg=UNKNOWN_U16 if self._heading_deg is None else round(100 * self._heading_deg) % 36000,
        )

    def _attitude(self, fix: Fix) -> Frame:
        yaw = math.radians(self._heading_deg or 0.0)
        return self._frame(
            "attitude",
            time_boot_ms=self._boot_ms(fix),
            roll=0.0,
            pitch=0.0,
            yaw=yaw if yaw <= math.pi else yaw - 2 * math.pi,
            rollspeed=0.0,
            pitchspeed=0.0,
            yawspeed=0.0,
        )

    def _gps(self, fix: Fix) -> Frame:
        speed_mps = math.hypot(*self._velocity_mps(fix))
        return self._frame(
            "gps_raw_int",
            time_usec=self._boot_ms(fix) * 1000,
            fix_type=GPS_FIX_3D,
            lat=round(fix.lat_deg * 1e7),
            lon=round(fix.lon_deg * 1e7),
            alt=round(self._height_m() * 1e3),
            eph=UNKNOWN_U16,
            epv=UNKNOWN_U16,
            vel=min(_clipped(100 * speed_mps), UNKNOWN_U16 - 1),
            cog=UNKNOWN_U16 if self._heading_deg is None else round(100 * self._heading_deg) % 36000,
            satellites_visible=255,
            h_acc=min(round(1e3 * fix.r_m), 0xFFFFFFFF),
        )

    def _left_percent(self, fix: Fix) -> int:
        """Return the charge left, in percent of the charge at the start, rounded down."""
        return max(0, min(100, int(100 * fix.energy_j / self._entry.energy_j))) if self._entry.energy_j else -1

    def _status(self, fix: Fix) -> Frame:
        zeros = dict.fromkeys(("load", "drop_rate_comm", "errors_comm"), 0) | {
            f"errors_count{number}": 0 for number in range(1, 5)
        }
        return self._frame(
            "sys_status",
            **zeros,
            onboard_control_sensors_present=SENSORS,
            onboard_control_sensors_enabled=SENSORS,
            onboard_control_sensors_health=SENSORS,
            voltage_battery=UNKNOWN_U16,
            current_battery=-1,
            battery_remaining=self._left_percent(fix),
        )

    def _battery(self, fix: Fix) -> Frame:
        return self._frame(
            "battery_status",
            id=0,
            battery_function=1,
            type=0,
            temperature=UNKNOWN_I16,
            voltages=UNKNOWN_VOLTAGES,
            current_battery=-1,
            current_consumed=-1,
            energy_consumed=min(round((self._entry.energy_j - fix.energy_j) / 100), UNKNOWN_I32),
            battery_remaining=self._left_percent(fix),
        )

    def _home(self) -> Frame:
        lat_deg, lon_deg = to_wgs84(
            self._entry.start_x_m, self._entry.start_y_m, self._mission.origin_lat_deg, self._mission.origin_lon_deg
        )
        unknown = dict.fromkeys(("x", "y", "z", "approach_x", "approach_y", "approach_z"), 0.0)
        return self._frame(
            "home_position",
            **unknown,
            latitude=round(lat_deg * 1e7),
            longitude=round(lon_deg * 1e7),
            altitude=0,
            q=[1.0, 0.0, 0.0, 0.0],
        )

    def _version(self) -> Frame:
        versions = dict.fromkeys(
            ("flight_sw_version", "middleware_sw_version", "os_sw_version", "board_version", "vendor_id", "product_id"),
            0,
        )
        return self._frame(
            "autopilot_version",
            **versions,
            capabilities=CAPABILITIES,
            flight_custom_version=[0] * 8,
            middleware_custom_version=[0] * 8,
            os_custom_version=[0] * 8,
            uid=self._system,
        )


def _clipped(value: float) -> int:
    """Return a value rounded into a signed field of 16 bits."""
    return max(-0x8000, min(0x7FFF, round(value)))
