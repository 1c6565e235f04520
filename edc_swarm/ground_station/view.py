"""The whole swarm for a ground station: messages of the mission in, MAVLink messages out, requests answered.

==============================  ==================================================================================
Request of the ground station   Answer
==============================  ==================================================================================
MISSION_REQUEST_LIST            MISSION_COUNT: the points of the route, or the fence items of the zones
MISSION_REQUEST(_INT)           MISSION_ITEM_INT
REQUEST_MESSAGE (command)       the message, if it is one of `MessageId`
PARAM_REQUEST_LIST              nothing: a UAV has no parameters
a command of `steering`         with permission: COMMAND_ACK `ACCEPTED`, an order for the caller
every other command             COMMAND_ACK `DENIED`, a STATUSTEXT, and a line for the caller
a new mission, mode, position   the same; a mission with MISSION_ACK `DENIED`
==============================  ==================================================================================
"""

from __future__ import annotations

import textwrap
from collections import Counter
from collections.abc import Mapping

from edc_swarm.errors import InputError
from edc_swarm.ground_station.frames import MAX_SYSTEMS, Command, Frame, Request, Result, Severity
from edc_swarm.ground_station.mission_items import Item, fence_items, route_items
from edc_swarm.ground_station.steering import order_of
from edc_swarm.ground_station.vehicle import VehicleView
from edc_swarm.mission.configuration import NS_PER_S
from edc_swarm.mission.routes import Course
from edc_swarm.protocol.events import EVENT_FORMS, EventKind
from edc_swarm.protocol.ground_orders import GroundOrder
from edc_swarm.protocol.messages import Event, Fix, Message, MissionMessage, roster_index

ROUTE, FENCE = 0, 1
"""MAV_MISSION_TYPE."""
MISSION_DENIED = 14
"""MAV_MISSION_DENIED."""
INVALID_SEQUENCE = 13
"""MAV_MISSION_INVALID_SEQUENCE."""
TEXT_CHARS = 50
"""Characters of one STATUSTEXT."""
MAX_CHUNKS = 4
QUIET = frozenset({EventKind.CLOSED, EventKind.DELAY_ERROR, EventKind.CLOCK_OFFSET, EventKind.HOST_REQUEST})
"""Events that mean nothing to a pilot."""
STEERING = frozenset(
    {
        "set_mode", "mission_count", "mission_clear_all", "mission_set_current", "mission_write_partial_list",
        "set_position_target_local_ned", "set_position_target_global_int", "set_attitude_target", "manual_control",
        "rc_channels_override", "set_home_position", "param_set",
    }
)  # fmt: skip
"""Messages, besides commands, that would steer a UAV."""
MAX_DENIED_KINDS = 100
"""Most kinds of denied requests that are counted apart."""
MAX_ORDERS = 500
"""Most orders in a second: two for each of the most UAVs. More requests are denied."""
NO_SYSTEM = "for a system that is no UAV"
REQUESTED_MESSAGES = frozenset({Command.REQUEST_MESSAGE, Command.REQUEST_AUTOPILOT_CAPABILITIES})


def check_systems(uavs: int) -> None:
    """Refuse a swarm with more UAVs than MAVLink can number.

    Raises
    ------
    InputError
        There are more than `MAX_SYSTEMS` UAVs.
    """
    if uavs > MAX_SYSTEMS:
        raise InputError("--mavlink", f"{uavs} UAVs", f"of a mission with at most {MAX_SYSTEMS} UAVs")


