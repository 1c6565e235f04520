"""One mission out of the content of several files: one plane, names, radii, and what cannot be flown refused."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import msgspec
import numpy as np

from edc_swarm.errors import FormatError
from edc_swarm.foreign_text import shown
from edc_swarm.formats.content import KIND_NOT_STATED, Area, Point, Route, Stop, ranges
from edc_swarm.formats.flyable import Flight, flyable, most_uavs
from edc_swarm.formats.plane_checks import legs_through
from edc_swarm.formats.registry import Source
from edc_swarm.geodesy import from_wgs84, to_wgs84
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.field_types import MAX_ALL_CORNERS, MAX_CORNERS, MAX_ROUTE, MAX_UAVS, MAX_ZONES, MOST_M
from edc_swarm.mission.polygons import polygon_fault
from edc_swarm.mission.roles import RESERVED_IDS
from edc_swarm.mission.roster_entry import ARRIVED_M
from edc_swarm.mission.zone import Zone

MOST_AWAY_M = 200_000.0
"""Largest distance from the origin: up to there, the plane of the mission is true to 0.02 %."""
LEAST_OUT_M = 50.0
"""Least room round exclusion zones in the area of a mission without routes and fence."""
SAME_M = 0.01
"""Successive points of a route closer than this are one point."""
_ID = re.compile(r"[A-Za-z0-9_-]{1,32}")


@dataclass(frozen=True, slots=True)
class Settings:
    """The user's choices for the mission; None stands for what the files say, or else for the default."""

    name: str = "imported"
    origin: Point | None = None
    r_m: float | None = None
    v_max_mps: float | None = None
    dt_s: float | None = None
    start_at_home: bool = True


@dataclass(slots=True)
class Imported:
    """A mission made of files, as plain data.

    Attributes
    ----------
    mission
        Keys and values of a mission file.
    places
        File and item of each table, by its key and its index, such as ("zone", 0).
    notes
        What the mission does not express, by file and then by what it is, with the items that hold it.
    remarks
        What else the user should know.
    zones
        File and item of each zone, by its index.
    flown
        The mission with everything that it leaves to be derived.
    """

    mission: dict[str, Any]
    places: dict[tuple[str, int], str] = field(default_factory=dict)
    notes: dict[str, dict[str, list[str]]] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)
    zones: dict[int, tuple[str, str]] = field(default_factory=dict)
    flown: Mission = field(default_factory=Mission)


def assemble(sources: Sequence[Source], settings: Settings) -> Imported:
    """Return the mission of all sources together.

    Raises
    ------
    FormatError
        With file, item and what it must be: neither a route nor a zone, frames that do not fit together, a zone that is
        no simple polygon, discs that overlap, a way point that a zone forbids, more than a mission may hold.
    """
    if not any(source.content.routes or source.content.areas for source in sources):
        raise FormatError("", "neither a route nor a zone: must hold one of them", sources[0].file)
    notes = {source.file: {what: list(items) for what, items in source.content.notes.items()} for source in sources}
    imported = Imported({"name": settings.name}, notes=notes)
    plane = _Plane.of(sources, settings)
    flights = _flights(sources, settings, plane, imported)
    if not flights:
        plane = _fit_area(sources, settings, plane, imported)
    zones = _zones(sources, plane, imported)
    mission = imported.mission
    if plane.origin is not None:
        mission["origin_lat_deg"], mission["origin_lon_deg"] = plane.origin
    radii_m = _set_sizes(flights, settings, imported)
    mission["zone"] = [_plain(zone) for zone in zones]
    mission["roster"] = [_entry(flight, r_m, mission, settings) for flight, r_m in zip(flights, radii_m, strict=True)]
    for index, flight in enumerate(flights):
        imported.places["roster", index] = f"{flight.file}, {flight.route.item}"
    if not flights:
        mission["uavs"] = most_uavs(mission)
        drawn = f"no file holds a route: the mission draws its UAVs ({mission['uavs']}) at random in its area"
        imported.remarks.append(drawn)
    try:
        imported.flown, warnings = flyable(mission, flights, imported.zones)
    except FormatError as error:
        why = KIND_NOT_STATED["exclusion"]
        areas = [area for source in sources for area in source.content.areas]
        for zone, area in zip(zones, areas, strict=True):
            if area.why == why and f"exclusion zone {zone.name!r}" in error.reason:
                raise FormatError(error.item, f"{error.reason} ({area.item}: {why})", error.file) from None
        raise
    imported.remarks += warnings
    _remark_on_bends(flights, radii_m, zones, imported)
    return imported


