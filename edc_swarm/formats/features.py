"""Points, lines and polygons with properties, as KML and GeoJSON hold them, read as routes and zones."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Literal

from edc_swarm.errors import FormatError
from edc_swarm.formats.content import (
    KIND_NOT_STATED,
    MAX_POINTS,
    Area,
    Content,
    Kind,
    Options,
    Point,
    Route,
    Stop,
    check_lat_lon,
    parsed,
)

ONE_PER_UAV = ("accept_m", "v_max_mps", "r_m")
"""Properties of which a route takes one value."""
READ = {
    "line": frozenset({"name", "uav", *ONE_PER_UAV}),
    "point": frozenset({"name", "kind", "uav", "hover_s", *ONE_PER_UAV}),
    "polygon": frozenset({"name", "kind", "keep"}),
    "circle": frozenset({"name", "kind", "keep", "radius_m"}),
}
"""Properties that a mission expresses, by what has them."""
ZONE_KINDS: dict[str, Kind] = {
    **dict.fromkeys(("inclusion", "include", "fence", "geofence", "boundary", "keep-in"), "inclusion"),
    **dict.fromkeys(("exclusion", "exclude", "no-fly", "nofly", "obstacle", "keep-out"), "exclusion"),
}
KIND_NAMES = ("kind", "type", "role")
"""Names of the property that states a kind, the first one of a feature counts."""
POINT_KINDS = ("start", "waypoint", "target")
"""Kinds of points that are part of a route, in the order in which they are flown."""


@dataclass(frozen=True, slots=True)
class Shape:
    """One geometry: rings of (latitude, longitude, altitude); points and lines have one ring."""

    item: str
    kind: Literal["point", "line", "polygon"]
    rings: list[list[tuple[float, float, float]]]


@dataclass(frozen=True, slots=True)
class Feature:
    """Shapes with common properties, the names of which are in small letters."""

    item: str
    properties: dict[str, str]
    shapes: list[Shape] = field(default_factory=list)

    @property
    def kind(self) -> str:
        """The property `kind`, in small letters, with "-" between words."""
        return self.properties.get("kind", "").strip().lower().replace("_", "-").replace(" ", "-")

    def number(self, name: str) -> float:
        """Return a property as a number, 0 if it is absent."""
        text = self.properties.get(name, "")
        return parsed(self.item, name, text) if text.strip() else 0.0


def properties_of(item: str, stated: Iterable[tuple[str, str]], notes: Content) -> dict[str, str]:
    """Return properties by their names in small letters; note those that another one of the same meaning hides.

    Raises
    ------
    FormatError
        One name is there twice.
    """
    pairs = sorted(stated, key=lambda pair: KIND_NAMES.index(pair[0].lower()) if pair[0].lower() in KIND_NAMES else 0)
    names, properties = set[str](), dict[str, str]()
    for name, value in pairs:
        if name in names:
            raise FormatError(item, f"property {name[:40]!r}: must be there once")
        names.add(name)
        key = "kind" if name.lower() in KIND_NAMES else name.lower()
        if key in properties:
            notes.note(f"property {name[:40]} beside another {key[:40]}", item)
        properties.setdefault(key, value)
    return properties


def features_content(features: Sequence[Feature], notes: Content, options: Options) -> Content:
    """Return lines as routes, polygons and points with a radius as zones, and other points as way points of one route.

    Points are flown if they state `uav` or their `kind`, or if the file has no line. `notes` has what the reader has
    noted; it comes last among the notes.

    Raises
    ------
    FormatError
    """
    count = sum(len(ring) for feature in features for shape in feature.shapes for ring in shape.rings)
    if count > MAX_POINTS:
        raise FormatError("", f"{count} points: must be at most {MAX_POINTS}")
    content = Content()
    has_lines = any(shape.kind == "line" for feature in features for shape in feature.shapes)
    way_points: dict[str, list[tuple[Feature, Shape]]] = {}
    for feature in features:
        for shape in feature.shapes:
            _note_altitudes(shape, content)
            is_circle = shape.kind == "point" and "radius_m" in feature.properties
            _note_properties(feature, shape.item, READ["circle" if is_circle else shape.kind], content)
            if shape.kind == "polygon":
                content.areas += _polygon(feature, shape, content, options)
            elif shape.kind == "line":
                content.routes.append(_line(feature, shape))
            elif is_circle:
                content.areas.append(_circle(feature, shape, options))
            elif feature.kind == "home":
                content.home = _home(shape, content)
            elif feature.kind in POINT_KINDS or "uav" in feature.properties or (not feature.kind and not has_lines):
                way_points.setdefault(feature.properties.get("uav", ""), []).append((feature, shape))
            else:
                content.note(f"point of kind {feature.kind!r}" if feature.kind else "point beside lines", shape.item)
    content.routes += [_through(uav, found, content) for uav, found in way_points.items()]
    for what, items in notes.notes.items():
        content.note(what, *items)
    return content


def _note_properties(feature: Feature, item: str, read: frozenset[str], content: Content) -> None:
    for key, value in feature.properties.items():
        if key not in read and value.strip():
            content.note(f"property {key}", item)


def _note_altitudes(shape: Shape, content: Content) -> None:
    if any(height for ring in shape.rings for _, _, height in ring):
        content.note("altitude: the mission is flown in a plane", shape.item)


def _points(shape: Shape, ring: int = 0) -> list[Point]:
    return [check_lat_lon(shape.item, lat_deg, lon_deg) for lat_deg, lon_deg, _ in shape.rings[ring]]


def _home(shape: Shape, content: Content) -> Point:
    if content.home is not None:
        raise FormatError(shape.item, "kind = 'home': must be that of one point")
    (home,) = _points(shape)
    return home


def _line(feature: Feature, shape: Shape) -> Route:
    if feature.kind in ZONE_KINDS:
        raise FormatError(shape.item, f"kind = {feature.kind!r}: must be that of a polygon, not of a line")
    stops = [Stop(f"{shape.item}, point {index}", point) for index, point in enumerate(_points(shape), 1)]
    if len(stops) < 2:
        raise FormatError(shape.item, f"{len(stops)} points of a line: must be at least 2")
    return _route(shape.item, stops, feature)


def _through(uav: str, found: list[tuple[Feature, Shape]], content: Content) -> Route:
    """Return the route through points: starts first, targets last, the others in the order of the file."""

    def order(pair: tuple[Feature, Shape]) -> int:
        return POINT_KINDS.index(pair[0].kind) if pair[0].kind in POINT_KINDS else 1

    for kind in ("start", "target"):
        ends = [shape for feature, shape in found if feature.kind == kind]
        if len(ends) > 1:
            raise FormatError(ends[1].item, f"kind = {kind!r}: must be that of one point of a UAV")
    flown = sorted(found, key=order)
    for key in ONE_PER_UAV:
        if len({feature.number(key) for feature, _ in flown}) > 1:
            what = f"{key} that differs between the points of a UAV: the first one counts"
            content.note(what, *(shape.item for _, shape in flown))
    stops = [Stop(shape.item, point, feature.number("hover_s")) for feature, shape in flown for point in _points(shape)]
    return _route(f"{flown[0][1].item} to {flown[-1][1].item}", stops, flown[0][0], uav)


def _route(item: str, stops: list[Stop], feature: Feature, uav: str = "") -> Route:
    return Route(
        item,
        stops,
        uav=uav or feature.properties.get("uav", ""),
        accept_m=feature.number("accept_m"),
        v_max_mps=feature.number("v_max_mps"),
        r_m=feature.number("r_m"),
    )


def _polygon(feature: Feature, shape: Shape, content: Content, options: Options) -> list[Area]:
    """Return the zone of a polygon. Holes of an inclusion are exclusion zones; holes of an exclusion are closed."""
    kind, why = _zone_kind(feature, options)
    name, keep = feature.properties.get("name", ""), _keep(feature)
    areas = [Area(shape.item, name, kind, _points(shape), keep=keep, why=why)]
    for ring in range(1, len(shape.rings)):
        if kind == "exclusion":
            content.note("hole of an exclusion zone: it is closed", shape.item)
        else:
            hole = f"{name} hole" if name else ""
            areas.append(
                Area(f"{shape.item}, hole {ring}", hole, "exclusion", _points(shape, ring), keep=keep or "centre")
            )
    return areas


def _circle(feature: Feature, shape: Shape, options: Options) -> Area:
    kind, why = _zone_kind(feature, options)
    (centre,) = _points(shape)
    name, radius_m = feature.properties.get("name", ""), feature.number("radius_m")
    return Area(shape.item, name, kind, centre=centre, radius_m=radius_m, keep=_keep(feature), why=why)


def _keep(feature: Feature) -> str:
    keep = feature.properties.get("keep", "")
    if keep not in {"", "disc", "centre"}:
        raise FormatError(feature.item, f"keep = {keep[:40]!r}: must be disc or centre")
    return keep


def _zone_kind(feature: Feature, options: Options) -> tuple[Kind, str]:
    """Return the kind of a zone, and why if the file does not state it: by its name, or else by the option.

    The option says exclusion by default: a fence that is taken for a no-fly zone is noticed before anybody flies.
    """
    if feature.kind in ZONE_KINDS:
        return ZONE_KINDS[feature.kind], ""
    if feature.kind:
        raise FormatError(feature.item, f"kind = {feature.kind[:40]!r}: must be inclusion or exclusion")
    name = feature.properties.get("name", "").lower().replace("_", "-").replace(" ", "-")
    named = {kind for word, kind in ZONE_KINDS.items() if word in name}
    if len(named) == 1:
        return named.pop(), "its name says so"
    return options.polygons, KIND_NOT_STATED[options.polygons]