class GroundView:
    """All UAVs of one mission as MAVLink systems. Call its methods with times that do not go back.

    Parameters
    ----------
    permitted
        True if the ground station may command.

    Attributes
    ----------
    denied
        Number of requests that would have steered a UAV, by their kind.
    ignored
        Number of requests that nobody answers: they may be for other vehicles of the same ground station.
    """

    def __init__(self, *, permitted: bool = False) -> None:
        self._permitted = permitted
        self._orders: list[GroundOrder] = []
        self._mission: MissionMessage | None = None
        self._index: Mapping[str, int] = {}
        self._vehicles: list[VehicleView] = []
        self._texts = 0
        self._ordered_ns, self._ordered_count = 0, 0
        self.denied: Counter[str] = Counter()
        self.ignored: Counter[str] = Counter()

    def hear(self, message: Message, now_ns: int) -> list[Frame]:
        """Take in a message of the mission; return what the ground station is told at once."""
        if isinstance(message, MissionMessage):
            if self._mission is None:
                self._take_mission(message)
            return []
        if self._mission is None:
            return []
        if isinstance(message, Fix) and message.uav in self._index:
            return self._vehicles[self._index[message.uav]].hear_fix(message, now_ns)
        return self._told(message) if isinstance(message, Event) else []

    def advance(self, now_ns: int) -> list[Frame]:
        """Return what is due by now: heartbeats, states and batteries."""
        if now_ns - self._ordered_ns >= NS_PER_S:
            self._ordered_ns, self._ordered_count = now_ns, 0
        return [frame for vehicle in self._vehicles for frame in vehicle.advance(now_ns)]

    def answer(self, request: Request) -> list[Frame]:
        """Return the answer to a request; a request to every UAV is answered by each."""
        systems = range(1, len(self._vehicles) + 1)
        asked = systems if request.system == 0 else [request.system] if request.system in systems else []
        if request.system > len(systems):
            self.ignored[NO_SYSTEM] += 1
        return [frame for system in asked for frame in self._answer(system, request)]

    def take_orders(self) -> list[GroundOrder]:
        """Return the orders to the operator since the last call."""
        orders, self._orders = self._orders, []
        return orders

    # --- what is told ------------------------------------------------------------------------

    def _take_mission(self, mission: MissionMessage) -> None:
        check_systems(len(mission.roster))
        self._mission = mission
        self._index = roster_index(mission.roster)
        self._vehicles = [VehicleView(mission, entry, 1 + index) for index, entry in enumerate(mission.roster)]

    def _told(self, event: Event) -> list[Frame]:
        """Return an event as text of the UAV that it comes from; of the first UAV if it comes from no UAV."""
        index = self._index.get(event.source)
        if index is not None and event.kind == EventKind.LANDED:
            self._vehicles[index].land()
        if event.kind not in EVENT_FORMS or event.kind in QUIET:
            return []
        warns = EVENT_FORMS[EventKind(event.kind)].warning
        text = " ".join(f"{event.source} {event.kind.replace('-', ' ')} {event.detail}".split())
        return self._text(1 + (index or 0), Severity.WARNING if warns else Severity.INFO, text)

    def _text(self, system: int, severity: Severity, text: str) -> list[Frame]:
        """Return a text in chunks, as MAVLink 2 has them; a text that is longer than all chunks is cut."""
        ascii_text = textwrap.shorten(text.encode("ascii", "replace").decode(), MAX_CHUNKS * TEXT_CHARS - 1)
        chunks = [ascii_text[at : at + TEXT_CHARS] for at in range(0, len(ascii_text), TEXT_CHARS)]
        self._texts = self._texts % 0xFFFF + 1
        number = self._texts if len(chunks) > 1 else 0
        return [
            Frame(
                system,
                "statustext",
                {"severity": int(severity), "text": chunk.encode(), "id": number, "chunk_seq": index},
            )
            for index, chunk in enumerate(chunks)
        ]

    # --- what is answered --------------------------------------------------------------------

    def _answer(self, system: int, request: Request) -> list[Frame]:
        match request.name:
            case "mission_request_list":
                return [self._count(system, request)]
            case "mission_request_int" | "mission_request":
                return [self._item(system, request)]
            case "command_long" | "command_int":
                return self._command(system, request)
            case name if name in STEERING:
                return [] if self._ordered(system, request) else self._denied(system, request, name)
        return []

    def _items(self, system: int, kind: object) -> list[Item]:
        mission, fix = self._mission, self._vehicles[system - 1].course_fix
        assert mission is not None, "there are vehicles, so there is a mission"
        if kind == ROUTE:
            return route_items(mission, mission.roster[system - 1], fix.course if fix is not None else Course())
        return fence_items(mission) if kind == FENCE else []

    def _count(self, system: int, request: Request) -> Frame:
        kind = request.fields.get("mission_type", ROUTE)
        count = len(self._items(system, kind))
        return _to(request, system, "mission_count", count=count, mission_type=_int(kind))

    def _item(self, system: int, request: Request) -> Frame:
        kind, seq = request.fields.get("mission_type", ROUTE), _int(request.fields.get("seq", 0))
        items = self._items(system, kind)
        if seq >= len(items):
            return _to(request, system, "mission_ack", type=INVALID_SEQUENCE, mission_type=_int(kind))
        return _to(
            request, system, "mission_item_int", **items[seq], seq=seq, current=int(seq == 0), mission_type=_int(kind)
        )

    def _command(self, system: int, request: Request) -> list[Frame]:
        command = _int(request.fields.get("command", 0))
        if command not in REQUESTED_MESSAGES:
            if command == Command.SET_MESSAGE_INTERVAL:
                return [_ack(request, system, command, Result.UNSUPPORTED)]
            if self._ordered(system, request):
                return [_ack(request, system, command, Result.ACCEPTED)]
            return self._denied(system, request, f"command {command}")
        asked = 148 if command == Command.REQUEST_AUTOPILOT_CAPABILITIES else _int(request.fields.get("param1", 0))
        frames = self._vehicles[system - 1].asked_for(asked)
        return [_ack(request, system, command, Result.ACCEPTED if frames else Result.UNSUPPORTED), *frames]

    def _ordered(self, system: int, request: Request) -> bool:
        """Keep the order that a request amounts to, if the ground station may command; return True if there is one."""
        mission = self._mission
        if mission is None or not self._permitted or not self._vehicles[system - 1].flies:
            return False
        order = order_of(mission, mission.roster[system - 1].uav, request)
        if order is None or self._ordered_count >= MAX_ORDERS:
            return False
        self._ordered_count += 1
        self._orders.append(order)
        return True

    def _denied(self, system: int, request: Request, kind: str) -> list[Frame]:
        """Deny what would steer a UAV, say so, and count it."""
        self.denied[kind if kind in self.denied or len(self.denied) < MAX_DENIED_KINDS else "others"] += 1
        why = "no order that the operator takes" if self._permitted else "this ground station may only look on"
        said = self._text(system, Severity.WARNING, f"denied: {kind}: {why}")
        if request.name in {"command_long", "command_int"}:
            return [_ack(request, system, _int(request.fields.get("command", 0)), Result.DENIED), *said]
        if request.name.startswith("mission_"):
            return [_to(request, system, "mission_ack", type=MISSION_DENIED, mission_type=0), *said]
        return said


def _int(value: object) -> int:
    """Return a number of a request as a whole number, 0 if it is none."""
    return int(value) if isinstance(value, int | float) and abs(value) < 1 << 31 else 0


def _to(request: Request, system: int, name: str, **fields: object) -> Frame:
    to = {"target_system": request.sender, "target_component": request.component}
    return Frame(system, name, {**to, **fields})  # type: ignore[dict-item]


def _ack(request: Request, system: int, command: int, result: Result) -> Frame:
    return _to(request, system, "command_ack", command=command, result=int(result))
