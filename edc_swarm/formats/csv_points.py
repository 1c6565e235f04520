"""CSV of way points: a header with the names of the columns, then a way point per row.

Columns may be separated by commas, semicolons or tabs; where commas do not separate them, numbers may have decimal
commas. A column for the UAV makes one route per UAV.
"""

from __future__ import annotations

import csv
import io
import re
from dataclasses import dataclass

from edc_swarm.errors import FormatError
from edc_swarm.formats.content import MAX_POINTS, Content, Options, Point, Route, Stop, check_lat_lon, decoded, parsed

SEPARATORS = ",;\t"
NAMES = {
    "lat": ("lat", "latitude", "lat_deg", "latitude_deg"),
    "lon": ("lon", "lng", "long", "longitude", "lon_deg", "longitude_deg"),
    "x": ("x", "x_m", "east", "east_m", "easting"),
    "y": ("y", "y_m", "north", "north_m", "northing"),
    "altitude": ("alt", "altitude", "alt_m", "altitude_m", "z", "z_m", "height", "height_m"),
    "uav": ("uav", "uav_id", "vehicle", "drone", "agent", "robot"),
    "hover_s": ("hover_s", "hover", "hold_s", "hold"),
    "accept_m": ("accept_m",),
    "v_max_mps": ("v_max_mps", "speed_mps"),
    "r_m": ("r_m",),
}
"""The columns that are read, by their names in small letters."""
UNITS = {
    **dict.fromkeys(("lat", "lon"), ("deg", "degree", "degrees", "°")),
    **dict.fromkeys(("x", "y", "accept_m", "r_m"), ("m", "metre", "metres", "meter", "meters")),
    "hover_s": ("s", "sec", "second", "seconds"),
    "v_max_mps": ("m/s", "mps"),
}
"""The units that a column's name may state in brackets, the first of them the usual one."""
_LEADING = re.compile(r"\A(?:[ \t]*\n|#.*\n|sep=.\n)*", re.IGNORECASE)
"""Lines before the header: empty ones, comments, and the one by which spreadsheets state the separator."""
ONE_PER_UAV = ("accept_m", "v_max_mps", "r_m")
"""Columns of which a route takes one value."""


@dataclass(frozen=True, slots=True)
class Row:
    """One row: the place in the file, and the text of each column that is read."""

    place: str
    values: dict[str, str]
    decimal_comma: bool

    def number(self, column: str) -> float:
        """Return the number of a column, 0 if it is absent or empty."""
        text = self.values.get(column, "").strip()
        if self.decimal_comma and "." not in text:
            text = text.replace(",", ".")
        return parsed(self.place, column, text) if text else 0.0

    def point(self) -> Point:
        """Return the position: latitude and longitude, or x and y."""
        first, second = ("lat", "lon") if "lat" in self.values else ("x", "y")
        for column in (first, second):
            if not self.values[column].strip():
                raise FormatError(self.place, f"{column} = '': must be a finite number")
        point = self.number(first), self.number(second)
        return check_lat_lon(self.place, *point) if first == "lat" else point


def read_csv(data: bytes, options: Options) -> Content:
    """Return a route per UAV of a CSV file.

    Raises
    ------
    FormatError
    """
    del options
    content = Content()
    rows = _rows(decoded(data), content)
    content.frame = "wgs84" if "lat" in rows[0].values else "local"
    by_uav: dict[str, list[Row]] = {}
    is_named = any(row.values.get("uav", "").strip() for row in rows)
    for row in rows:
        if is_named and not row.values["uav"].strip():
            raise FormatError(row.place, "uav = '': must name a UAV, as other rows do")
        by_uav.setdefault(row.values.get("uav", "").strip(), []).append(row)
        if row.number("altitude"):
            content.note("altitude: the mission is flown in a plane", row.place)
    content.routes = [_route(uav, own, content) for uav, own in by_uav.items()]
    return content