@dataclass(frozen=True, slots=True)
class _Plane:
    """The plane of the mission, about its origin; without one, all files are local."""

    origin: Point | None

    @classmethod
    def of(cls, sources: Sequence[Source], settings: Settings) -> _Plane:
        """Return the plane about the option's origin, or else about the first home, or else about the first point."""
        earthly = [source for source in sources if source.content.frame == "wgs84"]
        local = [source for source in sources if source.content.frame == "local"]
        origin = settings.origin
        if origin is None and earthly and local:
            message = "positions in metres beside latitudes and longitudes: must be in one frame (or give --origin)"
            raise FormatError("", message, local[0].file)
        if origin is None:
            homes = [source.content.home for source in earthly if source.content.home is not None]
            found = next(iter([*homes, *(point for source in earthly for point in _located(source))]), None)
            if found is None:
                homes = [source.content.home for source in local if source.content.home is not None]
                found = homes[0] if homes else None
            origin = found
        if origin is not None and not abs(origin[0]) <= 89:
            raise FormatError("", f"latitude of the origin = {origin[0]:g}: must be from -89 to 89", sources[0].file)
        return cls(origin)

    def metres(self, source: Source, item: str, point: Point) -> Point:
        """Return a point of a file in metres, to the millimetre."""
        if source.content.frame == "local":
            x_m, y_m = point
            if max(abs(x_m), abs(y_m)) > MOST_M:
                raise FormatError(item, f"({x_m:g}, {y_m:g}) m: must be within {MOST_M:g} m of the origin", source.file)
        else:
            assert self.origin is not None, "a file in degrees has a point, or its points are never converted"
            x_m, y_m = from_wgs84(*point, *self.origin)
            if math.hypot(x_m, y_m) > MOST_AWAY_M:
                far = f"({point[0]:g}, {point[1]:g}) is {math.hypot(x_m, y_m) / 1000:.0f} km from the origin"
                raise FormatError(item, f"{far}: must be at most {MOST_AWAY_M / 1000:g} km (see --origin)", source.file)
        return round(x_m, 3) + 0.0, round(y_m, 3) + 0.0


def _fit_area(sources: Sequence[Source], settings: Settings, plane: _Plane, imported: Imported) -> _Plane:
    """Fit the area, in which a mission without routes draws its UAVs, to the zones; return the plane.

    The area has a corner at the origin. So the origin becomes the south-west corner of the area, unless the user or a
    file in metres states it.
    """
    west_m, south_m, east_m, north_m = _area_m(
        [(source, area) for source in sources for area in source.content.areas], plane
    )
    stated = settings.origin is not None or any(source.content.frame == "local" for source in sources)
    if not stated and plane.origin is not None:
        plane = _Plane(to_wgs84(west_m, south_m, *plane.origin))
        east_m, north_m = east_m - west_m, north_m - south_m
    if min(east_m, north_m) > 0:
        imported.mission["area_x_m"], imported.mission["area_y_m"] = round(east_m, 3), round(north_m, 3)
    return plane


