"""Files of other programs: what is read, what is listed, and how programs of others read the same."""

from __future__ import annotations

import io
import json
import math
import zipfile
from itertools import pairwise
from pathlib import Path
from typing import Any

import fastkml
import pytest
import shapely.geometry
from fastkml.utils import find_all
from geographiclib.geodesic import Geodesic
from pymavlink import mavutil, mavwp
from pymavlink.dialects.v20 import ardupilotmega, common
from shapely.geometry import Polygon, box
from shapely.ops import unary_union

from edc_swarm.errors import FormatError
from edc_swarm.formats.assemble import Imported, Settings, assemble
from edc_swarm.formats.cells import polygons
from edc_swarm.formats.content import Options
from edc_swarm.formats.mavlink_commands import COMMANDS
from edc_swarm.formats.registry import read_files
from edc_swarm.geodesy import to_wgs84

HOME = (47.397742, 8.545594)


def imported(*files: tuple[str, str | bytes], settings: Settings | None = None, **options: Any) -> Imported:
    """The mission of files, each a name and its content."""
    raw = [(name, data.encode() if isinstance(data, str) else data) for name, data in files]
    return assemble(read_files(raw, Options(**options)), settings or Settings(r_m=0.5))


def way(mission: dict[str, Any], index: int = 0) -> list[tuple[float, float]]:
    """Start and all further points of a UAV, in metres."""
    entry = mission["roster"][index]
    rest = entry.get("route") or [(entry["target_x_m"], entry["target_y_m"])]
    return [(entry["start_x_m"], entry["start_y_m"]), *map(tuple, rest)]


def in_degrees(mission: dict[str, Any], index: int = 0) -> list[tuple[float, float]]:
    """The way of a UAV as latitudes and longitudes."""
    origin = mission["origin_lat_deg"], mission["origin_lon_deg"]
    return [to_wgs84(*point, *origin) for point in way(mission, index)]


def assert_near(points: list[tuple[float, float]], expected: list[tuple[float, float]]) -> None:
    """The same points to a millimetre or two of latitude and longitude."""
    assert [(pytest.approx(a, abs=2e-8), pytest.approx(b, abs=4e-8)) for a, b in expected] == points


def item(
    command: int,
    lat: float | None,
    lon: float | None,
    *,
    frame: int = 3,
    alt: float = 10.0,
    params: tuple[Any, ...] = (0, 0, 0, None),
) -> dict[str, Any]:
    """A simple item of a plan."""
    return {
        "type": "SimpleItem",
        "command": command,
        "frame": frame,
        "autoContinue": True,
        "params": [*params, lat, lon, alt],
    }


def plan(*items: dict[str, Any], fence: dict[str, Any] | None = None, rally: int = 0, **mission: Any) -> str:
    """A plan of QGroundControl."""
    return json.dumps(
        {
            "fileType": "Plan",
            "version": 1,
            "groundStation": "QGroundControl",
            "mission": {"version": 2, "plannedHomePosition": [*HOME, 488], "items": list(items)} | mission,
            "geoFence": {"version": 2, "circles": [], "polygons": []} | (fence or {}),
            "rallyPoints": {"version": 2, "points": [[*HOME, 0]] * rally},
        }
    )


SQUARE = [[47.3970, 8.5450], [47.3970, 8.5470], [47.3985, 8.5470], [47.3985, 8.5450]]


def test_a_plan_is_route_zones_and_a_list_of_the_rest() -> None:
    """Take-off, two way points with a time to hover, a return home; fence, circle, rally point; commands are listed."""
    text = plan(
        item(22, *HOME, alt=5),
        item(16, 47.3979, 8.5460, params=(4, 2, 0, None)),
        item(178, 0, 0, params=(1, 3, -1, 0), frame=2, alt=0),
        item(16, 47.3981, 8.5455, params=(0, 2, 0, 90)),
        item(20, 0, 0, frame=2, alt=0),
        fence={
            "polygons": [{"polygon": SQUARE, "inclusion": True, "version": 1}],
            "circles": [{"circle": {"center": [47.3975, 8.5465], "radius": 12.5}, "inclusion": False, "version": 1}],
        },
        rally=2,
        hoverSpeed=4,
        cruiseSpeed=15,
        vehicleType=2,
    )
    found = imported(("a.plan", text), settings=Settings())
    assert (found.mission["origin_lat_deg"], found.mission["origin_lon_deg"]) == HOME
    assert_near(in_degrees(found.mission), [HOME, (47.3979, 8.5460), (47.3981, 8.5455), HOME])
    (entry,) = found.mission["roster"]
    assert entry["hover_s"] == [4.0, 0.0, 0.0]
    assert entry["accept_m"] == 2.0
    assert found.mission["v_max_mps"] == 4.0
    fence, circle = found.mission["zone"]
    assert (fence["kind"], len(fence["polygon"])) == ("inclusion", 4)
    assert (circle["kind"], circle["radius_m"]) == ("exclusion", 12.5)
    assert found.notes["a.plan"] == {
        "altitude: the mission is flown in a plane": ["item 1", "item 2", "item 4"],
        "take-off and landing: UAVs start and end in the air": ["item 1"],
        "command DO_CHANGE_SPEED to 3 m/s": ["item 3"],
        "heading": ["item 4"],
        "rally point": ["rally point 1", "rally point 2"],
    }


