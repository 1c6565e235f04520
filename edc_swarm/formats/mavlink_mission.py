"""The items of a MAVLink mission as a route in the plane, and as zones."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from edc_swarm.errors import FormatError
from edc_swarm.formats.content import Area, Content, Kind, Options, Point, Route, Stop, check_lat_lon
from edc_swarm.formats.mavlink_commands import COMMANDS

WAYPOINT, UNLIMITED, TURNS, LOITER, TO_HOME, LAND, TAKEOFF, TO_ALTITUDE = 16, 17, 18, 19, 20, 21, 22, 31
ARC, SPLINE, VTOL_TAKEOFF, VTOL_LAND, DELAY, PAYLOAD, SPEED = 36, 82, 84, 85, 93, 94, 178
STRAIGHTENED = {ARC: "arcs: legs are straight", SPLINE: "splines: legs are straight"}
VERTICAL = {LAND, TAKEOFF, VTOL_TAKEOFF, VTOL_LAND}
AT_A_PLACE = {WAYPOINT, UNLIMITED, TURNS, LOITER, TO_ALTITUDE, PAYLOAD, *STRAIGHTENED, *VERTICAL}
"""Commands that fly to the position that they state."""
ENDS = {TO_HOME, UNLIMITED}
"""Commands after which an autopilot flies no further item."""
HAVE_HOLD = {WAYPOINT, SPLINE, LOITER}
"""Commands whose first parameter is a time to stay, in seconds."""
FENCE_RETURN, RALLY = 5000, 5100
FENCE_POLYGONS: dict[int, Kind] = {5001: "inclusion", 5002: "exclusion"}
FENCE_CIRCLES: dict[int, Kind] = {5003: "inclusion", 5004: "exclusion"}

ALTITUDES = {0: "above sea level", 5: "above sea level", 3: "above home", 6: "above home"} | dict.fromkeys(
    (10, 11), "above the terrain"
)
"""The global frames, and what their altitudes count from."""
LOCAL_NED, LOCAL_ENU = 1, 4


@dataclass(frozen=True, slots=True)
class Item:
    """One item of a MAVLink mission; None stands for a value that the file leaves to the vehicle (NaN).

    `simple` is False for an item that the ground station has made from a pattern, such as a survey.
    """

    label: str
    command: int
    frame: int
    params: tuple[float | None, float | None, float | None, float | None]
    x: float | None
    y: float | None
    z: float | None
    goes_on: bool = True
    simple: bool = True

    @property
    def name(self) -> str:
        """Name of the command."""
        return COMMANDS.get(self.command, f"command {self.command}")

    @property
    def nowhere(self) -> bool:
        """True if the item stands for the vehicle's present position."""
        return not self.x and not self.y


def mission_content(items: Sequence[Item], home: Stop | None, options: Options) -> Content:
    """Return route and zones of the items, in their order.

    Raises
    ------
    FormatError
        A command is unknown, a position is impossible, or frames do not fit together.
    """
    content = Content(home=home.point if home else None)
    known = [item for item in items if _is_known(item, content, options)]
    flown = [item for item in known if item.command in AT_A_PLACE]
    content.frame = "local" if _are_local(flown) else "wgs84"
    if not options.mixed_altitudes:
        _check_altitudes(flown)
    content.areas += _zones(known, content)
    if stops := _stops(known, home, content):
        # A file in a local frame starts at its first way point: its home is a point of the Earth.
        start = home if content.frame == "wgs84" else None
        items_flown = f"{stops[0].item} to {stops[-1].item}"
        content.routes.append(Route(items_flown, stops, home=start, accept_m=_acceptance_m(flown, content)))
    return content


def _is_known(item: Item, content: Content, options: Options) -> bool:
    if item.command in COMMANDS:
        return True
    if not options.list_unknown:
        raise FormatError(
            item.label, f"command = {item.command}: must be a known MAVLink command (or give --list-unknown)"
        )
    content.note(f"unknown MAVLink command {item.command}", item.label)
    return False


def _are_local(flown: Sequence[Item]) -> bool:
    """Return True if all positions are local; raise `FormatError` if some are global, or relative to the vehicle."""
    for item in flown:
        if item.frame not in {*ALTITUDES, LOCAL_NED, LOCAL_ENU}:
            raise FormatError(item.label, f"frame = {item.frame}: must be a global frame, LOCAL_NED or LOCAL_ENU")
        if (item.frame in ALTITUDES) != (flown[0].frame in ALTITUDES):
            kinds = {True: "global", False: "local"}
            raise FormatError(
                item.label,
                f"frame = {item.frame}: must be {kinds[flown[0].frame in ALTITUDES]}, as at {flown[0].label}",
            )
    return bool(flown) and flown[0].frame not in ALTITUDES


def _check_altitudes(flown: Sequence[Item]) -> None:
    stated = [item for item in flown if item.simple and item.frame in ALTITUDES and not item.nowhere]
    for item in stated:
        counted, first = ALTITUDES[item.frame], ALTITUDES[stated[0].frame]
        if counted != first:
            raise FormatError(
                item.label,
                f"frame = {item.frame} (altitude {counted}): must count altitudes {first}"
                f", as {stated[0].label} does (or give --mixed-altitudes)",
            )