def _area_m(areas: Sequence[tuple[Source, Area]], plane: _Plane) -> tuple[float, float, float, float]:
    """Return (west, south, east, north) of the rectangle that all inclusion zones touch, or else of one round all."""
    boxes_m = {
        kind: [_box_m(*each, plane) for each in areas if each[1].kind == kind] for kind in ("inclusion", "exclusion")
    }
    if found := boxes_m["inclusion"]:
        west_m, south_m, east_m, north_m = zip(*found, strict=True)
        return max(west_m), max(south_m), min(east_m), min(north_m)
    if not (found := boxes_m["exclusion"]):
        return 0.0, 0.0, 0.0, 0.0
    west_m, south_m, east_m, north_m = zip(*found, strict=True)
    x_m, y_m = max(east_m) - min(west_m), max(north_m) - min(south_m)
    out_m = max(x_m / 2, y_m / 2, LEAST_OUT_M)
    return min(west_m) - out_m, min(south_m) - out_m, max(east_m) + out_m, max(north_m) + out_m


def _box_m(source: Source, area: Area, plane: _Plane) -> tuple[float, float, float, float]:
    """Return the sides (west, south, east, north) of a zone in metres."""
    corners = [plane.metres(source, area.item, point) for point in area.polygon or [area.centre or (0.0, 0.0)]]
    xs_m, ys_m = zip(*corners, strict=True)
    out_m = area.radius_m if area.centre is not None else 0.0
    return min(xs_m) - out_m, min(ys_m) - out_m, max(xs_m) + out_m, max(ys_m) + out_m


def _located(source: Source) -> Iterator[Point]:
    for route in source.content.routes:
        if route.home is not None:
            yield route.home.point
        yield from (stop.point for stop in route.stops if not stop.at_home)
    for area in source.content.areas:
        yield from area.polygon
        if area.centre is not None:
            yield area.centre


def _flights(sources: Sequence[Source], settings: Settings, plane: _Plane, imported: Imported) -> list[Flight]:
    found = [(source, route) for source in sources for route in source.content.routes]
    if len(found) > MAX_UAVS:
        raise FormatError("", f"{len(found)} routes: must be at most {MAX_UAVS}", sources[0].file)
    taken: dict[str, str] = {}
    flights = []
    for source, route in found:
        uav = _stated_id(source, route, taken, imported)
        flights.append(Flight(source.file, uav, route, _flown(source, route, settings, plane, imported)))
    for index, flight in enumerate(flights):
        if not flight.uav:
            uav = next(name for number in range(1, 2 * MAX_UAVS) if (name := f"u{number:03d}") not in taken)
            taken[uav] = flight.file
            flights[index] = replace(flight, uav=uav)
    return flights


def _stated_id(source: Source, route: Route, taken: dict[str, str], imported: Imported) -> str:
    """Return the id that the file states, "" if it states none or one that no UAV may have."""
    if not route.uav:
        return ""
    if not _ID.fullmatch(route.uav) or route.uav in RESERVED_IDS:
        _add(imported, source, f"UAV {shown(route.uav, 40)!r}: not an id, so it has another one", route.item)
        return ""
    if route.uav in taken:
        raise FormatError(route.item, f"uav = {route.uav!r}: must be an id that no other route has", source.file)
    taken[route.uav] = source.file
    return route.uav


def _add(imported: Imported, source: Source, what: str, *items: str) -> None:
    imported.notes[source.file].setdefault(what, []).extend(items)


