"""Zones against shapely: simple polygons, allowed places, and ways for discs between them."""

from __future__ import annotations

import math
from itertools import combinations
from typing import get_args

import numpy as np
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.geometry import LineString, Point, Polygon

from edc_swarm.mission.airspace import Airspace, zones_refusal
from edc_swarm.mission.field_types import ZoneRule
from edc_swarm.mission.polygons import polygon_fault
from edc_swarm.mission.zone import RIM_CORNERS, Zone

SIDE_M = 100.0
QUAD_SEGS = 64
SLACK_M = 0.01
"""More than the distance between an arc of shapely's buffers and the true one."""
NUMBER = st.integers(0, 12).map(float)
"""Coordinates on a coarse lattice: corners repeat, touch and line up often."""


@settings(max_examples=300, deadline=None)
@given(st.lists(st.tuples(NUMBER, NUMBER), min_size=3, max_size=9))
def test_polygons_are_simple_where_shapely_says_so(corners: list[tuple[float, float]]) -> None:
    """A ring without repeated corners, with an area, whose edges do not meet."""
    distinct = len(set(corners)) == len(corners)
    simple = distinct and Polygon(corners).area > 0 and shapely.is_valid(Polygon(corners))
    assert (polygon_fault(corners) == "") == simple


def zone_shape(zone: Zone) -> Polygon:
    """Return the zone as shapely sees it; an inclusion circle is its inscribed polygon."""
    if zone.polygon:
        return Polygon(zone.polygon)
    (x_m, y_m), turns = zone.centre, [2 * math.pi * i / RIM_CORNERS for i in range(RIM_CORNERS)]
    if zone.kind == "exclusion":
        return Point(x_m, y_m).buffer(zone.radius_m, quad_segs=1024)
    return Polygon([(x_m + zone.radius_m * math.cos(t), y_m + zone.radius_m * math.sin(t)) for t in turns])


@st.composite
def zones(draw: st.DrawFn) -> list[Zone]:
    """A fence, then up to ten exclusion zones: bars, stars and circles that often overlap or touch."""
    fence = draw(
        st.sampled_from(
            [
                Zone(name="fence", kind="inclusion", polygon=[(0, 0), (SIDE_M, 0), (SIDE_M, SIDE_M), (0, SIDE_M)]),
                Zone(name="fence", kind="inclusion", centre=[50, 50], radius_m=50, keep="disc"),
                Zone(
                    name="fence",
                    kind="inclusion",
                    polygon=[(0, 0), (100, 0), (100, 100), (60, 100), (50, 20), (0, 100)],
                ),
            ]
        )
    )
    made = [fence]
    for index in range(draw(st.integers(1, 10))):
        name = f"z{index}"
        keep: ZoneRule = draw(st.sampled_from(get_args(ZoneRule)))
        x_m, y_m, size_m = draw(st.integers(0, 100)), draw(st.integers(0, 100)), draw(st.integers(2, 30))
        match draw(st.sampled_from(["circle", "bar", "star"])):
            case "circle":
                made.append(Zone(name=name, kind="exclusion", keep=keep, centre=[x_m, y_m], radius_m=size_m / 2))
            case "bar":
                w_m, h_m = (4.0, 2.0 * size_m) if draw(st.booleans()) else (2.0 * size_m, 4.0)
                corners = [(x_m, y_m), (x_m + w_m, y_m), (x_m + w_m, y_m + h_m), (x_m, y_m + h_m)]
                made.append(Zone(name=name, kind="exclusion", keep=keep, polygon=corners))
            case _:
                radii_m = [size_m if i % 2 else size_m / 3 for i in range(10)]
                corners = [
                    (x_m + r_m * math.cos(math.pi * i / 5 + 0.1), y_m + r_m * math.sin(math.pi * i / 5 + 0.1))
                    for i, r_m in enumerate(radii_m)
                ]
                made.append(Zone(name=name, kind="exclusion", keep=keep, polygon=corners))
    return made