def test_patterns_of_a_plan_are_flown_as_the_plan_stores_them() -> None:
    """A survey by its items, a corridor by its visible transects, a landing by approach and end; a scan is listed."""
    survey = {
        "type": "ComplexItem",
        "complexItemType": "survey",
        "version": 5,
        "polygon": SQUARE,
        "TransectStyleComplexItem": {
            "Items": [item(16, 47.3975, 8.5455, frame=0), item(206, 0, 0, frame=2), item(16, 47.3980, 8.5455, frame=0)],
            "VisualTransectPoints": [[1, 1]],
        },
    }
    corridor = {
        "type": "ComplexItem",
        "complexItemType": "CorridorScan",
        "TransectStyleComplexItem": {"Items": [], "VisualTransectPoints": [[47.3982, 8.5456], [47.3983, 8.5458]]},
    }
    landing = {
        "type": "ComplexItem",
        "complexItemType": "fwLandingPattern",
        "landCoordinate": [47.3971, 8.5460, 0],
        "loiterCoordinate": [47.3975, 8.5460, 40],
    }
    scan = {"type": "ComplexItem", "complexItemType": "StructureScan", "polygon": SQUARE, "Layers": 2}
    found = imported(("a.plan", plan(item(22, None, None), survey, corridor, scan, landing)))
    assert_near(
        in_degrees(found.mission),
        [
            HOME,
            *[(47.3975, 8.5455), (47.3980, 8.5455)],
            *[(47.3982, 8.5456), (47.3983, 8.5458)],
            *[(47.3975, 8.5460), (47.3971, 8.5460)],
        ],
    )
    notes = found.notes["a.plan"]
    assert notes["command DO_SET_CAM_TRIGG_DIST"] == ["item 2.2"]
    assert notes["pattern StructureScan: the plan stores no way points of it"] == ["item 4"]
    assert notes["pattern survey: its stored items are flown"] == ["item 2"]


def test_old_plans_are_read() -> None:
    """Parameters by name, the position as a list, a fence with one polygon."""
    old = {"type": "missionItem", "command": 16, "frame": 3, "param1": 3, "param2": 0, "param3": 0, "param4": 0}
    text = plan(
        old | {"coordinate": [47.3975, 8.5455, 20]},
        {"type": "SimpleItem", "command": 16, "frame": 3, "params": [0, 0, 0, 0], "coordinate": [47.3977, 8.5457, 20]},
        fence={"polygon": SQUARE, "version": 1},
    )
    found = imported(("a.plan", text))
    assert_near(in_degrees(found.mission), [HOME, (47.3975, 8.5455), (47.3977, 8.5457)])
    assert found.mission["zone"][0]["kind"] == "inclusion"


WPL = """QGC WPL 110
0\t1\t0\t16\t0\t0\t0\t0\t-35.362881\t149.165222\t582.0\t1
1\t0\t3\t22\t0\t0\t0\t0\t-35.362881\t149.165222\t20.0\t1
2\t0\t3\t16\t1.5\t0\t0\t0\t-35.364652\t149.163501\t20.0\t1
3\t0\t3\t115\t640\t20\t1\t1\t0\t0\t0\t1
4\t0\t3\t19\t5\t0\t0\t1\t0\t0\t20\t1
5\t0\t3\t16\t0\t0\t0\t0\t-35.365361\t149.163501\t0\t1
6\t0\t3\t177\t5\t1\t0\t0\t0\t0\t0\t1
7\t0\t3\t20\t0\t0\t0\t0\t0\t0\t0\t1
8\t0\t3\t16\t0\t0\t0\t0\t-35.3\t149.1\t0\t1
"""


