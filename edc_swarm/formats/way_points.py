"""MAVLink way point files, `QGC WPL 110`: tables of twelve columns, as Mission Planner, MAVProxy and others write them.

`pymavlink.mavwp` reads the same files from a path alone, does not say which line is wrong, and needs serial ports and
sockets to be imported. Tests compare this reader with it.
"""

from __future__ import annotations

import math

from edc_swarm.errors import FormatError
from edc_swarm.formats.content import MAX_POINTS, Content, Options, Stop, check_lat_lon, decimal, decoded
from edc_swarm.formats.mavlink_mission import WAYPOINT, Item, mission_content

HEADER = "QGC WPL"
WPL_COLUMNS = 12


def read_way_points(data: bytes, options: Options) -> Content:
    """Return the route, or the zones, of a way point file. Item 0 is the home position.

    Raises
    ------
    FormatError
    """
    header, *lines = decoded(data).split("\n")
    if header.split() != [*HEADER.split(), "110"]:
        raise FormatError("line 1", f"{header.strip()[:40]!r}: must be 'QGC WPL 110'")
    rows = [(number, line.split()) for number, line in enumerate(lines, 2)]
    items, misnumbered = list[Item](), list[str]()
    for number, row in rows:
        if row and not row[0].startswith("#"):
            items.append(_item(number, row))
            if row[0] != str(len(items) - 1):
                misnumbered.append(f"line {number}")
    if len(items) > MAX_POINTS:
        raise FormatError("", f"{len(items)} items: must be at most {MAX_POINTS}")
    if not items:
        raise FormatError("", "must hold at least one item")
    home, rest = _home(items)
    content = mission_content(rest, home, options)
    if misnumbered:
        content.note(
            "item numbers that do not count up from 0: items are flown in the order of their lines", *misnumbered
        )
    if home is None and rest is not items:
        content.note("home position 0, 0: not known when the file was written", items[0].label)
    elif home is not None and items[0].z:
        content.note("altitude: the mission is flown in a plane", items[0].label)
    return content


def _home(items: list[Item]) -> tuple[Stop | None, list[Item]]:
    """Return home, if it is known, and the items to fly."""
    first = items[0]
    if first.label != "item 0" or first.command not in {0, WAYPOINT}:
        return None, items
    if first.nowhere or first.x is None or first.y is None:
        return None, items[1:]
    return Stop(first.label, check_lat_lon(first.label, first.x, first.y)), items[1:]


def _item(number: int, row: list[str]) -> Item:
    place = f"line {number}"
    if len(row) != WPL_COLUMNS:
        raise FormatError(place, f"{len(row)} columns: must be {WPL_COLUMNS}")
    sequence, _, frame, command = (_whole(place, text) for text in row[:4])
    one, two, three, four, x, y, z = (_value(place, text) for text in row[4:11])
    label = f"item {sequence}"
    return Item(label, command, frame, (one, two, three, four), x, y, z, goes_on=row[11] != "0")


def _whole(place: str, text: str) -> int:
    try:
        value = decimal(text)
        if value == int(value) and 0 <= value < 65536:
            return int(value)
    except (ValueError, OverflowError):
        pass
    raise FormatError(place, f"{text[:40]!r}: must be a whole number from 0 to 65535")


def _value(place: str, text: str) -> float | None:
    """Return a number; None for NaN, which leaves the value to the vehicle."""
    try:
        value = decimal(text)
    except ValueError:
        value = math.inf
    if math.isinf(value):
        raise FormatError(place, f"{text[:40]!r}: must be a number")
    return None if math.isnan(value) else value