@settings(max_examples=300, deadline=None)
@given(zones(), st.lists(st.tuples(st.floats(-5, 105), st.floats(-5, 105)), min_size=1, max_size=5))
def test_places_are_allowed_where_shapely_says_so(made: list[Zone], points: list[tuple[float, float]]) -> None:
    """The signed distance from the edge of each zone, in the sense of the zone's kind."""
    clear_m = Airspace.of(made).clear_m(np.array(points))
    for which, zone in enumerate(made):
        shape = zone_shape(zone)
        for index, point in enumerate(points):
            away_m = shape.exterior.distance(Point(point))
            allowed = shape.contains(Point(point)) == (zone.kind == "inclusion")
            assert math.isclose(clear_m[index, which], away_m if allowed else -away_m, abs_tol=1e-4)


def free_parts(made: list[Zone], r_m: float, more_m: float) -> list[Polygon]:
    """Return the connected parts of the places where a UAV may be that keeps `more_m` beyond what zones ask."""
    edges = [
        zone_shape(zone).exterior.buffer((r_m if zone.keeps_disc else 0.0) + more_m, quad_segs=QUAD_SEGS)
        for zone in made
    ]
    free = Polygon([(-50, -50), (150, -50), (150, 150), (-50, 150)]).difference(shapely.union_all(edges))
    for zone in made:
        shape = zone_shape(zone)
        free = free.intersection(shape) if zone.kind == "inclusion" else free.difference(shape)
    return [part for part in getattr(free, "geoms", [free]) if not part.is_empty]


def joined(parts: list[Polygon], line: LineString) -> bool:
    """Return True if both ends lie in one part."""
    ends = [Point(end) for end in line.coords]
    return any(all(part.intersects(end) for end in ends) for part in parts)


@st.composite
def mazes(draw: st.DrawFn) -> list[Zone]:
    """A fence and walls across it, some with a gate that is just wide enough for a disc of 2 m, or just too narrow."""
    corners = [(0.0, 0.0), (SIDE_M, 0.0), (SIDE_M, SIDE_M), (0.0, SIDE_M)]
    made = [Zone(name="fence", kind="inclusion", polygon=corners)]
    for index in range(draw(st.integers(1, 4))):
        low_m, gate_m, gap_m = 20.0 * index + 15, draw(st.integers(10, 80)), draw(st.sampled_from([0, 3, 4, 5, 6]))
        across = draw(st.booleans())
        for part, (begin_m, end_m) in enumerate([(-5, gate_m), (gate_m + gap_m, 105)]):
            corners = [(low_m, begin_m), (low_m + 2, begin_m), (low_m + 2, end_m), (low_m, end_m)]
            corners = [(y_m, x_m) for x_m, y_m in corners] if across else corners
            made.append(Zone(name=f"{index}{part}", kind="exclusion", polygon=corners))
    if draw(st.booleans()):
        made.append(Zone(name="tower", kind="exclusion", centre=[draw(st.integers(0, 100)), 50], radius_m=6))
    return made


@settings(max_examples=40, deadline=None)
@given(st.one_of(mazes(), zones()), st.sampled_from([0.5, 1.98, 2.02, 5.0]))
def test_ways_exist_where_shapely_says_so(made: list[Zone], r_m: float) -> None:
    """Two free places have a way if and only if they lie in one connected part of the free space."""
    roomy, wide = (free_parts(made, r_m, more_m) for more_m in (SLACK_M, -SLACK_M))
    places = [part.representative_point() for part in roomy if part.area > 0.1]
    places += [Point(x, y) for x in (7, 50, 93) for y in (7, 50, 93) if any(p.contains(Point(x, y)) for p in roomy)]
    for one, other in combinations(places[:10], 2):
        line = LineString([one, other])
        refusal = zones_refusal(made, r_m, [(x, y) for x, y in line.coords])
        if joined(roomy, line):
            assert refusal == ""
        elif not joined(wide, line):
            assert refusal.startswith("no way")
