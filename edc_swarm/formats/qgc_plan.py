"""Plans of QGroundControl (`.plan`, JSON): mission, geofence and rally points."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from edc_swarm.errors import FormatError
from edc_swarm.formats.content import MAX_POINTS, Area, Content, Kind, Options, Point, Stop, check_lat_lon, number
from edc_swarm.formats.json_values import as_list, as_table, as_word, json_value
from edc_swarm.formats.mavlink_mission import LAND, WAYPOINT, Item, mission_content

RELATIVE = 3
FIXED_WING = 1
LANDING_PATTERNS = ("fwLandingPattern", "vtolLandingPattern")
PLAN_READ = frozenset({"fileType", "geoFence", "groundStation", "mission", "rallyPoints", "version"})
MISSION_READ = frozenset(
    {"cruiseSpeed", "firmwareType", "hoverSpeed", "items", "plannedHomePosition", "vehicleType", "version"}
    | {"globalPlanAltitudeMode"}
)
"""Members of a plan and of its mission that are read, or that say nothing about the flight."""
APPROACHES = ("landingApproachCoordinate", "loiterCoordinate")
"""Names of the point before the landing, newest first."""


def read_plan(data: bytes, options: Options) -> Content:
    """Return route and zones of a plan.

    Raises
    ------
    FormatError
    """
    plan = as_table("plan", json_value(data))
    if plan.get("fileType") != "Plan":
        raise FormatError("fileType", f"{as_word(plan.get('fileType'))!r}: must be 'Plan'")
    mission = as_table("mission", plan.get("mission", {}))
    notes = Content()
    items = list(_items(as_list("mission.items", mission.get("items", [])), notes))
    if len(items) > MAX_POINTS:
        raise FormatError("mission.items", f"{len(items)} items: must be at most {MAX_POINTS}")
    content = mission_content(items, _home(mission), options)
    for what, labels in notes.notes.items():
        content.note(what, *labels)
    content.areas += _fence(as_table("geoFence", plan.get("geoFence", {})), content)
    rally = as_list("rallyPoints.points", as_table("rallyPoints", plan.get("rallyPoints", {})).get("points", []))
    for index in range(1, len(rally) + 1):
        content.note("rally point", f"rally point {index}")
    for place, table, read in (("plan", plan, PLAN_READ), ("mission", mission, MISSION_READ)):
        for key in sorted(table.keys() - read):
            content.note(f"member {key[:40]}", place)
    _set_speed(content, mission)
    return content


def _set_speed(content: Content, mission: dict[str, Any]) -> None:
    """Set the largest speed of the UAV: the plan's speed for its kind of vehicle."""
    key = "cruiseSpeed" if mission.get("vehicleType") == FIXED_WING else "hoverSpeed"
    speed = mission.get(key)
    if speed is not None and content.routes:
        (route,) = content.routes
        content.routes = [route.with_speed(number(f"mission.{key}", "speed", speed))]


def _home(mission: dict[str, Any]) -> Stop | None:
    place = "mission.plannedHomePosition"
    home = mission.get("plannedHomePosition")
    if not home:
        return None
    point = _point(place, home)
    return Stop("planned home", point) if any(point) else None


def _items(raw: list[Any], content: Content) -> Iterator[Item]:
    """Yield the items of the mission, those of patterns too."""
    for index, value in enumerate(raw, 1):
        label = f"item {index}"
        item = as_table(label, value)
        kind = as_word(item.get("type", "SimpleItem"))
        if kind in {"SimpleItem", "missionItem"}:
            yield _simple(label, item)
        elif kind == "ComplexItem":
            yield from _pattern(label, item, content)
        else:
            raise FormatError(label, f"type = {kind!r}: must be SimpleItem or ComplexItem")