def _stops(known: Sequence[Item], home: Stop | None, content: Content) -> list[Stop]:
    stops: list[Stop] = []
    ended = ""
    for item in known:
        if ended:
            content.note(f"items after {ended}, which ends the flight", item.label)
        elif item.command == TO_HOME:
            stops.append(Stop(item.label, at_home=True))
        elif item.command == DELAY and (item.params[0] or 0.0) > 0:
            _hover(stops, home, item, content)
        elif item.command not in AT_A_PLACE:
            _note_command(item, content)
        elif item.nowhere:
            _check_may_be_nowhere(item)
            content.note("position 0, 0 or none: the vehicle's present position", item.label)
            _hover(stops, home, item, content)
            _note_rest(item, content)
        else:
            stops.append(Stop(item.label, _position(item), _hold_s(item)))
            _note_rest(item, content)
        ended = item.name if item.command in ENDS else ended
    return stops


def _check_may_be_nowhere(item: Item) -> None:
    """Raise `FormatError` for a way point without a position: only 0, 0 stands for the present one there."""
    if item.command in {WAYPOINT, *STRAIGHTENED} and (item.x is None or item.y is None):
        raise FormatError(item.label, f"position of {item.name}: must be two finite numbers")


def _position(item: Item) -> Point:
    if item.x is None or item.y is None:
        raise FormatError(item.label, f"position of {item.name}: must be two finite numbers, or none")
    if item.frame in ALTITUDES:
        return check_lat_lon(item.label, item.x, item.y)
    return (item.y, item.x) if item.frame == LOCAL_NED else (item.x, item.y)


def _hold_s(item: Item) -> float:
    return max(item.params[0] or 0.0, 0.0) if item.command in {*HAVE_HOLD, DELAY} else 0.0


def _hover(stops: list[Stop], home: Stop | None, item: Item, content: Content) -> None:
    """Let the UAV hover where it is."""
    seconds = _hold_s(item)
    if not seconds:
        return
    if not stops and home is not None:
        stops.append(home)
    if stops:
        stops[-1] = replace(stops[-1], hover_s=stops[-1].hover_s + seconds)
    else:
        content.note("time to hover before the first position", item.label)


def _note_command(item: Item, content: Content) -> None:
    if item.command in {*FENCE_POLYGONS, *FENCE_CIRCLES, FENCE_RETURN, RALLY}:
        return
    detail = f" to {item.params[1]:g} m/s" if item.command == SPEED and item.params[1] is not None else ""
    content.note(f"command {item.name}{detail}", item.label)


def _note_rest(item: Item, content: Content) -> None:
    """Note everything in an item with a position that a route in the plane does not hold."""
    if item.z:
        content.note("altitude: the mission is flown in a plane", item.label)
    if item.command in VERTICAL:
        content.note("take-off and landing: UAVs start and end in the air", item.label)
    if item.command in {TURNS, TO_ALTITUDE, PAYLOAD}:
        content.note(f"command {item.name}: only its position is flown", item.label)
    if item.command == UNLIMITED:
        content.note("hovering without an end: the route ends there", item.label)
    if item.command in STRAIGHTENED:
        content.note(STRAIGHTENED[item.command], item.label)
    if item.command in {WAYPOINT, LAND, TAKEOFF} and item.params[3]:
        content.note("heading", item.label)
    if item.command in {WAYPOINT, UNLIMITED, TURNS, LOITER} and item.params[2]:
        content.note("radius of passing or circling", item.label)
    if item.command in HAVE_HOLD and (item.params[0] or 0.0) < 0:
        content.note("time to stay below 0 s: it does not stay", item.label)
    if not item.goes_on:
        content.note("waiting for a command to go on (autocontinue 0)", item.label)


def _acceptance_m(flown: Sequence[Item], content: Content) -> float:
    """Return the acceptance radius in metres if all way points that state one state the same, else 0."""
    radii = {item.label: item.params[1] for item in flown if item.command == WAYPOINT and item.params[1]}
    if len(set(radii.values())) > 1:
        content.note("acceptance radii that differ", *radii)
        return 0.0
    return max(next(iter(radii.values()), 0.0) or 0.0, 0.0)


def _zones(known: Sequence[Item], content: Content) -> list[Area]:
    """Return the zones of the fence items: circles, and polygons of as many successive corners as each corner says."""
    areas: list[Area] = []
    corners: list[Item] = []
    for item in known:
        if item.command in FENCE_POLYGONS:
            corners.append(item)
            if len(corners) == _corner_count(item, corners):
                areas.append(_polygon(corners))
                corners = []
        elif item.command in FENCE_CIRCLES:
            radius_m = item.params[0] or 0.0
            areas.append(
                Area(item.label, "", FENCE_CIRCLES[item.command], centre=_fence_point(item), radius_m=radius_m)
            )
        elif item.command == FENCE_RETURN:
            content.note("return point of the fence", item.label)
        elif item.command == RALLY:
            content.note("rally point", item.label)
    if corners:
        raise FormatError(
            corners[-1].label, f"corners of the polygon = {len(corners)}: must be {corners[0].params[0]:g}"
        )
    return areas


def _corner_count(item: Item, corners: Sequence[Item]) -> int:
    count = item.params[0] or 0.0
    if item.command != corners[0].command or count != corners[0].params[0]:
        raise FormatError(item.label, "must continue the polygon that the items before it began")
    if not math.isfinite(count) or count < 3 or count != int(count):
        raise FormatError(item.label, f"number of corners = {count:g}: must be a whole number from 3")
    return int(count)


def _polygon(corners: Sequence[Item]) -> Area:
    label = f"{corners[0].label} to {corners[-1].label}"
    return Area(label, "", FENCE_POLYGONS[corners[0].command], [_fence_point(corner) for corner in corners])


def _fence_point(item: Item) -> Point:
    if item.frame not in ALTITUDES or item.x is None or item.y is None:
        raise FormatError(item.label, f"frame = {item.frame}: must be a global frame, with a position")
    return check_lat_lon(item.label, item.x, item.y)