def _flown(source: Source, route: Route, settings: Settings, plane: _Plane, imported: Imported) -> list[Stop]:
    """Return the stops of a route in metres, the start first, equal neighbours as one."""
    begins_at_home = route.home is not None and settings.start_at_home
    stops = [route.home, *route.stops] if route.home is not None and begins_at_home else list(route.stops)
    if not begins_at_home and route.home is not None and any(stop.at_home for stop in stops):
        _add(imported, source, "return to home: the UAV returns to its first way point", route.item)
    first = next((stop for stop in stops if not stop.at_home), None)
    if first is None:
        raise FormatError(route.item, "must hold a position", source.file)
    if len(stops) > MAX_ROUTE:
        raise FormatError(route.item, f"{len(stops)} points: must be at most {MAX_ROUTE}", source.file)
    flown: list[Stop] = []
    for stop in stops:
        point = plane.metres(source, stop.item, first.point if stop.at_home else stop.point)
        if not 0 <= stop.hover_s <= 1e6:
            raise FormatError(stop.item, f"time to hover = {stop.hover_s:g} s: must be from 0 to 1e6", source.file)
        if flown and math.dist(flown[-1].point, point) <= SAME_M:
            flown[-1] = replace(flown[-1], hover_s=flown[-1].hover_s + stop.hover_s)
        else:
            flown.append(Stop(stop.item, point, stop.hover_s))
    return flown


def _zones(sources: Sequence[Source], plane: _Plane, imported: Imported) -> list[Zone]:
    zones: list[Zone] = []
    names: set[str] = set()
    for source in sources:
        for area in source.content.areas:
            zones.append(_zone(source, area, plane, _free_name(area.name or f"zone {len(zones) + 1}", names)))
            why = f" ({area.why})" if area.why else ""
            imported.places["zone", len(zones) - 1] = f"{source.file}, {area.item}{why}"
            imported.zones[len(zones) - 1] = source.file, area.item
            if area.why:
                name = f" ({area.name!r})" if area.name else ""
                imported.remarks.append(f"{source.file}: {area.item}{name}: read as {area.kind} zone: {area.why}")
    if len(zones) > MAX_ZONES:
        raise FormatError("", f"{len(zones)} zones: must be at most {MAX_ZONES}", sources[-1].file)
    if (corners := sum(zone.corners for zone in zones)) > MAX_ALL_CORNERS:
        message = f"{corners} corners in all zones: must be at most {MAX_ALL_CORNERS}"
        raise FormatError("", message, sources[-1].file)
    inclusions = [zone.name for zone in zones if zone.kind == "inclusion"]
    if len(inclusions) > 1:
        imported.remarks.append(f"{len(inclusions)} inclusion zones: every UAV must be inside all of them")
    return zones


def _free_name(wanted: str, names: set[str]) -> str:
    """Return a printable name of at most 64 characters that no other zone has."""
    plain = "".join(letter if letter.isprintable() else " " for letter in wanted).strip()[:56] or "zone"
    name = next(
        each for number in range(1, MAX_ZONES + 2) if (each := f"{plain} {number}" * (number > 1) or plain) not in names
    )
    names.add(name)
    return name


def _zone(source: Source, area: Area, plane: _Plane, name: str) -> Zone:
    keep: Any = area.keep
    if area.centre is not None:
        if not 0 < area.radius_m <= MOST_AWAY_M:
            raise FormatError(area.item, f"radius = {area.radius_m:g} m: must be above 0 m", source.file)
        centre = list(plane.metres(source, area.item, area.centre))
        return Zone(name=name, kind=area.kind, centre=centre, radius_m=round(area.radius_m, 3), keep=keep)
    corners: list[Point] = []
    for point in area.polygon:
        corner = plane.metres(source, area.item, point)
        if not corners or corner != corners[-1]:
            corners.append(corner)
    if len(corners) > 1 and corners[0] == corners[-1]:
        corners.pop()
    if len(corners) > MAX_CORNERS:
        raise FormatError(area.item, f"{len(corners)} corners: must be at most {MAX_CORNERS}", source.file)
    if fault := polygon_fault(corners):
        raise FormatError(area.item, f"{fault}: must be a simple polygon", source.file)
    return Zone(name=name, kind=area.kind, polygon=corners, keep=keep)


