"""Files of the same kinds as other programs write them, and details that one such file alone would not show."""

from __future__ import annotations

import json
from typing import Any

import pytest
from shapely.geometry import Polygon, box
from shapely.ops import unary_union

from edc_swarm.errors import FormatError
from edc_swarm.formats.assemble import Settings
from tests.unit.test_formats_read import (
    HOLE,
    HOME,
    LINE,
    LSC,
    RING,
    WPL,
    assert_near,
    feature,
    imported,
    in_degrees,
    item,
    kml,
    kmz,
    plan,
    way,
)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.plan", plan(rally=2)),
        ("a.geojson", '{"type": "FeatureCollection", "features": []}'),
        ("a.kml", kml("<NetworkLink><Link><href>http://example.org/a.kml</href></Link></NetworkLink>")),
        ("a.waypoints", "\n".join(WPL.split("\n")[:2])),
    ],
)
def test_a_file_without_a_route_and_without_a_zone_is_refused(name: str, text: str) -> None:
    """A mission of nothing but random UAVs is not what its user means."""
    with pytest.raises(FormatError, match=f"{name}: neither a route nor a zone: must hold one of them"):
        imported((name, text))


@pytest.mark.parametrize("name", ["a.txt", "a.waypoints"])
def test_a_byte_order_mark_hides_no_format(name: str) -> None:
    """Whether the suffix says the format, or the content alone."""
    assert imported((name, "\ufeff" + WPL)).mission == imported((name, WPL)).mission


@pytest.mark.parametrize("text", [json.dumps(LSC), "type,lat,lon\n,47,8\n,47.001,8\n"])
def test_a_byte_order_mark_hides_no_content(text: str) -> None:
    """Of a file whose content alone says its format."""
    assert imported(("a.txt", "\ufeff" + text)).mission == imported(("a.txt", text)).mission


def test_the_file_of_an_archive_that_is_read() -> None:
    """doc.kml in any case; without it the first one of those in the archive."""
    other = LINE.replace("8.5465", "8.5499")
    for names in (("b.kml", "a.kml"), ("DOC.KML", "a.kml"), ("a/b.kml", "doc2.kml")):
        files = zip(names, (LINE, other), strict=True)
        found = imported(("a.kmz", kmz(*((name, kml(text).encode()) for name, text in files))))
        assert found.mission == imported(("a.kml", kml(LINE))).mission, names
    last = imported(("a.kmz", kmz(("a.kml", kml(other).encode()), ("Doc.kml", kml(LINE).encode()))))
    assert last.mission == imported(("a.kml", kml(LINE))).mission


def test_placemarks_with_the_prefix_of_their_space_and_without_a_geometry() -> None:
    """The prefix is cut off; what has no place is listed."""
    mark = "<kml:Placemark><kml:name>{0}</kml:name>{1}</kml:Placemark>"
    line = "<kml:LineString><kml:coordinates>8.5,47.1,0 8.501,47.1,0</kml:coordinates></kml:LineString>"
    space = 'xmlns:kml="http://www.opengis.net/kml/2.2"'
    body = mark.format("way", line) + mark.format("note", "")
    found = imported(("a.kml", f"<kml:kml {space}><kml:Document>{body}</kml:Document></kml:kml>"))
    assert_near(in_degrees(found.mission), [(47.1, 8.5), (47.1, 8.501)])
    assert found.notes["a.kml"] == {"placemark without a geometry": ["line 1 (note)"]}


@pytest.mark.parametrize(
    "head", ["# my field\n", "sep=;\n", "SEP=;\n# one\n\n# two\n", "\n", "\ufeffsep=;\n"], ids=range(5)
)
def test_lines_before_the_header_of_a_csv_file(head: str) -> None:
    """Comments, and the line by which a spreadsheet states the separator; lines keep their numbers."""
    rows = "lat;lon\n47,1;8,5\n47,101;8,5\n"
    found = imported(("a.csv", head + rows))
    assert found.mission["roster"] == imported(("a.csv", rows)).mission["roster"]
    with pytest.raises(FormatError, match=f"line {2 + head.count(chr(10))}: lat = 'x'"):
        imported(("a.csv", head + rows.replace("47,1;", "x;")))


def test_way_points_of_a_camera_drone() -> None:
    """A CSV file with units without spaces and a dozen columns that no mission expresses."""
    names = "latitude,longitude,altitude(m),heading(deg),curvesize(m),rotationdir,gimbalmode,speed(m/s)"
    found = imported(("a.csv", f"{names}\n47.3979,8.546,30,90,0.2,0,2,0\n47.3985,8.546,30,90,0.2,0,2,0\n"))
    assert_near(in_degrees(found.mission), [(47.3979, 8.546), (47.3985, 8.546)])
    assert len(found.notes["a.csv"]) == 6


