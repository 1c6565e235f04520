"""MAVLink messages as values: what goes to a ground station, and what comes from it.

Names and fields are those of the message set `common` (https://mavlink.io/en/messages/common.html). A shell encodes
them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum

MAX_SYSTEMS = 250
"""Most UAVs that a ground station can tell apart: 255 is the ground station's own usual number."""

Value = int | float | bytes | list[int] | list[float]


@dataclass(frozen=True, slots=True)
class Frame:
    """A MAVLink message of one UAV, whose system has the number of the UAV in the roster, from 1 on."""

    system: int
    name: str
    fields: Mapping[str, Value]


@dataclass(frozen=True, slots=True)
class Request:
    """A MAVLink message from a ground station (`sender`, `component`) to the UAV `system`; 0 is every UAV."""

    sender: int
    component: int
    system: int
    name: str
    fields: Mapping[str, Value]


class Command(IntEnum):
    """MAV_CMD, as far as this package knows it."""

    NAV_WAYPOINT = 16
    NAV_LAND = 21
    DO_SET_MODE = 176
    DO_REPOSITION = 192
    DO_PAUSE_CONTINUE = 193
    MISSION_START = 300
    REQUEST_MESSAGE = 512
    REQUEST_AUTOPILOT_CAPABILITIES = 520
    SET_MESSAGE_INTERVAL = 511
    FENCE_INCLUSION_CORNER = 5001
    FENCE_EXCLUSION_CORNER = 5002
    FENCE_INCLUSION_CIRCLE = 5003
    FENCE_EXCLUSION_CIRCLE = 5004


class Result(IntEnum):
    """MAV_RESULT."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3


class Severity(IntEnum):
    """MAV_SEVERITY, as far as this package uses it."""

    WARNING = 4
    INFO = 6


class MessageId(IntEnum):
    """Numbers of the messages that a ground station can ask for."""

    SYS_STATUS = 1
    GPS_RAW_INT = 24
    ATTITUDE = 30
    GLOBAL_POSITION_INT = 33
    BATTERY_STATUS = 147
    AUTOPILOT_VERSION = 148
    HOME_POSITION = 242
    EXTENDED_SYS_STATE = 245
