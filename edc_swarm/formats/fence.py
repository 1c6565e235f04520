"""ArduPilot fence files: latitude and longitude per line; the first line is the return point, the rest a polygon."""

from __future__ import annotations

from edc_swarm.errors import FormatError
from edc_swarm.formats.content import MAX_POINTS, Area, Content, Options, Point, check_lat_lon, decoded, parsed


def read_fence(data: bytes, options: Options) -> Content:
    """Return the inclusion zone of a fence file.

    Mission Planner writes the polygons that a user draws in the same way, without a return point, so the first line is
    the last one as well.

    Raises
    ------
    FormatError
    """
    del options
    lines = [(f"line {number}", line.replace(",", " ").split()) for number, line in enumerate(lines_of(data), 1)]
    rows = [(place, row) for place, row in lines if row and not row[0].startswith("#")]
    points = [_point(place, row) for place, row in rows]
    if len(points) < 2:
        raise FormatError("", "must hold a return point and the corners of a polygon")
    if len(points) > MAX_POINTS:
        raise FormatError("", f"{len(points)} points: must be at most {MAX_POINTS}")
    if len(points) > 1 and points[0] == points[-1]:
        why = "a closed polygon without a return point"
        return Content(areas=[Area("the polygon", "fence", "inclusion", points, why=why)])
    content = Content(areas=[Area("the polygon", "fence", "inclusion", points[1:])])
    content.note("return point of the fence (its first line)", rows[0][0])
    return content


def lines_of(data: bytes) -> list[str]:
    """Return the lines of a text file."""
    return decoded(data).split("\n")


def _point(place: str, row: list[str]) -> Point:
    if len(row) != 2:
        raise FormatError(place, f"{len(row)} columns: must be latitude and longitude")
    return check_lat_lon(place, parsed(place, "latitude", row[0]), parsed(place, "longitude", row[1]))