def _simple(label: str, item: dict[str, Any], *, simple: bool = True) -> Item:
    raw = item.get("params")
    if raw is None:
        raw = [item.get(f"param{which}") for which in range(1, 5)]
    if "coordinate" in item:  # Plans of 2016 and 2017 hold the position apart from the other parameters.
        raw = as_list(f"{label} params", raw)[:4] + as_list(f"{label} coordinate", item["coordinate"])
    params = as_list(f"{label} params", raw)
    if len(params) != 7:
        raise FormatError(label, f"{len(params)} params: must be 7")
    one, two, three, four, x, y, z = (
        None if value is None else number(label, f"params[{index}]", value) for index, value in enumerate(params)
    )
    goes_on = item.get("autoContinue", True) is not False
    command, frame = _whole(label, item, "command"), _whole(label, item, "frame")
    return Item(label, command, frame, (one, two, three, four), x, y, z, goes_on=goes_on, simple=simple)


def _whole(label: str, item: dict[str, Any], key: str) -> int:
    value = number(label, key, item.get(key))
    if value != int(value):
        raise FormatError(label, f"{key} = {value:g}: must be a whole number")
    return int(value)


def _pattern(label: str, item: dict[str, Any], content: Content) -> Iterator[Item]:
    """Yield the items that the ground station has made from a pattern; note a pattern of which it stores none."""
    kind = as_word(item.get("complexItemType"))
    transects = as_table(label, item.get("TransectStyleComplexItem", item))
    inner = transects.get("Items")
    if kind in LANDING_PATTERNS:
        yield from _landing(label, item)
    elif inner:
        content.note(f"pattern {kind}: its stored items are flown", label)
        for index, value in enumerate(as_list(f"{label} Items", inner), 1):
            place = f"{label}.{index}"
            yield _simple(place, as_table(place, value), simple=False)
    elif points := as_list(f"{label} VisualTransectPoints", transects.get("VisualTransectPoints", [])):
        content.note(f"pattern {kind}: the transects that it shows are flown", label)
        for index, point in enumerate(points, 1):
            yield _made(f"{label}.{index}", WAYPOINT, point)
    else:
        content.note(f"pattern {kind}: the plan stores no way points of it", label)


def _landing(label: str, item: dict[str, Any]) -> Iterator[Item]:
    approach = next((item[key] for key in APPROACHES if item.get(key)), None)
    if approach is not None:
        yield _made(f"{label}.1", WAYPOINT, approach)
    yield _made(f"{label}.2", LAND, item.get("landCoordinate"))


def _made(label: str, command: int, point: Any) -> Item:
    lat_deg, lon_deg = _point(label, point)
    height = number(label, "altitude", point[2]) if len(point) > 2 and point[2] is not None else None
    return Item(label, command, RELATIVE, (None, None, None, None), lat_deg, lon_deg, height, simple=False)


def _point(place: str, value: Any) -> Point:
    pair = as_list(place, value)
    if len(pair) < 2:
        raise FormatError(place, "must be latitude and longitude")
    return check_lat_lon(place, number(place, "latitude", pair[0]), number(place, "longitude", pair[1]))


def _fence(fence: dict[str, Any], content: Content) -> list[Area]:
    areas: list[Area] = []
    for index, value in enumerate(as_list("geoFence.polygons", fence.get("polygons", [])), 1):
        place = f"geofence polygon {index}"
        polygon = as_table(place, value)
        corners = as_list(place, polygon.get("polygon"))
        areas.append(Area(place, "", _kind(place, polygon), [_point(place, corner) for corner in corners]))
    for index, value in enumerate(as_list("geoFence.circles", fence.get("circles", [])), 1):
        place = f"geofence circle {index}"
        outer = as_table(place, value)
        circle = as_table(place, outer.get("circle"))
        radius_m = number(place, "radius", circle.get("radius"))
        centre = _point(place, circle.get("center"))
        areas.append(Area(place, "", _kind(place, outer), centre=centre, radius_m=radius_m))
    old = fence.get("polygon")
    if old:  # Plans of 2016 and 2017 have one polygon, which is an inclusion.
        corners = as_list("geoFence.polygon", old)
        areas.append(Area("geofence polygon", "", "inclusion", [_point("geofence polygon", c) for c in corners]))
    if fence.get("breachReturn"):
        content.note("return point of the fence", "breachReturn")
    return areas


def _kind(place: str, table: dict[str, Any]) -> Kind:
    inclusion = table.get("inclusion")
    if not isinstance(inclusion, bool):
        raise FormatError(place, "inclusion: must be true or false")
    return "inclusion" if inclusion else "exclusion"