@pytest.mark.parametrize("text", [WPL, WPL.replace("\n", "\r\n"), "\ufeff" + WPL, WPL.replace("\t", "  ")])
def test_way_points_as_pymavlink_reads_them(text: str, tmp_path: Path) -> None:
    """Positions are those of mavwp; hovering is kept; commands, a jump and what follows the end are listed."""
    path = tmp_path / "a.waypoints"
    path.write_bytes(WPL.encode())
    loader = mavwp.MAVWPLoader()
    loader.load(str(path))
    home, _, first, _, _, second, *_ = [(loader.wp(i).x, loader.wp(i).y) for i in range(loader.count())]
    found = imported(("a.waypoints", text))
    assert_near(in_degrees(found.mission), [home, first, second, home])
    assert found.mission["roster"][0]["hover_s"] == [6.5, 0.0, 0.0]
    notes = found.notes["a.waypoints"]
    assert notes["command CONDITION_YAW"] == ["item 3"]
    assert notes["command DO_JUMP"] == ["item 6"]
    assert notes["items after NAV_RETURN_TO_LAUNCH, which ends the flight"] == ["item 8"]
    assert notes["position 0, 0 or none: the vehicle's present position"] == ["item 4"]


def test_utf_16_is_read_by_its_byte_order_mark() -> None:
    """As spreadsheets write text."""
    assert imported(("a.txt", WPL.encode("utf-16"))).mission == imported(("a.txt", WPL)).mission


def test_home_is_the_origin_wherever_the_first_way_point_is() -> None:
    """The first home of several files, even one that comes after a file without a home."""
    line = json.dumps({"type": "LineString", "coordinates": [[8.5452, 47.3972], [8.5465, 47.3988]]})
    home_alone = "\n".join(WPL.split("\n")[:2])
    plan_text = plan(item(16, 47.3979, 8.5460))
    found = imported(("line.geojson", line), ("b.plan", plan_text), ("c.waypoints", home_alone))
    assert (found.mission["origin_lat_deg"], found.mission["origin_lon_deg"]) == HOME
    alone = imported(("a.waypoints", WPL), settings=Settings(r_m=0.5, start_at_home=False))
    assert (alone.mission["origin_lat_deg"], alone.mission["origin_lon_deg"]) == (-35.362881, 149.165222)


@pytest.mark.parametrize(("command", "note"), [(82, "splines: legs are straight"), (36, "arcs: legs are straight")])
def test_curved_way_points_are_flown_to_their_ends(command: int, note: str) -> None:
    """The place of a spline or an arc is a way point; its curve is listed."""
    curve = item(command, 47.3979, 8.5460, params=(90, 0, 0, None))
    found = imported(("a.plan", plan(curve, item(16, 47.3981, 8.5455))))
    assert_near(in_degrees(found.mission), [HOME, (47.3979, 8.5460), (47.3981, 8.5455)])
    assert found.notes["a.plan"][note] == ["item 1"]


def test_no_time_to_hover_is_lost() -> None:
    """At the start, at a spline, of a delay, and of two items at one place; the last one is that of the target."""
    there, further = (47.3979, 8.5460), (47.3981, 8.5455)
    items = [
        item(93, 0, 0, params=(3, -1, -1, -1), frame=2),
        item(82, *there, params=(4, 0, 0, None)),
        item(93, 0, 0, params=(5, -1, -1, -1), frame=2),
        item(16, *further, params=(6, 0, 0, None)),
        item(16, *further, params=(7, 0, 0, None)),
        item(20, 0, 0, frame=2),
    ]
    found = imported(("a.plan", plan(*items)))
    assert_near(in_degrees(found.mission), [HOME, HOME, there, further, HOME])
    assert found.mission["roster"][0]["hover_s"] == [3.0, 9.0, 13.0, 0.0]


def test_a_home_at_0_0_is_not_known() -> None:
    """The UAV starts at its first way point then, and the output says so."""
    text = WPL.replace("-35.362881\t149.165222\t582.0", "0\t0\t0").replace("1\t0\t3\t22", "#")
    found = imported(("a.waypoints", text))
    assert_near(in_degrees(found.mission)[:1], [(-35.364652, 149.163501)])
    assert "home position 0, 0: not known when the file was written" in found.notes["a.waypoints"]


