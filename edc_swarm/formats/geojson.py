"""GeoJSON (RFC 7946): points, lines and polygons, with properties."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from edc_swarm.errors import FormatError
from edc_swarm.formats.content import Content, Options, check_lat_lon, number
from edc_swarm.formats.features import Feature, Shape, features_content, properties_of
from edc_swarm.formats.json_values import as_list, as_table, as_word, json_value

GEOMETRIES = ("Point", "MultiPoint", "LineString", "MultiLineString", "Polygon", "MultiPolygon", "GeometryCollection")
TYPES = frozenset({*GEOMETRIES, "Feature", "FeatureCollection"})
MEMBERS = frozenset({"type", "features", "properties", "geometry", "geometries", "coordinates", "crs"})
MAX_DEPTH = 10
"""Levels of geometry collections."""
WGS84_NAMES = ("CRS84", "4326", "4979")
"""Ends of the names of coordinate reference systems that are WGS 84, for files older than RFC 7946."""
Position = tuple[float, float, float]


def read_geojson(data: bytes, options: Options) -> Content:
    """Return routes and zones of a GeoJSON file.

    Raises
    ------
    FormatError
    """
    root = as_table("the file", json_value(data))
    kind = as_word(root.get("type"))
    if kind not in TYPES:
        raise FormatError("type", f"{kind!r}: must be a type of GeoJSON")
    _check_reference_system(root)
    notes = Content()
    if kind != "Feature":
        _note_members("the file", root, notes)
    return features_content(list(_features(root, notes)), notes, options)


def _check_reference_system(root: dict[str, Any]) -> None:
    if root.get("crs") is not None:
        properties = as_table("crs", root["crs"]).get("properties")
        name = as_word(as_table("crs", properties).get("name", ""))
        if not name.endswith(WGS84_NAMES):
            raise FormatError("crs", f"{name!r}: must be WGS 84 (CRS84 or EPSG:4326)")


def _features(root: dict[str, Any], notes: Content) -> Iterator[Feature]:
    if root["type"] == "FeatureCollection":
        for index, value in enumerate(as_list("features", root.get("features")), 1):
            yield _feature(f"feature {index}", as_table(f"feature {index}", value), notes)
    elif root["type"] == "Feature":
        yield _feature("the feature", root, notes)
    else:
        yield Feature("the geometry", {}, list(_shapes("the geometry", root)))


def _note_members(item: str, table: dict[str, Any], notes: Content) -> None:
    for key in sorted(table.keys() - MEMBERS):
        notes.note(f"member {key[:40]}", item)


def _feature(item: str, feature: dict[str, Any], notes: Content) -> Feature:
    if feature.get("type") != "Feature":
        raise FormatError(item, f"type = {as_word(feature.get('type'))!r}: must be Feature")
    raw = as_table(f"{item} properties", feature.get("properties") or {})
    stated = ((key, _text(value)) for key, value in raw.items() if value is not None)
    properties = properties_of(item, stated, notes)
    _note_members(item, feature, notes)
    geometry = feature.get("geometry")
    if geometry is None:
        notes.note("feature without a geometry", item)
        return Feature(item, properties)
    if _has_more(as_table(f"{item} geometry", geometry).get("coordinates")):
        notes.note("numbers of a position after its altitude", item)
    return Feature(item, properties, list(_shapes(item, geometry)))


def _has_more(at: Any) -> bool:
    """Return True if a position among coordinates has more than three numbers."""
    if not isinstance(at, list):
        return False
    inner = [each for each in at if isinstance(each, list)]
    return any(map(_has_more, inner)) if inner else len(at) > 3


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return str(value)[:1000]


def _shapes(item: str, geometry: dict[str, Any], depth: int = 0) -> Iterator[Shape]:
    kind, at = as_word(geometry.get("type")), geometry.get("coordinates")
    if kind not in GEOMETRIES:
        raise FormatError(item, f"type = {kind!r}: must be a geometry of GeoJSON")
    if depth > MAX_DEPTH:
        raise FormatError(item, f"geometry collections: must have at most {MAX_DEPTH} levels")
    if kind == "GeometryCollection":
        for index, inner in enumerate(as_list(f"{item} geometries", geometry.get("geometries")), 1):
            place = f"{item}, geometry {index}"
            yield from _shapes(place, as_table(place, inner), depth + 1)
    elif kind.startswith("Multi"):
        for index, part in enumerate(as_list(item, at), 1):
            yield _shape(f"{item}, part {index}", kind.removeprefix("Multi"), part)
    else:
        yield _shape(item, kind, at)


def _shape(item: str, kind: str, at: Any) -> Shape:
    if kind == "Point":
        return Shape(item, "point", [[_position(item, at)]])
    if kind == "LineString":
        return Shape(item, "line", [_positions(item, at)])
    return _polygon(item, at)


def _polygon(item: str, raw: Any) -> Shape:
    rings = [_positions(item, ring) for ring in as_list(item, raw)]
    if not rings:
        raise FormatError(item, "must be a polygon with at least one ring")
    return Shape(item, "polygon", rings)


def _positions(item: str, raw: Any) -> list[Position]:
    return [_position(f"{item}, point {index}", value) for index, value in enumerate(as_list(item, raw), 1)]


def _position(item: str, raw: Any) -> Position:
    """Return a position as latitude, longitude and altitude."""
    values = as_list(item, raw)
    if len(values) < 2:
        raise FormatError(item, "must be longitude and latitude")
    lon_deg, lat_deg = number(item, "longitude", values[0]), number(item, "latitude", values[1])
    check_lat_lon(item, lat_deg, lon_deg)
    return lat_deg, lon_deg, number(item, "altitude", values[2]) if len(values) > 2 and values[2] is not None else 0.0