def test_a_drawn_polygon_has_no_return_point() -> None:
    """Mission Planner repeats its first corner at the end; the first line of a fence is no corner."""
    corners = ["-35.3628 149.1650", "-35.3630 149.1648", "-35.3633 149.1650", "-35.3631 149.1652"]
    drawn = imported(("a.poly", "\n".join(["#saved by Mission Planner 1.3.80", *corners, corners[0], ""])))
    fence = imported(("a.fen", "\n".join(["-35.3630 149.1650", *corners, corners[0], ""])))
    assert [len(each.mission["zone"][0]["polygon"]) for each in (drawn, fence)] == [4, 4]
    assert drawn.notes == {"a.poly": {}}
    assert any("read as inclusion zone: a closed polygon without a return point" in said for said in drawn.remarks)
    assert "return point of the fence (its first line)" in fence.notes["a.fen"]


def test_geometries_of_geojson_within_each_other() -> None:
    """A collection within a collection at the top, and polygons with holes side by side."""
    line = {"type": "LineString", "coordinates": [[8.5452, 47.3972], [8.5465, 47.3988]]}
    inner = {"type": "GeometryCollection", "geometries": [{"type": "Polygon", "coordinates": [HOLE]}]}
    text = json.dumps({"type": "GeometryCollection", "geometries": [line, inner]})
    found = imported(("a.geojson", text))
    assert (len(found.mission["roster"]), len(found.mission["zone"])) == (1, 1)
    wider = [[8.544, 47.396], [8.548, 47.396], [8.548, 47.4], [8.544, 47.4], [8.544, 47.396]]
    both = imported(("a.geojson", json.dumps(feature("MultiPolygon", [[RING, HOLE], [wider]], kind="fence"))))
    assert [zone["kind"] for zone in both.mission["zone"]] == ["inclusion", "exclusion", "inclusion"]


def test_frames_of_way_points() -> None:
    """Whole-number and plain frames, above home and above the terrain, are the same places."""
    frames = {3: "above home", 6: "above home", 10: "above the terrain", 11: "above the terrain", 0: "above sea level"}
    found = [imported(("a.plan", plan(item(16, 47.398, 8.546, frame=frame)))).mission for frame in frames]
    assert all(each == found[0] for each in found)
    mixed = plan(item(16, 47.398, 8.546), item(16, 47.399, 8.546, frame=10))
    assert len(way(imported(("a.plan", mixed), mixed_altitudes=True).mission)) == 3


def test_home_is_where_a_return_leads() -> None:
    """The way back ends at home, or at the first way point where the UAV starts there; the output says so."""
    back = plan(item(16, 47.3979, 8.5460), item(16, 47.3981, 8.5455), item(20, 0, 0, frame=2))
    assert_near(in_degrees(imported(("a.plan", back)).mission)[-1:], [HOME])
    first = imported(("a.plan", back), settings=Settings(r_m=0.5, start_at_home=False))
    assert_near(in_degrees(first.mission), [(47.3979, 8.5460), (47.3981, 8.5455), (47.3979, 8.5460)])
    assert "return to home: the UAV returns to its first way point" in first.notes["a.plan"]


def test_the_speed_of_a_quadrotor_that_differs_by_axis() -> None:
    """The lesser one of the plane, which the output says; the vertical one counts for nothing."""
    kind = LSC["quadrotors"]["crazyflie"] | {"max_vel": [2.0, 1.5, 0.5]}  # type: ignore[index]
    text = json.dumps(LSC | {"quadrotors": LSC["quadrotors"] | {"crazyflie": kind}})  # type: ignore[operator]
    found = imported(("a.json", text))
    assert found.mission["roster"][0]["v_max_mps"] == 1.5
    assert "largest speeds that differ by axis: the least is taken" in found.notes["a.json"]


def scenario(*agents: tuple[int, int, int, int], size: tuple[int, int]) -> str:
    """A scenario; an agent is the column and row of its start, and those of its goal."""
    rows = ("\t".join(map(str, (0, "maps/my map.map", *size, *agent, "12.5"))) for agent in agents)
    return "version 1.0\n" + "\n".join(rows) + "\n"


WAREHOUSE = (
    "type octile\nheight 9\nwidth 20\nmap\n" + ("." * 20 + "\n" + ".@@@@.@@@@.@@@@.@@@.\n") * 4 + "." * 20 + "\n"
)


@pytest.mark.parametrize("line_end", ["\n", "\r\n"])
def test_a_warehouse(line_end: str) -> None:
    """Sixteen shelves are zones, all aisles are open, whatever ends a line; a name with a space is no column."""
    agents = scenario((0, 0, 19, 8), (0, 8, 19, 0), size=(20, 9))
    found = imported(
        ("w.map", WAREHOUSE.replace("\n", line_end)), ("w.scen", agents.replace("\n", line_end)), cell_m=2.0
    )
    shelves = [Polygon(zone["polygon"]) for zone in found.mission["zone"] if zone["kind"] == "exclusion"]
    cells = [box(2 * (1 + 5 * i), 2 * (1 + 2 * j), 2 * (1 + 5 * i + (3 if i == 3 else 4)), 2 * (2 + 2 * j))
             for i in range(4) for j in range(4)]  # fmt: skip
    assert unary_union(shelves).equals(unary_union(cells))
    assert way(found.mission, 0) == [(1.0, 17.0), (39.0, 1.0)]
    assert way(found.mission, 1) == [(1.0, 1.0), (39.0, 17.0)]