def test_fence_and_rally_items_of_a_way_point_file() -> None:
    """Mission Planner writes fences so: polygons by corner, circles by radius."""
    corners = "\n".join(f"{i} 0 3 5002 3 0 0 0 {47.39 + (i == 2) / 1e3} {8.54 + (i == 3) / 1e3} 0 1" for i in (1, 2, 3))
    more = "4 0 3 5003 80 0 0 0 47.39 8.54 0 1\n5 0 3 5100 0 0 0 0 47.39 8.54 20 1\n6 0 3 5000 0 0 0 0 47.4 8.5 0 1"
    found = imported(("fence.waypoints", f"QGC WPL 110\n0 1 0 16 0 0 0 0 47.39 8.54 0 1\n{corners}\n{more}\n"))
    polygon, circle = found.mission["zone"]
    assert (polygon["kind"], len(polygon["polygon"])) == ("exclusion", 3)
    assert (circle["kind"], circle["radius_m"], circle["centre"]) == (
        "inclusion",
        80.0,
        pytest.approx([80.0, 80.0], abs=0.01),
    )
    assert {"rally point", "return point of the fence"} <= set(found.notes["fence.waypoints"])
    assert found.remarks[-1] == "no file holds a route: the mission draws its UAVs (10) at random in its area"


def test_local_frames_are_read_as_they_are() -> None:
    """NED has north first, ENU east; home gives the origin."""
    rows = "0 1 0 16 0 0 0 0 47.39 8.54 400 1\n1 0 1 16 0 0 0 0 30 10 -5 1\n2 0 1 16 0 0 0 0 -20 40 -5 1\n"
    found = imported(("a.txt", "QGC WPL 110\n" + rows))
    assert way(found.mission) == [(10.0, 30.0), (40.0, -20.0)]
    assert (found.mission["origin_lat_deg"], found.mission["origin_lon_deg"]) == (47.39, 8.54)
    east_first = imported(("a.txt", "QGC WPL 110\n" + rows.replace("0 1 16", "0 4 16")))
    assert way(east_first.mission) == [(30.0, 10.0), (-20.0, 40.0)]


def test_the_commands_are_those_of_pymavlink() -> None:
    """Every command of both dialects, by its name."""
    known = {**common.enums["MAV_CMD"], **ardupilotmega.enums["MAV_CMD"]}
    named = {
        number: entry.name.removeprefix("MAV_CMD_") for number, entry in known.items() if "ENUM_END" not in entry.name
    }
    assert named == COMMANDS
    assert mavutil.mavlink.MAV_CMD_NAV_SPLINE_WAYPOINT == 82


def test_a_fence_file_is_a_polygon_after_its_return_point() -> None:
    """The first line is listed, the corner that closes the polygon is dropped."""
    text = "-35.3629 149.1650\n-35.3628 149.1650\n-35.3630 149.1648\n-35.3631 149.1652\n-35.3628 149.1650\n"
    found = imported(("fence.txt", text))
    (zone,) = found.mission["zone"]
    assert (zone["kind"], len(zone["polygon"])) == ("inclusion", 3)
    assert found.notes == {"fence.txt": {"return point of the fence (its first line)": ["line 1"]}}


def test_several_files_are_one_mission() -> None:
    """A route and a fence about it; each table says where it comes from."""
    fence = "-35.3640 149.1645\n-35.3600 149.1600\n-35.3600 149.1700\n-35.3700 149.1700\n-35.3700 149.1600\n"
    found = imported(("a.waypoints", WPL), ("fence.txt", fence))
    assert len(found.mission["roster"]) == len(found.mission["zone"]) == 1
    assert found.places == {("zone", 0): "fence.txt, the polygon", ("roster", 0): "a.waypoints, item 1 to item 7"}


def feature(shape: str, coordinates: Any, **properties: Any) -> dict[str, Any]:
    """A feature of GeoJSON."""
    return {"type": "Feature", "properties": properties, "geometry": {"type": shape, "coordinates": coordinates}}


RING = [[8.545, 47.397], [8.547, 47.397], [8.547, 47.399], [8.545, 47.399], [8.545, 47.397]]
HOLE = [[8.5455, 47.3975], [8.5458, 47.3975], [8.5458, 47.3978], [8.5455, 47.3975]]


