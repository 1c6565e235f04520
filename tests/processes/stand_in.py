"""A stand-in for ArduCopter, for tests: `python stand_in.py '[{"port": 14550, "lat": .., "lon": ..}, ..]'`.

Each entry is one autopilot, which sends MAVLink to a UDP port as ArduPilot's simulator does. It is as strict as
ArduCopter where a bridge can go wrong: it follows set-points only in GUIDED, armed and after a take-off, only with
position, velocity and acceleration in the frame of latitude, longitude and height above home, only if they are
addressed to it; without one for GUID_TIMEOUT it stops; it lands if FS_GCS_ENABLE is 5 and the heartbeats of its ground
station end. Its vehicle is a point mass with limited acceleration and a lag. What it did is printed as JSON at its end
(SIGTERM). `wrong` makes it fail:

    silent      says nothing any more, `after` seconds from its first set-point
    refuses     does not arm
    leaves      changes to LOITER, as if a pilot took over
    no-gps      loses its GPS fix
    garbled     sends bytes that are no MAVLink
    plane       is a plane
    stranger    is an autopilot of another make
    twin        sends heartbeats of a second system too
    double      is two autopilots with one system number
    mavlink1    speaks MAVLink 1
    dialect     speaks a dialect that nobody knows
    mute        answers no request for a parameter
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import select
import signal
import socket
import sys
import time
from dataclasses import dataclass, field
from typing import Any

os.environ["MAVLINK20"] = "1"
from pymavlink.dialects.v20 import ardupilotmega as mavlink

EARTH_M = 6_371_000.0
STEP_S = 0.02
REPORT_S = 0.05
PARAMETERS = {"GUID_TIMEOUT": 3.0, "FS_GCS_ENABLE": 5.0, "FS_GCS_TIMEOUT": 5.0, "SYSID_MYGCS": 255.0}
"""ArduCopter's, with its defaults but for FS_GCS_ENABLE."""
MOST_POINTS = 20_000
GAIN_P, GAIN_V, LAG_S, MOST_MPS2, CLIMB_MPS, DESCENT_MPS = 1.0, 2.0, 0.15, 5.6, 2.5, 1.5
GUIDED, LOITER, LAND, STABILIZE = 4, 5, 9, 0
MASK, FRAME = 3072, 6


@dataclass
class Orders:
    """What one stand-in is and does."""

    port: int
    lat: float
    lon: float
    system: int = 1
    altitude: float = 12.0
    wrong: str = ""
    after: float = 3.0
    parameters: dict[str, float] = field(default_factory=dict)


@dataclass
class Vehicle:
    """A point mass: east, north and height in metres about its home."""

    timeout_s: float = 3.0
    x: complex = 0j
    v: complex = 0j
    a: complex = 0j
    height: float = 0.0
    wanted_height: float = 0.0
    target: tuple[complex, complex, complex] | None = None
    target_s: float = 0.0

    def move(self, now_s: float) -> None:
        """Fly one step: towards the target, which moves on with its velocity, or to a stop."""
        wanted = GAIN_V * -self.v
        if self.target is not None:
            place, speed, bend = self.target
            age_s = now_s - self.target_s
            if age_s > self.timeout_s:
                self.target = (place + speed * self.timeout_s, 0j, 0j)
                place, speed, bend, age_s = *self.target, 0.0
            place += speed * age_s + 0.5 * bend * age_s * age_s
            speed += bend * age_s
            wanted = bend + GAIN_V * (speed - self.v + GAIN_P * (place - self.x))
        if abs(wanted) > MOST_MPS2:
            wanted *= MOST_MPS2 / abs(wanted)
        self.a += (wanted - self.a) * STEP_S / LAG_S
        self.v += self.a * STEP_S
        self.x += self.v * STEP_S
        gap = self.wanted_height - self.height
        self.height += max(-DESCENT_MPS * STEP_S, min(CLIMB_MPS * STEP_S, gap))


