"""Flown tracks as GeoJSON, KML and CSV: positions in the plane, never an altitude."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any
from xml.sax.saxutils import escape

import msgspec
import numpy as np

CSV_COLUMNS = ("uav", "slot", "time_s", "utc", "lat_deg", "lon_deg", "x_m", "y_m", "true_x_m", "true_y_m")
DEGREE_DIGITS = 9
"""Decimals of a degree: 0.1 mm."""


@dataclass(frozen=True, slots=True)
class TrackPoint:
    """The place of a UAV when a slot begins.

    `time_s` is the mission's time, `clock_ns` that of the clock; (`x_m`, `y_m`) is the centre of the tracked disc,
    `true_m` the true position, None where the recording lacks it.
    """

    slot: int
    time_s: float
    clock_ns: int
    lat_deg: float
    lon_deg: float
    x_m: float
    y_m: float
    true_m: tuple[float, float] | None = None

    @property
    def utc(self) -> str:
        """The clock's time in ISO 8601, in microseconds: the shortest slot of a fast simulation has 20."""
        return f"{np.datetime64(self.clock_ns // 1000, 'us')}Z"


@dataclass(frozen=True, slots=True)
class Track:
    """The way of one UAV: runs of successive slots. Between them, the recording lacks the way."""

    uav: str
    runs: list[list[TrackPoint]]


def csv_tracks(tracks: Sequence[Track]) -> str:
    """Return a row per UAV and slot, with units in the names of the columns; unknown values are empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(CSV_COLUMNS)
    for track in tracks:
        for point in (point for run in track.runs for point in run):
            place = (_degrees(point.lat_deg), _degrees(point.lon_deg), point.x_m, point.y_m)
            writer.writerow((track.uav, point.slot, point.time_s, point.utc, *place, *(point.true_m or ("", ""))))
    return text.getvalue()


def geojson_tracks(tracks: Sequence[Track]) -> str:
    """Return a feature per UAV: a line per run, with the times of its points as properties `time_s` and `utc`.

    Lines are cut at the antimeridian (RFC 7946, 3.1.9). A UAV of which no way is known has no geometry.
    """
    features = [_feature(track) for track in tracks]
    return msgspec.json.encode({"type": "FeatureCollection", "features": features}).decode() + "\n"


def _feature(track: Track) -> dict[str, Any]:
    runs = [part for run in track.runs for part in _cut(run)]
    lines, times_s, utc = [], [], []
    for run in runs:
        lines.append([_lon_lat(point) for point in run])
        times_s.append([point.time_s for point in run])
        utc.append([point.utc for point in run])
    properties: dict[str, Any] = {"uav": track.uav, "time_s": times_s, "utc": utc}
    geometry: dict[str, Any] | None = {"type": "MultiLineString", "coordinates": lines} if lines else None
    if len(lines) == 1:
        properties |= {"time_s": times_s[0], "utc": utc[0]}
        geometry = {"type": "LineString", "coordinates": lines[0]}
    return {"type": "Feature", "id": track.uav, "properties": properties, "geometry": geometry}


def _cut(run: Sequence[TrackPoint]) -> list[list[TrackPoint]]:
    """Return the parts of a run between its crossings of the antimeridian, each with a point on it."""
    parts = [[run[0]]]
    for one, two in pairwise(run):
        turn_deg = two.lon_deg - one.lon_deg
        if abs(turn_deg) > 180:
            edge_deg = math.copysign(180, one.lon_deg)
            share = (edge_deg - one.lon_deg) / (turn_deg - math.copysign(360, turn_deg))
            crossing = replace(
                one,
                time_s=one.time_s + share * (two.time_s - one.time_s),
                clock_ns=one.clock_ns + round(share * (two.clock_ns - one.clock_ns)),
                lat_deg=one.lat_deg + share * (two.lat_deg - one.lat_deg),
                lon_deg=edge_deg,
            )
            parts[-1].append(crossing)
            parts.append([replace(crossing, lon_deg=-edge_deg)])
        parts[-1].append(two)
    return parts


def kml_tracks(tracks: Sequence[Track], name: str) -> str:
    """Return a placemark per UAV: a track with times per run, on the ground, since no altitude is known."""
    marks = "".join(
        f"<Placemark><name>{escape(track.uav)}</name>\n{_multi_track(track)}</Placemark>\n" for track in tracks
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2">\n'
        f"<Document><name>{escape(name)}</name>\n{marks}</Document></kml>\n"
    )


def _multi_track(track: Track) -> str:
    if not track.runs:
        return ""
    mode = "<altitudeMode>clampToGround</altitudeMode><gx:interpolate>0</gx:interpolate>"
    return f"<gx:MultiTrack>{mode}\n{''.join(map(_kml_track, track.runs))}</gx:MultiTrack>"


def _kml_track(run: Sequence[TrackPoint]) -> str:
    whens = "".join(f"<when>{point.utc}</when>\n" for point in run)
    places = "".join(f"<gx:coord>{_degrees(point.lon_deg)} {_degrees(point.lat_deg)}</gx:coord>\n" for point in run)
    return f"<gx:Track><altitudeMode>clampToGround</altitudeMode>\n{whens}{places}</gx:Track>\n"


def _lon_lat(point: TrackPoint) -> list[float]:
    return [round(point.lon_deg, DEGREE_DIGITS), round(point.lat_deg, DEGREE_DIGITS)]


def _degrees(value: float) -> str:
    return f"{value:.{DEGREE_DIGITS}f}"