def has_header(text: str) -> bool:
    """Return True if the first line of a text names columns with positions."""
    line = _LEADING.sub("", text, count=1).split("\n", 1)[0][:10_000]
    return _has_positions([_column(name) for name in line.replace('"', "").split(_separator(line))])


def _rows(text: str, content: Content) -> list[Row]:
    lines = _LEADING.sub("", text, count=1)
    first = lines.split("\n", 1)[0]
    separator = _separator(first)
    reader = csv.reader(io.StringIO(lines), delimiter=separator, strict=True)
    try:
        table = [(reader.line_num, row) for row in reader]
    except csv.Error as error:
        raise FormatError(f"line {reader.line_num}", f"must be CSV ({error})") from None
    skipped = text.count("\n", 0, len(text) - len(lines))
    columns = _columns(table[0][1] if table else [], content)
    body = [(number + skipped, row) for number, row in table[1:] if any(cell.strip() for cell in row)]
    if not 0 < len(body) <= MAX_POINTS:
        raise FormatError("", f"{len(body)} rows below the header: must be from 1 to {MAX_POINTS}")
    rows = []
    for number, row in body:
        if len(row) != len(table[0][1]):
            raise FormatError(f"line {number}", f"{len(row)} columns: must be {len(table[0][1])}, as in the header")
        read = {column: row[index] for index, column in enumerate(columns) if column}
        rows.append(Row(f"line {number}", read, separator != ","))
    return rows


def _separator(line: str) -> str:
    return max(SEPARATORS, key=line.count)


def _columns(header: list[str], content: Content) -> list[str]:
    """Return the meaning of each column, "" for one that is not read."""
    columns = [_column(name) for name in header]
    if not _has_positions(columns):
        raise FormatError("line 1", "the header: must name lat and lon, or x and y")
    if {"lat", "lon"} <= set(columns) and {"x", "y"} & set(columns):
        raise FormatError("line 1", "the header: must name lat and lon, or x and y, not both")
    for column in filter(None, columns):
        if columns.count(column) > 1:
            raise FormatError("line 1", f"the header: must name {column} once")
    for index, (name, column) in enumerate(zip(header, columns, strict=True), 1):
        _check_unit(name, column)
        if not column:
            content.note(f"column {name.strip()[:40]}", f"column {index}")
    return columns


def _check_unit(name: str, column: str) -> None:
    """Raise `FormatError` for a column whose name states another unit than its numbers are read in."""
    stated = re.search(r"[(\[]([^)\]]*)", name)
    units = UNITS.get(column, ())
    if stated and units and stated[1].strip().lower() not in units:
        raise FormatError("line 1", f"column {name.strip()[:40]!r}: must be in {units[0]}")


def _has_positions(columns: list[str]) -> bool:
    return {"lat", "lon"} <= set(columns) or {"x", "y"} <= set(columns)


def _column(name: str) -> str:
    """Return the meaning of a column's name, which may end in a unit in brackets; "" if it is not read."""
    plain = name.strip().lower().partition("(")[0].partition("[")[0].strip().replace(" ", "_")
    return next((column for column, names in NAMES.items() if plain in names), "")


def _route(uav: str, rows: list[Row], content: Content) -> Route:
    stops = [Stop(row.place, row.point(), row.number("hover_s")) for row in rows]
    accept_m, v_max_mps, r_m = (_one_value(column, rows, content) for column in ONE_PER_UAV)
    place = f"{rows[0].place} to {rows[-1].place}"
    return Route(place, stops, uav=uav, accept_m=accept_m, v_max_mps=v_max_mps, r_m=r_m)


def _one_value(column: str, rows: list[Row], content: Content) -> float:
    """Return the value of a column if all rows of a UAV share it, else 0."""
    values = {row.number(column) for row in rows}
    if len(values) > 1:
        content.note(f"{column} that differs between the way points of a UAV", *(row.place for row in rows))
        return 0.0
    return values.pop()