def test_geojson_lines_polygons_circles_and_points() -> None:
    """A line is a UAV, polygons and circles are zones by kind or name, holes of fences are exclusions."""
    features = [
        feature("LineString", [[8.5452, 47.3972, 30], [8.5465, 47.3988, 30]], uav="left", speed="3"),
        feature("MultiLineString", [[[8.5452, 47.3985], [8.5454, 47.3986]], [[8.5468, 47.3972], [8.5468, 47.3980]]]),
        feature("Polygon", [RING, HOLE], name="Flight boundary"),
        feature("Polygon", [HOLE], kind="exclusion", name="Tower"),
        feature("Point", [8.5462, 47.3974], kind="no-fly", radius_m=8),
        feature("Point", [8.5462, 47.3974], name="car park"),
        {"type": "Feature", "properties": None, "geometry": None},
    ]
    text = json.dumps({"type": "FeatureCollection", "features": features})
    found = imported(("a.geojson", text), settings=Settings(r_m=1.0))
    assert [entry["uav"] for entry in found.mission["roster"]] == ["left", "u001", "u002"]
    assert_near(in_degrees(found.mission, 1), [(47.3985, 8.5452), (47.3986, 8.5454)])
    zones = found.mission["zone"]
    assert [(z["name"], z["kind"], z.get("keep", "")) for z in zones] == [
        ("Flight boundary", "inclusion", ""),
        ("Flight boundary hole", "exclusion", "centre"),
        ("Tower", "exclusion", ""),
        ("zone 4", "exclusion", ""),
    ]
    assert zones[3]["radius_m"] == 8.0
    assert found.notes["a.geojson"] == {
        "property speed": ["feature 1"],
        "altitude: the mission is flown in a plane": ["feature 1"],
        "point beside lines": ["feature 6"],
        "feature without a geometry": ["feature 7"],
    }
    assert any("its name says so" in remark for remark in found.remarks)


def test_the_hole_of_an_exclusion_is_closed_and_listed() -> None:
    """Nobody could fly into it."""
    text = json.dumps(feature("Polygon", [RING, HOLE], kind="exclusion"))
    found = imported(("a.geojson", text))
    assert [zone["kind"] for zone in found.mission["zone"]] == ["exclusion"]
    assert found.notes["a.geojson"] == {"hole of an exclusion zone: it is closed": ["the feature"]}


INCLUSIONS = ("inclusion", "include", "fence", "geofence", "boundary", "keep-in")
EXCLUSIONS = ("exclusion", "exclude", "no-fly", "nofly", "obstacle", "keep-out", "No Fly", "KEEP_OUT")


@pytest.mark.parametrize("word", INCLUSIONS + EXCLUSIONS)
def test_every_word_for_a_kind_of_zone(word: str) -> None:
    """As property, against the option, and as a part of the name."""
    expected = "inclusion" if word in INCLUSIONS else "exclusion"
    other = "exclusion" if word in INCLUSIONS else "inclusion"
    for properties in ({"kind": word}, {"name": f"North {word} 2"}):
        text = json.dumps(feature("Polygon", [RING], **properties))
        assert imported(("a.geojson", text), polygons=other).mission["zone"][0]["kind"] == expected


@pytest.mark.parametrize("kind", ["inclusion", "exclusion"])
def test_a_polygon_that_does_not_state_its_kind_has_that_of_the_option(kind: str) -> None:
    """And the output says which it took, and why."""
    text = json.dumps({"type": "Polygon", "coordinates": [RING]})
    found = imported(("a.json", text), polygons=kind)
    assert found.mission["zone"][0]["kind"] == kind
    assert f"read as {kind} zone: " in found.remarks[0]
    assert "--polygons inclusion" in found.remarks[0]


def test_a_fence_that_does_not_state_its_kind_is_told_by_the_uav_in_it() -> None:
    """The user sees a no-fly zone where the fence is, and how to make it one."""
    field = json.dumps(feature("Polygon", [RING], name="my site"))
    line = json.dumps(feature("LineString", [[8.5456, 47.3978], [8.5458, 47.3978]]))
    with pytest.raises(FormatError, match=r"exclusion zone 'my site' .* --polygons inclusion makes it a fence\)"):
        imported(("a.geojson", line), ("b.geojson", field))


