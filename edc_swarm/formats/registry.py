"""The formats of mission files: how each is recognised, and its reader."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import PurePath

from edc_swarm.errors import FormatError
from edc_swarm.formats.content import Content, Options
from edc_swarm.formats.csv_points import has_header, read_csv
from edc_swarm.formats.fence import read_fence
from edc_swarm.formats.geojson import read_geojson
from edc_swarm.formats.kml import read_kml
from edc_swarm.formats.lsc import read_lsc
from edc_swarm.formats.mapf import read_map, read_mapf
from edc_swarm.formats.qgc_plan import read_plan
from edc_swarm.formats.way_points import read_way_points

HEAD_BYTES = 65_536
"""Bytes at the beginning of a file by which it is recognised."""
_GEOJSON = re.compile(
    r'"type"\s*:\s*"(Feature|FeatureCollection|GeometryCollection|(Multi)?(Point|LineString|Polygon))"'
)
_TWO_NUMBERS = re.compile(r"\s*[-+0-9.eE]+[\s,]+[-+0-9.eE]+\s*$")
_SCENARIO = re.compile(r"(version [0-9.]+\s*\n)?\d+\s+\S.*(\s+\d+){6}\s+[0-9.]+\s*$", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Format:
    """One format: its name, the suffixes that mean it alone, a test of a file's first characters, and its reader."""

    name: str
    suffixes: tuple[str, ...]
    looks_like: Callable[[str], bool]
    read: Callable[[bytes, Options], Content]


def _json(head: str) -> bool:
    return head.startswith("{")


def _is_fence(head: str) -> bool:
    lines = (line for line in head.split("\n") if line.strip() and not line.startswith("#"))
    return bool(_TWO_NUMBERS.match(next(lines, "")))


def _scenario_alone(data: bytes, options: Options) -> Content:
    del data, options
    raise FormatError("", "a scenario: must be given together with its .map file")


MAP = Format("MAPF map", (".map",), lambda head: bool(re.match(r"type \w+\s*\n", head)), read_map)
SCENARIO = Format("MAPF scenario", (".scen",), lambda head: bool(_SCENARIO.match(head)), _scenario_alone)
FORMATS = (
    Format("QGroundControl plan", (".plan",), lambda head: _json(head) and '"fileType"' in head, read_plan),
    Format("GeoJSON", (".geojson",), lambda head: _json(head) and bool(_GEOJSON.search(head)), read_geojson),
    Format("LSC mission", (), lambda head: _json(head) and '"quadrotors"' in head, read_lsc),
    Format(
        "KML", (".kml", ".kmz"), lambda head: bool(re.search(r"<(\w+:)?(kml|Document|Placemark)\b", head)), read_kml
    ),
    Format("MAVLink way points", (".waypoints", ".wpl"), lambda head: head.startswith("QGC WPL"), read_way_points),
    MAP,
    SCENARIO,
    Format("CSV", (".csv", ".tsv"), has_header, read_csv),
    Format("ArduPilot fence", (".fen", ".fence"), _is_fence, read_fence),
)
"""The formats, the most particular first. A new one is a file with a reader and a row here."""


@dataclass(frozen=True, slots=True)
class Source:
    """One imported file, or a map with its scenario: names, name of the format, content."""

    file: str
    format: str
    content: Content


def read_files(files: Sequence[tuple[str, bytes]], options: Options) -> list[Source]:
    """Return the content of files, each given by its name and its bytes. A map and a scenario are read together.

    Raises
    ------
    FormatError
        With the file, the item and what it must be.
    """
    known = [(name, data, _recognised(name, data)) for name, data in files]
    maps = [(name, data) for name, data, kind in known if kind is MAP]
    scenarios = [(name, data) for name, data, kind in known if kind is SCENARIO]
    for found in (maps[1:], scenarios[1:]):
        if found:
            raise FormatError("", "a second map or scenario: must be given alone", found[0][0])
    sources = []
    for name, data, kind in known:
        if kind is MAP and scenarios:
            continue
        try:
            if kind is SCENARIO and maps:
                content = read_mapf(maps[0][1], data, maps[0][0], options)
                sources.append(Source(f"{maps[0][0]}, {name}", "MAPF map and scenario", content))
            else:
                sources.append(Source(name, kind.name, kind.read(data, options)))
        except FormatError as error:
            raise error.of(name) from None
    return sources


def _recognised(name: str, data: bytes) -> Format:
    """Return the format of a file: the one of its suffix, which its content must not contradict, or of its content."""
    if not data.strip():
        raise FormatError("", "an empty file: must hold a mission", name)
    head = _head(data)
    suffix = PurePath(name).suffix.lower()
    named = next((kind for kind in FORMATS if suffix in kind.suffixes), None)
    seen = FORMATS[3] if data.startswith(b"PK\x03\x04") else next((k for k in FORMATS if k.looks_like(head)), None)
    if named is not None and seen is not None and named is not seen:
        raise FormatError("", f"must be a file of {named.name}, as its suffix says: it looks like {seen.name}", name)
    kind = named or seen
    if kind is None:
        names = ", ".join(kind.name for kind in FORMATS)
        raise FormatError("", f"unknown format: must be one of {names}", name)
    return kind


def _head(data: bytes) -> str:
    """Return the beginning of a file as text in which only letters of ASCII matter."""
    encoding = "utf-16" if data[:2] in {b"\xff\xfe", b"\xfe\xff"} else "utf-8-sig"
    text = data[:HEAD_BYTES].decode(encoding, errors="replace")
    return text.replace("\r\n", "\n").replace("\r", "\n").lstrip()
