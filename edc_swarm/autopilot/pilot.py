"""One autopilot from its first heartbeat to its landing: what it is told, and what is to be said of it.

    CONNECTING -> READYING -> ARMING -> CLIMBING -> FLYING -> LANDING -> DONE

It is armed only with permission, and after `objections` has none. What goes wrong before slot 0 grounds the UAV, what
goes wrong after it makes the UAV stray: the pilot then sends nothing but heartbeats, so it never fights a human pilot
or the autopilot's own failsafe.

Set-points go out only for a step that the UAV has begun: they end one slot after the end of the newest step. All times
are those of the mission's clock.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import Enum, auto
from typing import Any

from edc_swarm.autopilot.checks import HEARTBEAT_LOST_S, failings, objections, texts
from edc_swarm.autopilot.failsafes import asked_names, told, warnings
from edc_swarm.autopilot.path import Point, Step, set_point
from edc_swarm.autopilot.telemetry import COPTER_GUIDED, PX4_OFFBOARD, Telemetry
from edc_swarm.mission.configuration import NS_PER_S, Mission
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.mission.vehicle_budget import vehicle_of

SET_POINT_NS = NS_PER_S // 20
"""Time between two set-points: 20 in a second."""
BEAT_NS = NS_PER_S
ASK_NS = NS_PER_S
"""Time after which a command without its effect is sent again."""
FAILSAFE_ASKED = 3
"""Times that the parameters of its failsafe are asked for; an autopilot does not answer for those that it lacks."""
DISARM_NS = 3 * NS_PER_S // 2
"""Time in which an arming that is broken off shows in a heartbeat."""
REACHED_SHARE = 0.9
"""Share of the altitude at which the climb is over."""

SET_MODE, ARM, TAKE_OFF, LAND, INTERVAL, ASK_MESSAGE = 176, 400, 22, 21, 511, 512
"""MAV_CMD."""
PARAMETER = -1
"""Stands for the requests of parameters among the commands that have been sent."""
CUSTOM_MODE = 1
ACCEPTED = 0
WANTED_HZ = {33: 20.0, 1: 2.0, 24: 2.0, 147: 1.0, 242: 0.5, 245: 2.0}
"""Messages that the autopilot is asked for: position, status, GPS, battery, home, landed state."""
RESULTS = {1: "temporarily rejected", 2: "denied", 3: "unsupported", 4: "failed"}

Fields = Mapping[str, Any]


class Stage(Enum):
    """Stages of a flight."""

    CONNECTING = auto()
    READYING = auto()
    ARMING = auto()
    CLIMBING = auto()
    FLYING = auto()
    LANDING = auto()
    STRAYING = auto()
    DONE = auto()


@dataclass(frozen=True, slots=True)
class Said:
    """News of the autopilot: `kind` is "autopilot" for what it has done, "grounded", "strayed", "down" for its ends."""

    kind: str
    text: str


class Pilot:
    """Pilot of one autopilot; `hear` and `advance` are its doors. One thread calls them.

    Parameters
    ----------
    epoch_ns
        Beginning of slot 0.
    arm
        True if the vehicle may be armed. Without it nothing is sent but requests for telemetry.
    flies
        True for a UAV that has flown in this mission: its process was started again, and its vehicle is in the air.

    Attributes
    ----------
    telemetry
        What the autopilot says.
    stage
        The stage of the flight.
    step
        The newest step that the UAV has begun; None before the first one.
    is_down
        True if the vehicle has strayed, and is on the ground with its motors off.
    """

    def __init__(self, mission: Mission, entry: RosterEntry, epoch_ns: int, *, arm: bool, flies: bool = False) -> None:
        self._mission = mission
        self._entry = entry
        self._vehicle = vehicle_of(mission, entry)
        self._epoch_ns = epoch_ns
        self._arm = arm
        self._flies = flies
        self._start_m: Point = (entry.start_x_m, entry.start_y_m)
        self._asked_ns: dict[int, int] = {}
        self._beat_ns = 0
        self._failsafe_asked = 0
        self._point_ns = 0
        self._land_by_ns = self._disarm_by_ns = 0
        self.is_down = False
        self.telemetry = Telemetry(mission)
        self.stage = Stage.CONNECTING
        self.step: Step | None = None
        self.news: list[Said] = []

    def land(self, now_ns: int) -> None:
        """Land where the vehicle is, unless it strays or has never flown."""
        if self.stage in {Stage.ARMING, Stage.CLIMBING, Stage.FLYING}:
            self._asked_ns.clear()
            self.stage, self._land_by_ns = Stage.LANDING, now_ns + round((self._mission.landing_s + 10.0) * NS_PER_S)
            self._disarm_by_ns = now_ns + DISARM_NS
        elif self.stage in {Stage.CONNECTING, Stage.READYING}:
            self.stage = Stage.DONE

    def due_in_s(self, now_ns: int) -> float:
        """Return the time until the next set-point is due; infinite while none are sent."""
        left_ns = self._point_ns + SET_POINT_NS - now_ns
        return max(0.0, left_ns / NS_PER_S) if left_ns > -SET_POINT_NS else math.inf

    def advance(self, now_ns: int) -> list[tuple[str, Fields]]:
        """Return the messages that are due now."""
        out: list[tuple[str, Fields]] = []
        if now_ns - self._beat_ns >= BEAT_NS:
            self._beat_ns = now_ns
            out.append(("heartbeat", _heartbeat()))
        if self.telemetry.system is not None and self.stage not in {Stage.STRAYING, Stage.DONE}:
            out += [*self._requests(now_ns), *self._failsafe_requests(now_ns)]
            self._check(now_ns)
            out += self._due(now_ns)
        elif self.stage is Stage.STRAYING and not self.telemetry.armed:
            self.stage, self.is_down = Stage.DONE, True
            self._say("down", "its motors are off")
        elif self.stage is Stage.CONNECTING and self._arm and now_ns >= self._epoch_ns and not self._flies:
            self._ground("its autopilot sends no heartbeat")
        return out

    def objections(self, now_ns: int) -> list[str]:
        """Return why the vehicle may not be armed."""
        return list(objections(self.telemetry, self._entry, now_ns))

    def knows_failsafe(self, now_ns: int) -> bool:
        """Return True if the autopilot has told its failsafe, or has not answered often enough."""
        asked_ns = self._asked_ns.get(PARAMETER, now_ns)
        given_up = self._failsafe_asked >= FAILSAFE_ASKED and now_ns - asked_ns >= ASK_NS
        return self.telemetry.system is not None and (given_up or not asked_names(self.telemetry))

    @property
    def failsafe(self) -> tuple[str, list[str]]:
        """What the autopilot does by itself, in words, and what is wrong with that for this mission."""
        return told(self.telemetry), list(warnings(self.telemetry, self._mission))

    # --- what is due -------------------------------------------------------------------------

    def _due(self, now_ns: int) -> Iterator[tuple[str, Fields]]:
        match self.stage:
            case Stage.CONNECTING:
                self._connect(now_ns)
            case Stage.READYING:
                yield from self._ready(now_ns)
            case Stage.ARMING:
                yield from self._arm_it(now_ns)
            case Stage.CLIMBING:
                yield from self._climb(now_ns)
            case Stage.FLYING:
                yield from self._points(now_ns, before=True)
            case Stage.LANDING:
                yield from self._land(now_ns)

    def _connect(self, now_ns: int) -> None:
        seen = self.telemetry
        if self._flies:
            if seen.armed and seen.is_guided and seen.newest is not None and seen.home is not None:
                self.stage = Stage.FLYING
        elif self._arm and self.knows_failsafe(now_ns) and not self.objections(now_ns):
            self.stage = Stage.READYING
            does, wrong = self.failsafe
            checked = f"{seen.name}, home {seen.home_text}, mode {seen.mode}: its checks hold"
            self._say("autopilot", "; ".join(filter(None, [checked, does])))
            for what in wrong:
                self._say("autopilot", f"warning: {what}")

    def _ready(self, now_ns: int) -> Iterator[tuple[str, Fields]]:
        """Yield what brings the autopilot into its mode for set-points; PX4 asks for set-points before that."""
        yield from self._points(now_ns, before=self.telemetry.is_px4)
        mode = PX4_OFFBOARD if self.telemetry.is_px4 else COPTER_GUIDED
        yield from self._until(self.telemetry.is_guided, SET_MODE, now_ns, (CUSTOM_MODE, mode))
        if self.telemetry.is_guided:
            self.stage = Stage.ARMING

    def _arm_it(self, now_ns: int) -> Iterator[tuple[str, Fields]]:
        seen = self.telemetry
        yield from self._points(now_ns, before=self.telemetry.is_px4)
        yield from self._until(seen.armed or not seen.is_guided, ARM, now_ns, (1.0,))  # A pilot's mode is a pilot's.
        if seen.armed:
            self._say("autopilot", f"armed in {seen.mode}, climbs to {self._vehicle.altitude_m:g} m above its home")
            self.stage = Stage.CLIMBING

    def _climb(self, now_ns: int) -> Iterator[tuple[str, Fields]]:
        """Yield the take-off: a command to ArduPilot; PX4 climbs to the height of the set-points."""
        seen = self.telemetry
        if not seen.is_guided:
            self._stray(f"it has left its mode for {seen.mode} in the climb" + texts(seen))
            return
        yield from self._points(now_ns, before=self.telemetry.is_px4)
        if not self.telemetry.is_px4:
            params = (0.0, 0.0, 0.0, math.nan, 0.0, 0.0, self._vehicle.altitude_m)
            yield from self._until(seen.acks.get(TAKE_OFF) == ACCEPTED, TAKE_OFF, now_ns, params)
        if seen.newest is not None and seen.newest.height_m >= REACHED_SHARE * self._vehicle.altitude_m:
            self._say("autopilot", f"is in the air, {seen.newest.height_m:.1f} m above its home")
            self.stage = Stage.FLYING

    def _land(self, now_ns: int) -> Iterator[tuple[str, Fields]]:
        """Yield the landing until the vehicle lands; end when its motors are off, or a pilot has it.

        An arming that has not shown yet is taken back, and looked for until it would have.
        """
        seen = self.telemetry
        if not seen.was_armed:
            yield from self._until(False, ARM, now_ns, (0.0,))
            if now_ns > self._disarm_by_ns:
                self.stage = Stage.DONE
                self._say("autopilot", "was not armed")
        elif not seen.armed:
            self.stage = Stage.DONE
            self._say("autopilot", "has landed, and its motors are off")
        elif not seen.is_guided and seen.mode != "LAND":
            self.stage = Stage.DONE
            self._say("autopilot", f"does not land: it has gone to {seen.mode}" + texts(seen))
        elif now_ns > self._land_by_ns:
            self.stage = Stage.DONE
            silent_s = (now_ns - seen.beat_ns) / NS_PER_S
            known = (
                f"it is in {seen.mode}" if silent_s < HEARTBEAT_LOST_S else f"it has said nothing for {silent_s:.0f} s"
            )
            self._say("autopilot", f"has not landed in time: {known}")
        else:
            yield from self._until(seen.mode == "LAND", LAND, now_ns, (0.0, 0.0, 0.0, math.nan))

    def _until(self, done: bool, command: int, now_ns: int, params: tuple[float, ...]) -> Iterator[tuple[str, Fields]]:
        """Yield a command once a second until it has taken effect."""
        if not done and now_ns - self._asked_ns.get(command, -ASK_NS) >= ASK_NS:
            self._asked_ns[command] = now_ns
            yield "command_long", _command(command, *params)

    def _requests(self, now_ns: int) -> Iterator[tuple[str, Fields]]:
        """Yield requests for telemetry, until a position comes; and for the home until it is known."""
        seen = self.telemetry
        quiet = len(seen.track) < 2 or seen.gps_fix is None or seen.battery_share is None
        if quiet and now_ns - self._asked_ns.get(INTERVAL, -ASK_NS) >= ASK_NS:
            self._asked_ns[INTERVAL] = now_ns
            for message, rate_hz in WANTED_HZ.items():
                yield "command_long", _command(INTERVAL, float(message), 1e6 / rate_hz)
        yield from self._until(seen.home is not None, ASK_MESSAGE, now_ns, (242.0,))

    def _failsafe_requests(self, now_ns: int) -> Iterator[tuple[str, Fields]]:
        """Yield requests for the parameters of the failsafe, before the flight."""
        asked_ns = self._asked_ns.get(PARAMETER, -ASK_NS)
        if self.stage is not Stage.CONNECTING or self._failsafe_asked >= FAILSAFE_ASKED or now_ns - asked_ns < ASK_NS:
            return
        names = asked_names(self.telemetry)
        if names:
            self._asked_ns[PARAMETER] = now_ns
            self._failsafe_asked += 1
        for name in names:
            yield "param_request_read", {"param_id": name.encode(), "param_index": -1}

    def _points(self, now_ns: int, *, before: bool) -> Iterator[tuple[str, Fields]]:
        """Yield the set-point if it is due; `before` the first step, or between steps, the UAV stays where it is."""
        if now_ns - self._point_ns < SET_POINT_NS:
            return
        step = self.step
        if step is None:
            if not before:
                return
            step = Step(self._epoch_ns, self._start_m, self._start_m, self._start_m)
        if now_ns > max(step.start_ns, self._epoch_ns) + 2 * self._mission.slot_ns:
            return  # Commands have stopped: so do set-points, and the autopilot's own failsafe decides.
        late_ns = (now_ns - self._point_ns) % SET_POINT_NS if self._point_ns else 0
        self._point_ns = now_ns - late_ns if late_ns < SET_POINT_NS // 2 else now_ns
        home_m = self.telemetry.home[2] if self.telemetry.is_px4 and self.telemetry.home is not None else None
        fields = set_point(self._mission, self._vehicle.altitude_m, step, now_ns, home_m)
        yield "set_position_target_global_int", fields

    def _path_at(self, at_ns: int) -> Point | None:
        """Return the place on the declared path at a time; None before the newest step."""
        if self.step is None or at_ns < self.step.start_ns:
            return None
        place, *_ = self.step.place((at_ns - self.step.start_ns) / self._mission.slot_ns)
        return place.real, place.imag

    # --- the watch ---------------------------------------------------------------------------

    def _check(self, now_ns: int) -> None:
        """Ground the UAV, or let it stray, if the autopilot does not do what it is to."""
        seen = self.telemetry
        if self.stage in {Stage.ARMING, Stage.READYING, Stage.CLIMBING, Stage.CONNECTING} and self._arm:
            if now_ns >= self._epoch_ns and not self._flies:
                self._ground(_why_late(self.stage, self.telemetry, self.objections(now_ns)))
            elif self._flies and not (seen.armed and seen.is_guided):
                armed = "armed" if seen.armed else "disarmed"
                self._stray(f"its process was away, and it is {armed} in {seen.mode}")
        elif self.stage is Stage.FLYING:
            why = next(failings(seen, self._entry, self._path_at, now_ns), None)
            if why is not None:
                self._stray(why)

    def _stray(self, why: str) -> None:
        self.stage = Stage.STRAYING
        self._say("strayed", why)

    def _ground(self, why: str) -> None:
        self._say("grounded", why)
        climbing = self.stage is Stage.CLIMBING and self.telemetry.is_guided
        self.stage = Stage.DONE
        if climbing:
            self.stage, self._land_by_ns = Stage.LANDING, self._epoch_ns + round(self._mission.landing_s * NS_PER_S)

    def _say(self, kind: str, text: str) -> None:
        self.news.append(Said(kind, text))

    def take_news(self) -> list[Said]:
        """Return the news since the last call."""
        news, self.news = self.news, []
        return news


def _heartbeat() -> Fields:
    """Return the heartbeat of a ground station: autopilots land or return when it ends (their failsafe)."""
    return {"type": 6, "autopilot": 8, "base_mode": 0, "custom_mode": 0, "system_status": 4}


def _command(command: int, *params: float) -> Fields:
    values = (*params, *(7 - len(params)) * (0.0,))
    return {
        "command": command,
        "confirmation": 0,
        **{f"param{number}": value for number, value in enumerate(values, 1)},
    }


def _why_late(stage: Stage, seen: Telemetry, objections_found: list[str]) -> str:
    """Return why a vehicle is not in the air at the beginning of slot 0."""
    match stage:
        case Stage.CONNECTING:
            return "; ".join(objections_found) or "its checks took too long"
        case Stage.READYING:
            return f"it stays in {seen.mode}" + texts(seen)
        case Stage.ARMING:
            return f"it does not arm ({RESULTS.get(seen.acks.get(ARM, -1), 'no answer')})" + texts(seen)
        case _:
            height_m = seen.newest.height_m if seen.newest is not None else 0.0
            return f"it is {height_m:.1f} m high at the beginning of slot 0, in {seen.mode}" + texts(seen)
