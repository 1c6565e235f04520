"""The content of a file of another program, in the terms that all formats share."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

from edc_swarm.errors import FormatError

MAX_FILE_BYTES = 16 << 20
"""Largest file that is read, also after decompression."""
MAX_POINTS = 20_000
"""Most points of one file: way points, and corners of zones."""

MOST_RANGES = 12
"""Ranges of items that a line names; `--json` names all items."""
_NUMBERED = re.compile(r"(.*?)(\d+)")

Frame = Literal["wgs84", "local"]
"""Frame of a file's points: (latitude, longitude) in degrees, or (x, y) in metres."""
Kind = Literal["inclusion", "exclusion"]
Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Stop:
    """One point of a route, in the frame of its file, with the time that the UAV hovers there.

    `at_home` stands for a return to the point at which the route begins.
    """

    item: str
    point: Point = (0.0, 0.0)
    hover_s: float = 0.0
    at_home: bool = False


@dataclass(frozen=True, slots=True)
class Route:
    """The way of one UAV; 0 and "" stand for what the file does not say."""

    item: str
    stops: list[Stop]
    uav: str = ""
    home: Stop | None = None
    accept_m: float = 0.0
    v_max_mps: float = 0.0
    r_m: float = 0.0

    def with_speed(self, v_max_mps: float) -> Route:
        """Return the same route with a largest speed, in metres per second."""
        return replace(self, v_max_mps=v_max_mps)


KIND_NOT_STATED: dict[Kind, str] = {
    "exclusion": "neither a property kind nor its name says which; --polygons inclusion makes it a fence",
    "inclusion": "--polygons inclusion, since neither a property kind nor its name says which",
}
"""Reason for the kind of a zone that has it by the option alone."""


@dataclass(frozen=True, slots=True)
class Area:
    """One zone, in the frame of its file: a polygon, or a circle about `centre`."""

    item: str
    name: str
    kind: Kind
    polygon: list[Point] = field(default_factory=list)
    centre: Point | None = None
    radius_m: float = 0.0
    keep: str = ""
    why: str = ""
    """Reason for its kind, where the file does not state it."""


@dataclass(slots=True)
class Content:
    """Everything that a reader has found in one file.

    Attributes
    ----------
    notes
        What the file holds and a mission does not express, each with the items that hold it, in their order.
    """

    frame: Frame = "wgs84"
    routes: list[Route] = field(default_factory=list)
    areas: list[Area] = field(default_factory=list)
    home: Point | None = None
    notes: dict[str, dict[str, None]] = field(default_factory=dict)

    def note(self, what: str, *items: str) -> None:
        """Add items to those that hold `what`, which the mission does not express."""
        self.notes.setdefault(what, {}).update(dict.fromkeys(items))


@dataclass(frozen=True, slots=True)
class Options:
    """The user's choices where a file leaves one.

    Attributes
    ----------
    start
        A UAV starts at the `home` of its file, or at its `first` way point.
    polygons
        Kind of a polygon of KML or GeoJSON that does not state one.
    cell_m
        Side of a cell of a MAPF map.
    agents
        Number of agents of a MAPF scenario.
    list_unknown
        List MAVLink commands that this program does not know, rather than refuse the file.
    mixed_altitudes
        Accept altitudes above sea level beside others: no altitude is flown.
    """

    start: Literal["home", "first"] = "home"
    polygons: Kind = "exclusion"
    cell_m: float = 10.0
    agents: int = 10
    list_unknown: bool = False
    mixed_altitudes: bool = False


def check_lat_lon(item: str, lat_deg: float, lon_deg: float) -> Point:
    """Return latitude and longitude, in degrees; raise `FormatError` unless they are a point of the Earth."""
    if not -90 <= lat_deg <= 90:
        raise FormatError(item, f"latitude = {lat_deg!r}: must be from -90 to 90")
    if not -180 <= lon_deg <= 180:
        raise FormatError(item, f"longitude = {lon_deg!r}: must be from -180 to 180")
    return lat_deg, lon_deg


def number(item: str, name: str, value: object) -> float:
    """Return `value` as a finite number; raise `FormatError` with the field's name if it is none."""
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        try:
            found = float(value)
        except OverflowError:
            found = math.inf
        if math.isfinite(found):
            return found
    raise FormatError(item, f"{name} = {_short(value)}: must be a finite number")


def parsed(item: str, name: str, text: str) -> float:
    """Return the number that `text` states; raise `FormatError` if it states no finite one."""
    try:
        return number(item, name, decimal(text))
    except ValueError:
        raise FormatError(item, f"{name} = {_short(text)}: must be a finite number") from None


def decimal(text: str) -> float:
    """Return the number that `text` states, in digits of ASCII and without Python's underscores, else `ValueError`."""
    if not text.isascii() or "_" in text:
        raise ValueError(text)
    return float(text)


def decoded(data: bytes) -> str:
    """Return a text file as text, without its byte order mark, whatever its line ends.

    Raises
    ------
    FormatError
        It is neither UTF-8 nor UTF-16 with a byte order mark, or holds a zero byte.
    """
    encoding = "utf-16" if data[:2] in {b"\xff\xfe", b"\xfe\xff"} else "utf-8-sig"
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError as error:
        raise FormatError(f"byte {error.start}", "must be text in UTF-8, or in UTF-16 with a byte order mark") from None
    if "\0" in text:
        raise FormatError("", "must be a text file: it holds a zero byte")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def ranges(items: Sequence[str]) -> str:
    """Return items in short: "item 1-3, item 7"."""
    found: list[tuple[str, int, int]] = []
    for item in items:
        match = _NUMBERED.fullmatch(item)
        if match is None:
            found.append((item, -1, -1))
        elif found and found[-1][0] == match[1] and found[-1][2] + 1 == int(match[2]):
            found[-1] = (match[1], found[-1][1], int(match[2]))
        else:
            found.append((match[1], int(match[2]), int(match[2])))
    texts = [word if first < 0 else f"{word}{first}" + f"-{last}" * (last > first) for word, first, last in found]
    more = len(texts) - MOST_RANGES
    return ", ".join(texts[:MOST_RANGES]) + (f" and {more} more" if more > 0 else "")


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
