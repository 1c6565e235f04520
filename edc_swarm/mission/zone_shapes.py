"""Checks of zones by themselves: each one is a polygon or a circle, and all have names of their own."""

from __future__ import annotations

from collections.abc import Sequence

from edc_swarm.errors import MissionError
from edc_swarm.mission.field_types import MAX_ALL_CORNERS, MAX_ZONES
from edc_swarm.mission.polygons import polygon_fault
from edc_swarm.mission.zone import Zone


def check_shapes(zones: Sequence[Zone]) -> None:
    """Raise `MissionError` unless every zone is a simple polygon or a circle, with a name that no other zone has."""
    if len(zones) > MAX_ZONES:
        raise MissionError("zone", len(zones), f"at most {MAX_ZONES} zones, with the fence of a random mission")
    corners = sum(zone.corners for zone in zones)
    if corners > MAX_ALL_CORNERS:
        raise MissionError("zone", corners, f"at most {MAX_ALL_CORNERS} corners in all zones together")
    seen = dict[str, int]()
    for index, zone in enumerate(zones):
        if zone.name in seen:
            raise MissionError(f"zone[{index}].name", zone.name, f"a name that zone[{seen[zone.name]}] does not have")
        seen[zone.name] = index
        _check_shape(zone, f"zone[{index}]")


def _check_shape(zone: Zone, where: str) -> None:
    if zone.polygon and (zone.centre or zone.radius_m):
        raise MissionError(where, zone.name, "a polygon or a circle (centre, radius_m), not both")
    if zone.polygon:
        if fault := polygon_fault(zone.polygon):
            raise MissionError(f"{where}.polygon", zone.polygon, f"a simple polygon (zone {zone.name}): {fault}")
    elif not zone.centre and not zone.radius_m:
        raise MissionError(where, zone.name, "a polygon or a circle (centre, radius_m), and has neither")
    elif len(zone.centre) != 2:
        raise MissionError(f"{where}.centre", zone.centre, f"two numbers [x, y] (zone {zone.name})")
    elif not zone.radius_m:
        raise MissionError(f"{where}.radius_m", zone.radius_m, f"above 0 (zone {zone.name})")