def test_a_scenario_of_a_map_that_lies_across() -> None:
    """The same cells, but width and height exchanged."""
    agents: Any = scenario((0, 0, 5, 0), size=(9, 20))
    with pytest.raises(FormatError, match="map of 9 x 20 cells: must be 20 x 9"):
        imported(("w.map", WAREHOUSE), ("w.scen", agents))


def test_an_unknown_home_and_a_home_with_an_old_command() -> None:
    """A plan's home at 0, 0 is none, as in a way point file; old programs give item 0 the command 0."""
    unknown = plan(item(16, 47.398, 8.546), item(16, 47.399, 8.546), plannedHomePosition=[0, 0, 0])
    assert_near(in_degrees(imported(("a.plan", unknown)).mission), [(47.398, 8.546), (47.399, 8.546)])
    old = WPL.replace("0\t1\t0\t16\t", "0\t1\t0\t0\t", 1)
    assert imported(("a.waypoints", old)).mission == imported(("a.waypoints", WPL)).mission


ROUTE = [[8.5452, 47.3972], [8.5465, 47.3988]]
TRACK = "<gx:coord>8.5452 47.3972</gx:coord><gx:coord>8.5465 47.3988</gx:coord><gx:angles>90 0 0</gx:angles>"
AT_GROUND = "<altitudeMode>clampToGround</altitudeMode><coordinates>8.5,47.4</coordinates>"


@pytest.mark.parametrize(
    ("name", "data", "what", "items"),
    [
        ("a.geojson", json.dumps(feature("LineString", ROUTE) | {"id": 7}), "member id", ["the feature"]),
        ("a.geojson", json.dumps(feature("LineString", ROUTE, hover_s=5)), "property hover_s", ["the feature"]),
        ("a.geojson", json.dumps(feature("LineString", [[*at, 10, 3] for at in ROUTE])),
         "numbers of a position after its altitude", ["the feature"]),
        ("a.geojson", json.dumps({"type": "FeatureCollection", "features": [
            feature("Point", at, uav="a", r_m=number) for number, at in enumerate(ROUTE, 1)]}),
         "r_m that differs between the points of a UAV: the first one counts", ["feature 1", "feature 2"]),
        ("a.geojson", json.dumps(feature("LineString", ROUTE, uav="a", UAV="b")), "property UAV beside another uav",
         ["the feature"]),
        ("a.geojson", json.dumps(feature("Point", HOME, role="start", kind="waypoint")),
         "property role beside another kind", ["the feature"]),
        ("a.kml", kml(LINE.replace("<LineString>", '<ExtendedData><Data name="name"><value>other</value></Data>'
                                   "</ExtendedData><LineString>")),
         "property name beside the element name", ["line 2 (way)"]),
        ("a.kmz", kmz(("doc.kml", kml(LINE).encode()), ("b.kml", b"")), "other file of the archive", ["b.kml"]),
        ("a.kml", kml(f"<Placemark><gx:Track>{TRACK}</gx:Track></Placemark>"), "element angles", ["line 2"]),
        ("a.kml", kml(LINE.replace("<coordinates>", "<altitudeMode>absolute</altitudeMode><coordinates>")
                      + f"<Placemark><Point>{AT_GROUND}</Point></Placemark>"),
         "altitudes that count from different levels", ["line 2"]),
        ("a.plan", plan(item(16, 47.398, 8.546)).replace('"fileType"', '"complexItems": [], "fileType"', 1),
         "member complexItems", ["plan"]),
        ("a.plan", plan(item(16, 47.398, 8.546) | {"params": [-1, 0, 0, 0, 47.398, 8.546, 0]}),
         "time to stay below 0 s: it does not stay", ["item 1"]),
        ("a.waypoints", WPL.replace("\n2\t", "\n1\t", 1),
         "item numbers that do not count up from 0: items are flown in the order of their lines", ["line 4"]),
    ],
)  # fmt: skip
def test_nothing_is_dropped_silently(name: str, data: str | bytes, what: str, items: list[str]) -> None:
    """What each file holds and a mission does not express is listed."""
    assert imported((name, data), settings=Settings(r_m=0.5, start_at_home=False)).notes[name][what] == items


def test_a_scenario_of_another_map_is_listed() -> None:
    """Its name differs from that of the file with the map; folders do not count."""
    agents = scenario((0, 0, 19, 8), (0, 8, 19, 0), size=(20, 9))
    other = imported(("w.map", WAREHOUSE), ("w.scen", agents), cell_m=2.0)
    assert other.notes["w.map, w.scen"]["the scenario names another map than w.map"] == ["line 2", "line 3"]
    assert not imported(("my map.map", WAREHOUSE), ("w.scen", agents), cell_m=2.0).notes["my map.map, w.scen"]
