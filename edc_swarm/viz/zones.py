"""Zones in scenes: inclusion zones as outlines, exclusion zones filled, all with their names."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity

from edc_swarm.mission.field_types import Point
from edc_swarm.mission.polygons import turn
from edc_swarm.mission.zone import Zone
from edc_swarm.viz.shapes import AMBER, GREEN, disc, entity, line, ring, text, triangles

FILLED = 0.25
"""Opacity of an exclusion zone."""


def zone_entities(zones: Sequence[Zone], now_ns: int) -> Iterator[SceneEntity]:
    """Yield the picture of each zone, which does not change during a mission."""
    for zone in zones:
        colour = AMBER if zone.kind == "exclusion" else GREEN
        made = entity(f"zone {zone.name}", now_ns)
        if zone.polygon:
            made.lines.append(line(zone.polygon, colour, 3.0, closed=True))
        else:
            made.lines.append(ring((zone.centre[0], zone.centre[1]), zone.radius_m, colour, 3.0))
        if zone.kind == "exclusion" and zone.polygon:
            made.triangles.append(triangles(triangulated(zone.polygon), colour, FILLED))
        elif zone.kind == "exclusion":
            made.cylinders.append(disc((zone.centre[0], zone.centre[1]), zone.radius_m, colour, FILLED))
        left_m, low_m, right_m, high_m = zone.bounds_m
        # The name of a fence stands on its upper edge, where it covers no UAV in the middle of the area.
        y_m = (low_m + high_m) / 2 if zone.kind == "exclusion" else high_m
        made.texts.append(text(((left_m + right_m) / 2, y_m), zone.name, colour))
        yield made


def triangulated(corners: Sequence[Point]) -> list[Point]:
    """Return the corners of the triangles that together are a simple polygon, three for each, by cutting off ears.

    An ear is a triangle of three successive corners, to the left of which the polygon lies and which holds no other
    corner (G. H. Meisters, Amer. Math. Monthly 82(6), 1975). Corners on a straight line are left out.
    """
    left = list(corners)
    if _area_m2(left) < 0:
        left.reverse()
    # A triangle that holds any corner holds one at which the polygon turns right, and cutting makes no new ones.
    reflex = [b for a, b, c in zip([left[-1], *left], left, [*left[1:], left[0]], strict=False) if turn(a, b, c) <= 0]
    found, at, idle = list[Point](), 0, 0
    while len(left) > 3 and idle < len(left):
        a, b, c = (left[(at + step) % len(left)] for step in range(3))
        sense = turn(a, b, c)
        if sense == 0 or (sense > 0 and not any(_holds(a, b, c, other) for other in reflex if other not in {a, b, c})):
            found += [a, b, c] if sense else []
            del left[(at + 1) % len(left)]
            at, idle = at % len(left), 0
        else:
            at, idle = (at + 1) % len(left), idle + 1
    return [*found, *left[:3]]


def _holds(a: Point, b: Point, c: Point, point: Point) -> bool:
    """Return True if a triangle, counter-clockwise, holds a point or has it on its edge."""
    return turn(a, b, point) >= 0 and turn(b, c, point) >= 0 and turn(c, a, point) >= 0


def _area_m2(corners: Sequence[Point]) -> float:
    """Return the area, below 0 for corners in clockwise order."""
    following = [*corners[1:], corners[0]]
    return sum(a[0] * b[1] - b[0] * a[1] for a, b in zip(corners, following, strict=True)) / 2