def _set_sizes(flights: Sequence[Flight], settings: Settings, imported: Imported) -> list[float]:
    """Set radius, speed and slot of the mission, and return the radius of each UAV in metres."""
    mission = imported.mission
    stated_m = {flight.route.r_m for flight in flights if flight.route.r_m}
    stated_mps = {flight.route.v_max_mps for flight in flights if flight.route.v_max_mps}
    default = Mission()
    r_m = settings.r_m or (max(stated_m) if stated_m else default.r_m)
    v_max_mps = settings.v_max_mps or (max(stated_mps) if stated_mps else default.v_max_mps)
    radii_m = [settings.r_m or flight.route.r_m or r_m for flight in flights]
    for flight, radius_m in zip(flights, radii_m, strict=True):
        if not 0 < radius_m <= MOST_AWAY_M:
            raise FormatError(flight.route.item, f"r_m = {radius_m:g}: must be above 0", flight.file)
        if not 0 <= flight.route.v_max_mps <= 1e4:
            raise FormatError(
                flight.route.item, f"speed = {flight.route.v_max_mps:g} m/s: must be from 0 to 1e4", flight.file
            )
        if not 0 <= flight.route.accept_m <= MOST_AWAY_M:
            raise FormatError(
                flight.route.item, f"acceptance radius = {flight.route.accept_m:g} m: must be at least 0", flight.file
            )
    mission["r_m"], mission["v_max_mps"] = r_m, v_max_mps
    least_m = min([r_m, *radii_m])
    if least_m < default.body_m:
        mission["body_m"] = least_m
        imported.remarks.append(f"body_m = {least_m:g}: a body is at most as large as the least disc")
    mission["dt_s"] = settings.dt_s or default.dt_s
    if settings.dt_s is None and v_max_mps * default.dt_s > least_m:
        mission["dt_s"] = max(0.02, math.floor(100 * least_m / v_max_mps) / 100)
        imported.remarks.append(f"dt_s = {mission['dt_s']:g}: no step is longer than the radius of a disc")
    return radii_m


def _remark_on_bends(
    flights: Sequence[Flight], radii_m: Sequence[float], zones: list[Zone], imported: Imported
) -> None:
    """Remark on legs that have to go round a zone."""
    bent: dict[str, list[str]] = {}
    for flight, r_m in zip(flights, radii_m, strict=True):
        legs = np.flatnonzero(legs_through(zones, np.array([stop.point for stop in flight.stops]), r_m))
        bent.setdefault(flight.file, []).extend(flight.stops[int(leg) + 1].item for leg in legs)
    for file, items in bent.items():
        if items:
            imported.remarks.append(f"{file}: UAVs fly round zones on the legs to {ranges(items)}")


def _plain(zone: Zone) -> dict[str, Any]:
    """Return the fields of a zone that differ from their defaults."""
    plain: dict[str, Any] = msgspec.to_builtins(zone)
    return {key: value for key, value in plain.items() if value not in ("", [], 0.0)}


def _entry(flight: Flight, r_m: float, mission: dict[str, Any], settings: Settings) -> dict[str, Any]:
    """Return the roster entry of a flight: a target where it is straight, else a route."""
    first, *rest = flight.stops
    if first.hover_s or not rest:
        rest = flight.stops
    entry: dict[str, Any] = {"uav": flight.uav, "start_x_m": first.point[0], "start_y_m": first.point[1]}
    hover_s = [stop.hover_s for stop in rest]
    if len(rest) == 1 and not any(hover_s):
        entry["target_x_m"], entry["target_y_m"] = rest[0].point
    else:
        entry["route"] = [list(stop.point) for stop in rest]
        if any(hover_s):
            entry["hover_s"] = hover_s
        if flight.route.accept_m and len(rest) > 1:
            entry["accept_m"] = max(flight.route.accept_m, ARRIVED_M)
    if r_m != mission["r_m"]:
        entry["r_m"] = r_m
    v_max_mps = settings.v_max_mps or flight.route.v_max_mps or mission["v_max_mps"]
    if v_max_mps != mission["v_max_mps"]:
        entry["v_max_mps"] = v_max_mps
    return entry