@dataclass
class StandIn:
    """One autopilot."""

    orders: Orders
    vehicle: Vehicle = field(default_factory=Vehicle)
    mode: int = STABILIZE
    armed: bool = False
    flies: bool = False
    first_point_s: float = math.inf
    next_beat_s: float = 0.0
    next_report_s: float = 0.0
    ground_s: float = math.inf
    log: dict[str, Any] = field(
        default_factory=lambda: {"points": 0, "rejected": {}, "gaps_s": [], "events": [], "places": []}
    )

    def __post_init__(self) -> None:
        """Open the socket and the encoder."""
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.setblocking(False)
        self.mav = mavlink.MAVLink(None, self.orders.system, 1)
        self.parser = mavlink.MAVLink(None)
        self.parser.robust_parsing = True
        self.last_point_s = 0.0
        self.parameters = PARAMETERS | self.orders.parameters
        self.vehicle.timeout_s = self.parameters["GUID_TIMEOUT"]
        self.second = mavlink.MAVLink(None, self.orders.system, 1)
        self.second.seq = 100

    # --- what it hears ---

    def read(self, now_s: float) -> None:
        """Take in what has come."""
        while True:
            try:
                datagram = self.socket.recv(65536)
            except (BlockingIOError, ConnectionRefusedError):
                return
            for message in self.parser.parse_buffer(datagram) or []:
                self.take(message, now_s)

    def take(self, message: Any, now_s: float) -> None:
        """Take in one message; what is not addressed to this system is ignored."""
        name = message.get_type()
        if getattr(message, "target_system", self.orders.system) != self.orders.system:
            self.reject("another system")
        elif name == "HEARTBEAT" and message.get_srcSystem() == self.parameters["SYSID_MYGCS"]:
            self.ground_s = now_s
        elif name == "PARAM_REQUEST_READ":
            self.tell(message.param_id)
        elif name == "COMMAND_LONG":
            self.obey(message, now_s)
        elif name == "SET_POSITION_TARGET_GLOBAL_INT":
            self.point(message, now_s)
        elif name == "SET_POSITION_TARGET_LOCAL_NED":
            self.reject("local frame")

    def obey(self, message: Any, now_s: float) -> None:
        """Carry out a command, and answer it."""
        done = True
        match message.command:
            case 176:
                done = message.param1 == 1 and message.param2 in {GUIDED, LOITER, LAND}
                self.change_mode(int(message.param2) if done else self.mode, now_s)
            case 400:
                done = self.orders.wrong != "refuses" and self.mode == GUIDED and message.param1 == 1
                if message.param1 == 0:
                    done, self.armed = not self.flies, self.armed and self.flies
                elif not done:
                    self.say("PreArm: Compass not calibrated")
                elif not self.armed:
                    self.armed = True
                    self.note("armed", now_s)
            case 22:
                done = self.armed and self.mode == GUIDED and not self.flies
                if done:
                    self.flies, self.vehicle.wanted_height = True, message.param7
                    self.note(f"take-off to {message.param7:g}", now_s)
            case 21:
                done = self.armed
                self.change_mode(LAND, now_s)
            case 511 | 512:
                pass
            case _:
                done = False
        self.send(mavlink.MAVLink_command_ack_message(message.command, 0 if done else 4))

    def tell(self, name: str) -> None:
        """Tell a parameter; as ArduCopter does, say nothing of one that it lacks."""
        if name in self.parameters and self.orders.wrong != "mute":
            self.send(mavlink.MAVLink_param_value_message(name.encode(), self.parameters[name], 9, 1, 0))

    def change_mode(self, mode: int, now_s: float) -> None:
        """Enter a mode; in LAND the vehicle stops and comes down."""
        if mode != self.mode:
            self.mode = mode
            self.vehicle.target = None
            self.note(f"mode {mode}", now_s)
        if mode == LAND:
            self.vehicle.wanted_height = 0.0

    def point(self, message: Any, now_s: float) -> None:
        """Follow a set-point if it is one that ArduCopter follows so."""
        whole = message.type_mask == MASK and message.coordinate_frame == FRAME
        climbed = self.vehicle.height > 0.8 * self.vehicle.wanted_height > 0
        if not whole:
            self.reject(f"mask {message.type_mask} frame {message.coordinate_frame}")
        elif not (self.armed and self.flies and climbed and self.mode == GUIDED):
            self.reject("not flying in GUIDED")
        elif abs(message.alt - self.vehicle.wanted_height) > 0.5:
            self.reject("another height")
        else:
            north = math.radians(message.lat_int / 1e7 - self.orders.lat) * EARTH_M
            east = (
                math.radians(message.lon_int / 1e7 - self.orders.lon)
                * EARTH_M
                * math.cos(math.radians(self.orders.lat))
            )
            self.vehicle.target = (
                complex(east, north), complex(message.vy, message.vx), complex(message.afy, message.afx),
            )  # fmt: skip
            self.vehicle.target_s = now_s
            self.first_point_s = min(self.first_point_s, now_s)
            if self.log["points"]:
                self.log["gaps_s"].append(round(now_s - self.last_point_s, 4))
            self.log["points"] += 1
            if len(self.log["places"]) < MOST_POINTS:
                self.log["places"].append([message.time_boot_ms, message.lat_int, message.lon_int])
            self.last_point_s = now_s

    def reject(self, why: str) -> None:
        """Count what is not obeyed."""
        self.log["rejected"][why] = self.log["rejected"].get(why, 0) + 1

    def note(self, what: str, now_s: float) -> None:
        """Keep what happened."""
        self.log["events"].append([round(now_s, 3), what])

    # --- what it does ---

    def advance(self, now_s: float) -> None:
        """Fly, fail if it is time to, and report."""
        if now_s - self.first_point_s > self.orders.after and self.orders.wrong == "leaves" and self.mode == GUIDED:
            self.say("Mode changed by pilot")
            self.change_mode(LOITER, now_s)
        silent = now_s - self.ground_s > self.parameters["FS_GCS_TIMEOUT"]
        if self.armed and silent and self.parameters["FS_GCS_ENABLE"] == 5 and self.mode == GUIDED:
            self.note("ground station failsafe", now_s)
            self.change_mode(LAND, now_s)
        if self.armed:
            self.vehicle.move(now_s)
        if self.armed and self.mode == LAND and self.vehicle.height < 0.05:
            self.armed = self.flies = False
            self.note("disarmed on the ground", now_s)
            self.log["landed_at_m"] = [self.vehicle.x.real, self.vehicle.x.imag]
        if self.orders.wrong == "silent" and now_s - self.first_point_s > self.orders.after:
            return
        if now_s >= self.next_beat_s:
            self.next_beat_s = now_s + 1.0
            self.beat()
        if now_s >= self.next_report_s:
            self.next_report_s = max(self.next_report_s + REPORT_S, now_s)
            self.report(now_s)

    def beat(self) -> None:
        """Send heartbeat, battery, GPS and home."""
        if self.orders.wrong == "garbled":
            self.socket.sendto(bytes(range(7, 250)), ("127.0.0.1", self.orders.port))
            return
        kind, make = (1 if self.orders.wrong == "plane" else 2), (18 if self.orders.wrong == "stranger" else 3)
        base = 1 | (128 if self.armed else 0)
        beat = mavlink.MAVLink_heartbeat_message(kind, make, base, self.mode, 4 if self.armed else 3, 3)
        self.send(beat)
        if self.orders.wrong == "twin":
            twin = mavlink.MAVLink(None, self.orders.system + 1, 1)
            self.socket.sendto(beat.pack(twin), ("127.0.0.1", self.orders.port))
        lost = self.orders.wrong == "no-gps" and time.monotonic() - self.first_point_s > self.orders.after
        lat, lon = round(self.orders.lat * 1e7), round(self.orders.lon * 1e7)
        self.send(mavlink.MAVLink_gps_raw_int_message(0, 1 if lost else 4, lat, lon, 12000, 80, 120, 0, 0, 14))
        self.send(mavlink.MAVLink_sys_status_message(0, 0, 0, 100, 12600, 900, 87, 0, 0, 0, 0, 0, 0))
        height = round(self.orders.altitude * 1e3)
        self.send(mavlink.MAVLink_home_position_message(lat, lon, height, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0))

    def report(self, now_s: float) -> None:
        """Send the position."""
        if self.orders.wrong == "garbled":
            return
        at, v = self.vehicle.x, self.vehicle.v
        lat = self.orders.lat + math.degrees(at.imag / EARTH_M)
        lon = self.orders.lon + math.degrees(at.real / EARTH_M / math.cos(math.radians(self.orders.lat)))
        height = round(self.vehicle.height * 1e3)
        self.send(
            mavlink.MAVLink_global_position_int_message(
                int(now_s * 1e3) & 0xFFFFFFFF, round(lat * 1e7), round(lon * 1e7),
                height + round(self.orders.altitude * 1e3), height,
                round(100 * v.imag), round(100 * v.real), 0, 0,
            )
        )  # fmt: skip

    def say(self, text: str) -> None:
        """Send a text."""
        self.send(mavlink.MAVLink_statustext_message(4, text.encode()))

    def send(self, message: Any) -> None:
        """Send a message to the port."""
        wrong = self.orders.wrong
        frames = [message.pack(self.mav, force_mavlink1=wrong == "mavlink1")]
        if wrong == "double":
            frames.append(message.pack(self.second))
        if wrong == "dialect":  # A frame of MAVLink 2 with message 60000.
            frames = [bytes([0xFD, 4, 0, 0, self.mav.seq, self.orders.system, 1, 0x60, 0xEA, 0, 1, 2, 3, 4, 0, 0])]
        for frame in frames:
            with contextlib.suppress(ConnectionRefusedError):
                self.socket.sendto(frame, ("127.0.0.1", self.orders.port))
        for mav in (self.mav, self.second):
            mav.seq = (mav.seq + 1) % 256


def main(orders: list[dict[str, Any]]) -> None:
    """Fly all stand-ins until SIGTERM, then print their logs."""
    stand_ins = [StandIn(Orders(**each)) for each in orders]
    over: list[int] = []
    signal.signal(signal.SIGTERM, lambda *_: over.append(1))
    print("ready", flush=True)
    due_s = time.monotonic()
    while not over:
        due_s += STEP_S
        while (left_s := due_s - time.monotonic()) > 0:
            ready, _, _ = select.select([each.socket for each in stand_ins], [], [], left_s)
            for each in stand_ins:
                if each.socket in ready:
                    each.read(time.monotonic())
        for each in stand_ins:
            each.advance(due_s)
    print(json.dumps([each.log for each in stand_ins]), flush=True)


if __name__ == "__main__":
    main(json.loads(sys.argv[1]))