def test_points_are_a_route_per_uav() -> None:
    """Start first, target last, others in the order of the file."""
    points = [
        feature("Point", [8.5460, 47.3980], uav="a", kind="target"),
        feature("Point", [8.5452, 47.3972], uav="a", kind="start"),
        feature("Point", [8.5455, 47.3975], uav="a", hover_s=2),
        feature("Point", [8.5465, 47.3972], uav="b"),
        feature("Point", [8.5465, 47.3985], uav="b"),
    ]
    found = imported(("a.geojson", json.dumps({"type": "FeatureCollection", "features": points})))
    assert_near(in_degrees(found.mission, 0), [(47.3972, 8.5452), (47.3975, 8.5455), (47.3980, 8.5460)])
    assert_near(in_degrees(found.mission, 1), [(47.3972, 8.5465), (47.3985, 8.5465)])
    assert found.mission["roster"][0]["hover_s"] == [2.0, 0.0]


def kml(body: str, version: str = "2.2", head: str = '<?xml version="1.0" encoding="UTF-8"?>\n') -> str:
    """A KML file."""
    space = f' xmlns="http://www.opengis.net/kml/{version}" xmlns:gx="http://www.google.com/kml/ext/2.2"'
    return f"{head}<kml{space}><Document><Style id='s'/><Folder><name>f</name>{body}</Folder></Document></kml>"


LINE = (
    "<Placemark><name>way</name><LineString><coordinates>8.5452,47.3972,5 8.5465,47.3988,5</coordinates></LineString>"
    "</Placemark>"
)
AREA = (
    "<Placemark><name>No fly</name><Polygon><outerBoundaryIs><LinearRing><coordinates>8.5455,47.3982 8.5457,47.3982 "
    "8.5457,47.3984 8.5455,47.3982</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark>"
)
TRACK = (
    "<Placemark><gx:Track><when>2020-01-01T00:00:00Z</when><when>2020-01-01T00:00:01Z</when>"
    "<gx:coord>8.5468 47.3972 3</gx:coord><gx:coord>8.5468 47.3980 3</gx:coord></gx:Track></Placemark>"
)
MULTI = (
    "<Placemark><ExtendedData><Data name='uav'><value>m1</value></Data></ExtendedData><MultiGeometry>"
    "<LineString><coordinates>\n 8.5462, 47.3972\n 8.5463, 47.3980 </coordinates></LineString></MultiGeometry>"
    "</Placemark>"
)


@pytest.mark.parametrize("version", ["2.0", "2.1", "2.2", "2.3"])
def test_kml_as_fastkml_reads_it(version: str) -> None:
    """Lines, tracks, parts of several geometries and polygons; the same coordinates as fastkml finds in KML 2.2."""
    text = kml(LINE + AREA + TRACK + MULTI, version)
    found = imported(("a.kml", text))
    mine = [in_degrees(found.mission, index) for index in range(3)]
    tree = fastkml.KML.from_string(kml(LINE + AREA + TRACK + MULTI, head=""))
    marks: list[Any] = list(find_all(tree, of_type=fastkml.Placemark))
    line = [(lat, lon) for lon, lat, *_ in marks[0].geometry.coords]
    track = [(lat, lon) for lon, lat, *_ in marks[2].geometry.coords]
    assert_near(mine[0], line)
    assert_near(mine[1], track)
    assert_near(mine[2], [(47.3972, 8.5462), (47.3980, 8.5463)])
    assert [entry["uav"] for entry in found.mission["roster"]] == ["u001", "u002", "m1"]
    (zone,) = found.mission["zone"]
    assert (zone["name"], zone["kind"], len(zone["polygon"])) == ("No fly", "exclusion", 3)
    notes = found.notes["a.kml"]
    assert "times of a track: the route is flown at the mission's speed" in notes
    assert "styles, descriptions and views" in notes
    assert len(notes["altitude: the mission is flown in a plane"]) == 2


def test_kml_without_namespaces_and_with_undeclared_prefixes() -> None:
    """As many writers leave them out."""
    found = imported(("a.kml", f"<kml><Document>{LINE}{TRACK}</Document></kml>"))
    assert len(found.mission["roster"]) == 2


def test_kml_in_latin_1() -> None:
    """The file states its encoding."""
    text = kml(AREA.replace("No fly", "Fl\u00fcche no-fly"), head='<?xml version="1.0" encoding="ISO-8859-1"?>')
    assert imported(("a.kml", text.encode("latin-1"))).mission["zone"][0]["name"] == "Fl\u00fcche no-fly"


