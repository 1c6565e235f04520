"""Check of an imported mission: `sim` and `run` accept it, or an error names the item of a file that is the reason."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from edc_swarm.errors import FormatError, MissionError, PlacementError, SpacingError
from edc_swarm.formats.content import Route, Stop
from edc_swarm.formats.plane_checks import widest_radius_m
from edc_swarm.mission.airspace import check_zones
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.passing import tight_passing
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.validation import mission_from_dict

FEWER_UAVS = (3, 1)
"""Numbers of UAVs to try in a small area."""
_FIELD = re.compile(r"(roster|zone)\[(\d+)\](?:\.(start|target|route)(?:\[(\d+)\])?)?")


@dataclass(frozen=True, slots=True)
class Flight:
    """One route in the mission's plane: points in metres, the first one the start."""

    file: str
    uav: str
    route: Route
    stops: list[Stop]


def most_uavs(mission: Mapping[str, Any]) -> int:
    """Return the number of UAVs of a mission that draws them: the default, or fewer where those do not fit."""
    for uavs in (Mission().uavs, *FEWER_UAVS):
        try:
            complete_mission(mission_from_dict({**mission, "uavs": uavs}))
        except PlacementError:
            continue
        except MissionError:
            break  # It is not the number: `flyable` says what it is.
        return uavs
    return 1


def flyable(
    mission: Mapping[str, Any], flights: Sequence[Flight], zones: Mapping[int, tuple[str, str]]
) -> tuple[Mission, list[str]]:
    """Return the mission as it is flown, and warnings about tight ways.

    Parameters
    ----------
    mission
        Keys and values of a mission file; its roster has one entry per flight.
    flights
        The flights of the files.
    zones
        File and item of each zone, by its index.

    Raises
    ------
    FormatError
        With file and item: a field that a mission refuses, discs that overlap, a point that a zone forbids, no way.
    """
    try:
        whole = complete_mission(mission_from_dict(mission))
        return whole, [*check_zones(whole), *tight_passing(whole)]
    except MissionError as error:
        raise _refusal(error, mission, flights, zones) from None


def _refusal(
    error: MissionError, mission: Mapping[str, Any], flights: Sequence[Flight], zones: Mapping[int, tuple[str, str]]
) -> FormatError:
    """Return the error with the file and the item that state the field."""
    found = _FIELD.match(error.field)
    if found is None:
        return FormatError("", f"cannot be flown: {error}", "; ".join(sorted({file for file, _ in zones.values()})))
    table, index, point, place = found[1], int(found[2]), found[3], found[4]
    if table == "zone":
        file, item = zones[index]
        return FormatError(item, f"must be {error.allowed}", file)
    flight = flights[index]
    if point is None:
        return FormatError(flight.route.item, str(error), flight.file)
    stop = {"start": 0, "target": -1}.get(point, 0)
    if place is not None:  # The route of the mission file leaves out the start.
        stop = int(place) + len(flight.stops) - len(mission["roster"][index]["route"])
    what = point if place is None else "way point"
    remedy = _remedy(flights, point, stop) if isinstance(error, SpacingError) else ""
    return FormatError(flight.stops[stop].item, f"{what} of {flight.uav}: must be {error.allowed}{remedy}", flight.file)


def _remedy(flights: Sequence[Flight], what: str, stop: int) -> str:
    """Return in words the radius of discs that would fit."""
    fits_m = math.floor(100 * widest_radius_m(np.array([flight.stops[stop].point for flight in flights]))) / 100
    remedy = f"--r {fits_m:g} fits all {what}s" if fits_m > 0 else "no --r fits"
    if what == "start" and any(flight.route.home is not None for flight in flights):
        remedy += ", --start first begins at way points"
    return f" ({remedy})"