def kmz(*entries: tuple[str, bytes]) -> bytes:
    """An archive."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in entries:
            archive.writestr(name, data)
    return out.getvalue()


def test_kmz_is_kml_in_an_archive() -> None:
    """doc.kml is read, wherever it stands."""
    data = kmz(("other.kml", b"<kml/>"), ("files/icon.png", b"\x89PNG"), ("doc.kml", kml(LINE).encode()))
    assert imported(("a.kmz", data)).mission == imported(("a.kml", kml(LINE))).mission


def test_folders_side_by_side_and_within_each_other() -> None:
    """All are read, in the order of the file."""
    line = "<Placemark><LineString><coordinates>8.54{0},47.39 8.54{0},47.40</coordinates></LineString></Placemark>"
    inner = f"<Folder>{line.format(5)}</Folder>"
    text = kml(f"<Folder>{inner}{line.format(6)}</Folder><Document>{line.format(7)}</Document>{line.format(8)}")
    found = imported(("a.kml", text))
    assert [round(in_degrees(found.mission, k)[0][1], 3) for k in range(4)] == [8.545, 8.546, 8.547, 8.548]
    assert len(found.mission["roster"]) == 4


def test_csv_with_commas_semicolons_and_decimal_commas() -> None:
    """The same way points, three times; unknown columns and altitudes are listed."""
    plain = (
        "UAV,Latitude,Longitude,Altitude (m),hover_s,heading\n"
        "a,47.1,8.5,20,,90\nb,47.1005,8.5,20,,\na,47.1002,8.5003,20,3,\n"
    )
    german = (
        "UAV;Latitude;Longitude;Altitude (m);hover_s;heading\r\n"
        "a;47,1;8,5;20;;90\r\nb;47,1005;8,5;20;;\r\na;47,1002;8,5003;20;3;\r\n"
    )
    tabs = plain.replace(",", "\t")
    missions = [imported((f"a{i}.csv", text)).mission for i, text in enumerate([plain, german, tabs])]
    assert missions[0] == missions[1] == missions[2]
    assert_near(in_degrees(missions[0], 0), [(47.1, 8.5), (47.1002, 8.5003)])
    assert missions[0]["roster"][0]["hover_s"] == [3.0]
    notes = imported(("a.csv", plain)).notes["a.csv"]
    assert notes["column heading"] == ["column 6"]
    assert notes["altitude: the mission is flown in a plane"] == ["line 2", "line 3", "line 4"]


def test_csv_with_units_in_brackets() -> None:
    """Those in which the numbers are read; others are refused (`test_formats_bad`)."""
    text = "x (m),y [m],hover_s (s),speed_mps (m/s)\n0,1.5,0,3\n10,20,2,3\n"
    found = imported(("a.csv", text), settings=Settings())
    assert way(found.mission) == [(0.0, 1.5), (10.0, 20.0)]
    assert found.mission["v_max_mps"] == 3.0


def test_csv_in_metres() -> None:
    """Used as it is, without an origin."""
    found = imported(("a.csv", "x_m,y_m,r_m,v_max_mps\n0,1.5,2,3\n10,20,2,3\n"), settings=Settings())
    assert way(found.mission) == [(0.0, 1.5), (10.0, 20.0)]
    assert (found.mission["r_m"], found.mission["v_max_mps"]) == (2.0, 3.0)
    assert "origin_lat_deg" not in found.mission


MAP = """type octile
height 7
width 8
map
@@@@@@@@
@......@
@.@@...@
@.@.@..@
@.TTT..W
@.....G@
@@@@@@@@
"""
SCEN = "version 1\n0\tm.map\t8\t7\t1\t1\t6\t5\t8\n0\tm.map\t8\t7\t6\t1\t1\t5\t8\n0\tm.map\t8\t7\t5\t5\t5\t1\t4\n"


def test_a_map_and_its_scenario() -> None:
    """The ring of walls is a fence, the block inside is an exclusion with its hole closed; cells are 4 m wide."""
    found = imported(("m.map", MAP), ("m.scen", SCEN), settings=Settings(), cell_m=4.0, agents=2)
    fence, block = found.mission["zone"]
    assert Polygon(fence["polygon"]).equals(box(4, 4, 28, 24))
    assert (fence["kind"], fence["keep"]) == ("inclusion", "disc")
    cells = [(2, 4), (3, 4), (2, 3), (3, 3), (4, 3), (2, 2), (3, 2), (4, 2)]
    assert Polygon(block["polygon"]).equals(unary_union([box(4 * c, 4 * r, 4 * c + 4, 4 * r + 4) for c, r in cells]))
    assert way(found.mission, 0) == [(6.0, 22.0), (26.0, 6.0)]
    assert found.mission["r_m"] == pytest.approx(0.8)
    notes = found.notes["m.map, m.scen"]
    assert notes["agents beyond --agents"] == ["line 4"]
    assert notes["free cells that no UAV can reach: they are closed"] == ["1 cells"]
    assert notes["terrain T: trees, blocked"] == ["3 cells"]


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("most", [1000, 12])
def test_polygons_cover_just_the_cells(seed: int, most: int) -> None:
    """Random sets of cells, with holes and corners that touch: shapely says that all is covered, once, simply."""
    state = seed * 7919 + 1
    cells = set()
    for column in range(12):
        for row in range(12):
            state = (state * 1103515245 + 12345) % 2**31
            if state % 100 < 30 + 2 * seed:
                cells.add((column, row))
    found = [Polygon(loop) for loop in polygons(cells, most)]
    assert all(polygon.is_valid and len(polygon.exterior.coords) <= most + 1 for polygon in found)
    assert sum(polygon.area for polygon in found) == len(cells)
    assert unary_union(found).symmetric_difference(unary_union([box(c, r, c + 1, r + 1) for c, r in cells])).area == 0


LSC = {
    "quadrotors": {
        "crazyflie": {"max_vel": [1.0, 1.0, 0.5], "max_acc": [2, 2, 2], "radius": 0.15, "downwash": 2.0},
        "big": {"max_vel": [2.0, 2.0, 0.5], "max_acc": [2, 2, 2], "radius": 0.3, "downwash": 2.0},
    },
    "world": [{"dimension": [-5, -5, 0, 5, 5, 2.5]}],
    "agents": [
        {"type": "crazyflie", "cid": 1, "start": [4, 0, 1], "goal": [-4, 0, 1]},
        {"type": "big", "cid": 2, "start": [0, 4, 1], "goal": [0, -4, 1]},
    ],
}


def test_a_planar_lsc_mission() -> None:
    """The world is a fence; radius and speed are those of the quadrotor."""
    found = imported(("a.json", json.dumps(LSC)), settings=Settings())
    first, second = found.mission["roster"]
    assert (first["r_m"], first["v_max_mps"]) == (0.15, 1.0)
    assert (found.mission["r_m"], found.mission["v_max_mps"], found.mission["body_m"]) == (0.3, 2.0, 0.15)
    assert "r_m" not in second
    assert way(found.mission, 1) == [(0.0, 4.0), (0.0, -4.0)]
    assert Polygon(found.mission["zone"][0]["polygon"]).equals(box(-5, -5, 5, 5))
    assert "field downwash of a quadrotor" in found.notes["a.json"]


def test_distances_in_the_plane_are_those_on_the_earth() -> None:
    """Legs of a route near its origin are as long as geographiclib says, to the rounding of a millimetre."""
    found = imported(("a.waypoints", WPL))
    origin = found.mission["origin_lat_deg"], found.mission["origin_lon_deg"]
    for here, there in pairwise(way(found.mission)):
        one, two = to_wgs84(*here, *origin), to_wgs84(*there, *origin)
        assert Geodesic.WGS84.Inverse(*one, *two)["s12"] == pytest.approx(math.dist(here, there), abs=1e-3)


def test_the_option_sets_the_origin() -> None:
    """Then metres and degrees fit together, too."""
    settings = Settings(origin=(47.0, 8.0), r_m=0.5)
    found = imported(("a.csv", "x,y\n0,0\n10,0\n"), ("b.csv", "lat,lon\n47.001,8\n47.002,8\n"), settings=settings)
    assert way(found.mission, 0) == [(0.0, 0.0), (10.0, 0.0)]
    assert way(found.mission, 1)[0] == (0.0, pytest.approx(111.17, abs=0.05))
    assert shapely.geometry.LineString(way(found.mission, 1)).length == pytest.approx(111.17, abs=0.05)
