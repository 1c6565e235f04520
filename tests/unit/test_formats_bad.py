"""Bad files: one line with file, item and what it must be; status 2; nothing written."""

from __future__ import annotations

import json
import math
import re
import zipfile
from io import BytesIO
from pathlib import Path
from typing import Any

import pytest

from edc_swarm.geodesy import to_wgs84
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.validation import load_mission
from processes.cli.main import main
from tests.unit.test_formats_read import (
    AREA,
    HOME,
    LINE,
    LSC,
    MAP,
    RING,
    SCEN,
    SQUARE,
    WPL,
    feature,
    item,
    kml,
    kmz,
    plan,
)


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run in an empty folder."""
    monkeypatch.chdir(tmp_path)


def refusal(capsys: pytest.CaptureFixture[str], *files: tuple[str, str | bytes], options: str = "") -> str:
    """The line that `edc-swarm import` says about the files."""
    for name, data in files:
        Path(name).write_bytes(data.encode() if isinstance(data, str) else data)
    assert main(["import", *(name for name, _ in files), "-o", "m.toml", *options.split()]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert not Path("m.toml").exists()
    (line,) = said.err.splitlines()
    assert line.startswith("error: ")
    assert "must" in line
    return line


def row(
    index: int, command: int = 16, frame: int = 3, lat: object = 47.39, lon: object = 8.54, first: object = 0
) -> str:
    """A row of a way point file."""
    return f"{index}\t0\t{frame}\t{command}\t{first}\t0\t0\t0\t{lat}\t{lon}\t10\t1\n"


def wpl(*rows: str) -> str:
    """A way point file with a home."""
    return "QGC WPL 110\n" + row(0, frame=0) + "".join(rows)


def collection(*features: dict[str, Any]) -> str:
    """A GeoJSON file."""
    return json.dumps({"type": "FeatureCollection", "features": list(features)})


def fence(*corners: list[float]) -> str:
    """A plan with a fence."""
    return plan(fence={"polygons": [{"polygon": corners, "inclusion": True, "version": 1}]})


BOW = [[8.545, 47.397], [8.547, 47.399], [8.547, 47.397], [8.545, 47.399], [8.545, 47.397]]
BOMB = (
    '<?xml version="1.0"?><!DOCTYPE kml [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;&a;">]>'
    "<kml><Document><name>&b;</name></Document></kml>"
)
DEEP = "<kml>" + "<Folder>" * 5000 + "</Folder>" * 5000 + "</kml>"

MANY_BLOCKS = "type octile\nheight 100\nwidth 100\nmap\n" + ("@." * 50 + "\n" + "." * 100 + "\n") * 50
MANY_CORNERS = (
    "type octile\nheight 90\nwidth 90\nmap\n" + ("@@." * 30 + "\n" + "@.." * 30 + "\n" + "." * 90 + "\n") * 30
)


def broken_archive() -> bytes:
    """An archive with a byte of the compressed data changed."""
    data = bytearray(kmz(("doc.kml", kml(LINE * 50).encode())))
    data[60] ^= 0xFF
    return bytes(data)


def locked_archive() -> bytes:
    """An archive that says that it is encrypted."""
    data = bytearray(kmz(("doc.kml", kml(LINE).encode())))
    data[6] |= 1
    data[data.index(b"PK\x01\x02") + 8] |= 1
    return bytes(data)


def bomb_archive() -> bytes:
    """An archive of some kilobytes that unpacks to 64 MB."""
    out = BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("doc.kml", b" " * (64 << 20))
    assert len(out.getvalue()) < 100_000
    return out.getvalue()


def named_twice(*names: str) -> str:
    """A line of KML with data of these names."""
    data = "".join(f'<Data name="{name}"><value>2</value></Data>' for name in names)
    return LINE.replace("<LineString>", f"<ExtendedData>{data}</ExtendedData><LineString>")


BAD: list[tuple[str, str | bytes, str]] = [
    # The wrong kind of file, or a part of one.
    ("a.plan", "", "a.plan: an empty file"),
    ("a.plan", b"\x89PNG\r\n\x1a\n\0\0", "a.plan: "),
    ("a.bin", b"\x89PNG\r\n\x1a\n\0\0", "a.bin: unknown format"),
    ("a.plan", WPL, "looks like MAVLink way points"),
    ("a.kml", plan(), "looks like QGroundControl plan"),
    ("a.plan", plan(item(16, *HOME))[:-40], "whole, valid JSON"),
    ("a.geojson", collection(feature("Polygon", [RING]))[:-10], "whole, valid JSON"),
    ("a.plan", '{"fileType": "Plan", "x": ' + "[" * 100_000, "fewer levels"),
    ("a.plan", '{"fileType": "Mission"}', "fileType: 'Mission': must be 'Plan'"),
    ("a.plan", '{"fileType": "Plan", "mission": []}', "mission: must be a JSON object"),
    ("a.waypoints", "QGC WPL 120\n" + row(0), "line 1: 'QGC WPL 120': must be 'QGC WPL 110'"),
    ("a.waypoints", "QGC WPL 110\n", "at least one item"),
    ("a.waypoints", wpl(row(1)[:-10]), "line 3: 9 columns: must be 12"),
    ("a.waypoints", WPL.encode("utf-16")[:-1], "text in UTF-8"),
    ("a.csv", "lat;lon\n47;8\n48;\u00e4\n".encode("latin-1"), "byte 16: must be text in UTF-8"),
    ("a.kml", kml(LINE)[:-80], "whole, valid XML"),
    ("a.kml", kml(LINE, head='<?xml version="1.0" encoding="klingon"?>'), "line 1: must be"),
    ("a.kmz", kmz(("doc.kml", kml(LINE).encode()))[:200], "whole zip archive"),
    ("a.kmz", broken_archive(), "whole zip archive"),
    ("a.kmz", locked_archive(), "without a password"),
    ("a.kmz", kmz(("readme.txt", b"hello")), "an archive that holds a .kml file"),
    # Bombs.
    ("a.kmz", bomb_archive(), "doc.kml: must be at most 16777216 bytes when unpacked"),
    ("a.kml", BOMB, "must have no document type declaration"),
    ("a.kml", DEEP, "levels"),
    ("a.csv", "lat,lon\n" + "47.0,8.0\n" * 20_001, "20001 rows"),
    ("a.csv", "lat,lon\n" + "47.0,8.0\n" * (2 << 20), "at most 16777216 bytes"),
    ("a.waypoints", wpl(*(row(i, lat=47.39 + i / 1e6) for i in range(1, 1002))), "1002 points: must be at most 1000"),
    # Commands and frames.
    ("a.waypoints", wpl(row(1), row(2, command=31999)), "item 2: command = 31999: must be a known MAVLink command"),
    ("a.waypoints", wpl(row(1), row(2, frame=1)), "item 2: frame = 1: must be global, as at item 1"),
    ("a.waypoints", wpl(row(1, frame=8)), "item 1: frame = 8: must be a global frame"),
    ("a.waypoints", wpl(row(1), row(2, frame=0)), "item 2: frame = 0 (altitude above sea level): must count"),
    ("a.plan", plan(item(16, *HOME), item(16, *HOME, frame=10)), "item 2: frame = 10 (altitude above the terrain)"),
    ("a.plan", plan(item(16, *HOME) | {"command": 16.5}), "item 1: command = 16.5: must be a whole number"),
    ("a.plan", plan(item(16, *HOME) | {"params": [0] * 6}), "item 1: 6 params: must be 7"),
    ("a.plan", plan(item(16, *HOME) | {"type": "Other"}), "item 1: type = 'Other': must be SimpleItem or ComplexItem"),
    # Numbers.
    ("a.waypoints", wpl(row(1, lat=95)), "item 1: latitude = 95.0: must be from -90 to 90"),
    ("a.waypoints", wpl(row(1, lon=181)), "item 1: longitude = 181.0: must be from -180 to 180"),
    ("a.waypoints", wpl(row(1, lat="nan")), "item 1: position of NAV_WAYPOINT: must be two finite numbers"),
    ("a.waypoints", wpl(row(1, lat="inf")), "line 3: 'inf': must be a number"),
    ("a.plan", plan(item(16, None, None)), "item 1: position of NAV_WAYPOINT: must be two finite numbers"),
    ("a.plan", plan(item(16, *HOME)).replace("8.545594,", "NaN,", 1), "valid JSON"),
    ("a.plan", plan(item(16, *HOME), item(16, 0, 8.5)), "km from the origin"),
    ("a.csv", "lat,lon\n47,8\nnan,8\n", "line 3: lat = nan: must be a finite number"),
    ("a.csv", "lat,lon\n47,8\n,8\n", "line 3: lat = '': must be a finite number"),
    ("a.csv", "lat,lon\n47,8\n47\n", "line 3: 1 columns: must be 2"),
    ("a.csv", "lat,lon,x,y\n47,8,0,0\n", "must name lat and lon, or x and y, not both"),
    ("a.csv", "lat,lon,longitude\n47,8,8\n", "must name lon once"),
    ("a.csv", "name,where\n47,8\n", "must name lat and lon"),
    ("a.csv", "x (ft),y (ft)\n0,0\n300,0\n", "line 1: column 'x (ft)': must be in m"),
    ("a.csv", "lat,lon,hover [min]\n47,8,2\n", "line 1: column 'hover [min]': must be in s"),
    ("a.csv", "lat,lon\n", "0 rows"),
    ("a.csv", 'lat,lon\n47,"8\n', "must be CSV"),
    ("a.csv", "x,y\n1e9,0\n", "must be within 1e+07 m"),
    ("a.txt", "47 8\n47.1 8.1\n47.2 x\n", "line 3: longitude = 'x': must be a finite number"),
    ("a.txt", "47 8\n47.1 8.1 3\n", "line 2: 3 columns: must be latitude and longitude"),
    ("a.txt", "47 8\n", "must hold a return point and the corners of a polygon"),
    ("a.waypoints", wpl(row(1, lat="4_7.39")), "line 3: '4_7.39': must be a number"),
    ("a.csv", "x,y\n0,\u0665\n", "line 2: y = '\u0665': must be a finite number"),
    ("a.csv", "uav,x,y\na,0,0\n,50,0\n", "line 3: uav = '': must name a UAV, as other rows do"),
    ("a.geojson", collection(feature("LineString", RING[:2], kind="no fly")), "'no-fly': must be that of a polygon"),
    ("a.geojson", collection(*[feature("Point", RING[0], kind="home")] * 2), "feature 2: kind = 'home': must be that"),
    (
        "a.geojson",
        collection(*[feature("Point", at, kind="start") for at in RING[:2]]),
        "feature 2: kind = 'start': must",
    ),
    ("m.map", MAP.replace("octile", "hex"), "line 1: 'type hex': must be type octile"),
    ("a.kml", kml(LINE.replace("47.3988", "97.3988")), "latitude = 97.3988: must be from -90 to 90"),
    ("a.kml", kml(LINE.replace("47.3988", "")), "latitude = '': must be a finite number"),
    ("a.geojson", collection(feature("LineString", [[8, 47], [8, 91]])), "feature 1, point 2: latitude = 91.0"),
    ("a.geojson", collection(feature("LineString", [[8, 47], ["8", 47]])), "longitude = '8': must be a finite number"),
    ("a.geojson", collection(feature("LineString", [[8, 47], [10**400, 47]])), "must be"),
    ("a.geojson", collection(feature("LineString", [[8, 47]])), "feature 1: 1 points of a line: must be at least 2"),
    ("a.geojson", collection(feature("Circle", [8, 47])), "feature 1: type = 'Circle': must be a geometry"),
    ("a.geojson", '{"type": "Point", "coordinates": [8]}', "must be longitude and latitude"),
    (
        "a.geojson",
        json.dumps({"type": "FeatureCollection", "crs": {"properties": {"name": "EPSG:3067"}}, "features": []}),
        "crs: 'EPSG:3067': must be WGS 84",
    ),
    # Zones.
    ("a.geojson", collection(feature("Polygon", [BOW])), "meet: must be a simple polygon"),
    ("a.geojson", collection(feature("Polygon", [RING[:2]])), "feature 1: it has 2 corners, fewer than three: must be"),
    ("a.geojson", collection(feature("Polygon", [RING[:2] * 2])), "are the same point"),
    ("a.geojson", collection(feature("Polygon", [RING], kind="park")), "kind = 'park': must be inclusion or exclusion"),
    ("a.geojson", collection(feature("Point", [8, 47], radius_m=-1)), "radius = -1 m: must be above 0 m"),
    ("a.geojson", collection(feature("Polygon", [RING], keep="wing")), "keep = 'wing': must be disc or centre"),
    ("a.txt", "47 8\n47.1 8.1\n47.2 8.1\n", "it has 2 corners, fewer than three"),
    ("a.plan", fence(SQUARE[0], SQUARE[2], SQUARE[1], SQUARE[3]), "meet: must be a simple polygon"),
    ("a.plan", fence(*SQUARE[:2]), "geofence polygon 1: it has 2 corners"),
    (
        "a.plan",
        plan(fence={"circles": [{"circle": {"center": HOME, "radius": 0}, "inclusion": True}]}),
        "circle 1: radius",
    ),
    (
        "a.plan",
        plan(fence={"circles": [{"circle": {"center": HOME, "radius": 5}}]}),
        "circle 1: inclusion: must be true or false",
    ),
    ("a.waypoints", wpl(row(1, 5001, first=4), row(2, 5001, first=4, lat=48)), "corners of the polygon = 2: must be 4"),
    ("a.waypoints", wpl(row(1, 5001, first=4), row(2, 5002, first=4)), "item 2: must continue the polygon"),
    ("m.map", MANY_BLOCKS, "2501 zones of its cells: must be at most 1000"),
    ("m.map", MANY_CORNERS, "5404 corners in all zones: must be at most 5000"),
    # Way points that a zone forbids.
    (
        "a.geojson",
        collection(feature("LineString", [[8.544, 47.398], [8.546, 47.398]]), feature("Polygon", [RING])),
        "a.geojson: feature 1, point 2: target of u001: must be outside exclusion zone 'zone 1' with its whole disc",
    ),
    (
        "a.geojson",
        collection(feature("LineString", [[8.546, 47.398], [8.549, 47.398]]), feature("Polygon", [RING], name="fence")),
        "a.geojson: feature 1, point 2: target of u001: must be inside inclusion zone 'fence' with its centre, not 15",
    ),
    # Discs that overlap.
    (
        "a.csv",
        "uav,x,y\na,0,0\na,0,50\nb,8,0\nb,50,50\n",
        "line 2: start of a: must be at least 10 m from the start of b, not 8.000 m (--r 4 fits all starts)",
    ),
    (
        "a.csv",
        "uav,x,y\na,0,0\na,50,50\nb,20,0\nb,50,50\n",
        "line 3: target of a: must be at least 10 m from the target of b, not 0.000 m (no --r fits)",
    ),
    ("a.csv", "uav,x,y,r_m\na,0,0,-1\n", "line 2 to line 2: r_m = -1: must be above 0"),
    ("a.geojson", collection(*[feature("LineString", [[8, 47], [8.1, 47]], uav="a")] * 2), "uav = 'a': must be an id"),
    # A name twice.
    (
        "a.plan",
        plan().replace('"version"', '"groundStation": "", "version"', 1),
        "a.plan: key 'groundStation': 2 times",
    ),
    (
        "a.plan",
        plan(item(16, *HOME)).replace('"frame": 3', '"frame": 3, "frame": 0', 1),
        "a.plan: key 'frame': 2 times",
    ),
    (
        "a.geojson",
        collection(feature("Point", HOME)).replace('"type"', '"type": "X", "type"', 1),
        "key 'type': 2 times",
    ),
    (
        "a.geojson",
        collection(feature("LineString", RING[:2], uav="a")).replace('"uav"', '"uav": "b", "\\u0075av"', 1),
        "a.geojson: key 'uav': 2 times in one object: must be there once",
    ),
    ("a.json", json.dumps(LSC).replace('"radius"', '"radius": 1, "radius"', 1), "a.json: key 'radius': 2 times"),
    (
        "a.kml",
        kml(LINE.replace("<coordinates>", "<coordinates>8,47 8,48</coordinates><coordinates>")),
        "element coordinates: must be there once in linestring",
    ),
    ("a.kml", kml(named_twice("r_m", "r_m")), "property 'r_m': must be there once"),
    (
        "m.map",
        MAP.replace("height 7", "height 7\nheight 7"),
        "line 3: 'height 7': must be type octile, height, width or map, each once",
    ),
    # MAPF.
    ("m.scen", SCEN, "must be given together with its .map"),
    ("m.map", MAP.replace("height 7", "height 9"), "rows of the map: must be 9"),
    ("m.map", MAP.replace("height 7", "height x"), "height: 'x': must be a whole number from 1"),
    ("m.map", MAP.replace("height 7", "height 9999999"), "must be at most 1048576"),
    ("m.map", MAP.replace("@......@", "@.....@", 1), "line 6: 7 cells: must be 8"),
    ("m.map", MAP.replace("G", "?"), "line 10: cell '?': must be one of . G S @ O T W"),
    ("m.map", "type octile\nheight 1\nwidth 1\nmap\n@\n", "must have a free cell"),
    # LSC.
    ("a.json", json.dumps(LSC).replace("[-4, 0, 1]", "[-4, 0, 2]"), "agent 1: (-4, 0, 2): must be at z = 1"),
    ("a.json", json.dumps(LSC | {"agents": []}), "0 agents: must be from 1 to 10000"),
    ("a.json", json.dumps(LSC).replace('"radius": 0.15, ', ""), "quadrotor crazyflie: radius = None: must be a finite"),
    ("a.json", json.dumps(LSC).replace("[4, 0, 1]", "[4, 0]"), "agent 1 start: 2 numbers: must be 3"),
    ("a.json", json.dumps(LSC).replace('"type": "big"', '"type": "bigger"'), "agent 2: type = 'bigger'"),
]


@pytest.mark.parametrize(("name", "data", "named"), BAD)
def test_one_line_with_file_item_and_reason(
    capsys: pytest.CaptureFixture[str], name: str, data: str | bytes, named: str
) -> None:
    """Each kind of bad file."""
    line = refusal(capsys, (name, data))
    assert name in line
    assert named in line


@pytest.mark.parametrize(
    ("scenario", "named"),
    [
        (SCEN.replace("\t8\t7\t1", "\t9\t7\t1", 1), "m.scen: line 2: map of 9 x 7 cells: must be 8 x 7"),
        (SCEN.replace("8\t7\t1\t1", "8\t7\t0\t1"), "m.scen: line 2: start = column 0, row 1: must be a free cell"),
        (SCEN.replace("8\t7\t1\t1", "8\t7\t2\t3"), "m.scen: line 2: start = column 2, row 3: must be a free cell"),
        (SCEN.replace("8\t7\t1\t1", "8\t7\t3\t3"), "m.scen: line 2: the goal: must be reachable from the start"),
        (SCEN.replace("8\t7\t1\t1", "8\t7\t-1\t1"), "'-1': must be a whole number"),
        ("version 1\n", "m.scen: must hold at least one agent"),
        ("version 1\n0\tm.map\t8\t7\n", "m.scen: line 2: 4 columns: must be 9"),
    ],
)
def test_scenarios_that_do_not_fit_their_map(capsys: pytest.CaptureFixture[str], scenario: str, named: str) -> None:
    """The line of the scenario is named."""
    assert named in refusal(capsys, ("m.map", MAP), ("m.scen", scenario))


def test_frames_of_several_files_must_fit(capsys: pytest.CaptureFixture[str]) -> None:
    """Metres and degrees have no common origin, unless the user states one."""
    files = ("a.csv", "x,y\n0,0\n"), ("b.csv", "lat,lon\n47,8\n")
    assert "a.csv: positions in metres beside latitudes and longitudes" in refusal(capsys, *files)
    assert main(["import", "a.csv", "b.csv", "--origin", "47.001,8", "-o", "m.toml"]) == 0


def test_starts_at_one_home_are_refused_with_the_remedy(capsys: pytest.CaptureFixture[str]) -> None:
    """Several plans from one home begin at their first way points, if the user says so."""
    files = [
        (f"{name}.plan", plan(item(16, 47.3979, lon), item(16, 47.3989, lon)))
        for name, lon in (("a", 8.545), ("b", 8.546))
    ]
    line = refusal(capsys, *files)
    assert "start of u001: must be at least 10 m from the start of u002, not 0.000 m" in line
    assert "no --r fits, --start first begins at way points" in line
    assert main(["import", "a.plan", "b.plan", "--start", "first", "-o", "m.toml"]) == 0


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ("--origin 95,8", "--origin = '95,8': must be LAT,LON"),
        ("--origin here", "--origin = 'here'"),
        ("--r 0", "--r = 0.0"),
        ("--r nan", "--r = nan"),
        ("--slot 0", "--slot = 0.0"),
        ("--speed-max -1", "--speed-max = -1.0"),
        ("--cell 0", "--cell = 0.0"),
        ("--agents 0", "--agents = 0"),
        ("--polygons both", "--polygons = 'both': must be one of inclusion, exclusion"),
        ("--start now", "--start = 'now': must be one of home, first"),
    ],
)
def test_bad_options(capsys: pytest.CaptureFixture[str], options: str, named: str) -> None:
    """Each is named with its value and what is allowed."""
    assert named in refusal(capsys, ("a.kml", kml(AREA)), options=options)


def test_files_that_are_none(capsys: pytest.CaptureFixture[str]) -> None:
    """A missing file, a folder, a file twice, no file at all."""
    Path("d.plan").mkdir()
    assert main(["import", "no.plan"]) == 2
    assert "no.plan: must be a readable file" in capsys.readouterr().err
    assert main(["import", "d.plan"]) == 2
    assert "d.plan: must be a readable file (not a regular file: it is a folder)" in capsys.readouterr().err
    assert main(["import"]) == 2
    assert re.search(r"files = '': must be given", capsys.readouterr().err, re.IGNORECASE)
    Path("a.csv").write_text("x,y\n0,0\n")
    assert main(["import", "a.csv", "a.csv"]) == 2
    assert "a.csv: must be given once" in capsys.readouterr().err


def test_no_mission_is_written_that_sim_refuses(capsys: pytest.CaptureFixture[str]) -> None:
    """A point on the edge of a fence, a way that zones close, a battery too small for one step, two fences apart."""
    points = [[8.545, 47.398], [8.546, 47.398]]
    ring = feature("Polygon", [RING], kind="inclusion")
    line = refusal(capsys, ("a.json", collection(feature("LineString", points), ring)))
    assert "a.json: feature 1, point 1: start of u001: must be inside inclusion zone 'zone 1' with its centre" in line
    wall = feature("Polygon", [[[8.5455, 47], [8.5456, 47], [8.5456, 48], [8.5455, 48], [8.5455, 47]]], kind="no-fly")
    points[0][0] += 0.0001
    line = refusal(capsys, ("a.json", collection(feature("LineString", points), ring, wall)))
    assert "a.json: feature 1, point 2: target of u001: must be reachable from its start" in line
    assert "closed by zones" in line
    assert "roster[0].energy_j" in refusal(capsys, ("a.csv", "x,y\n0,0\n9000,0\n"), options="--speed-max 900 --r 500")
    apart = [{"circle": {"center": [lat, 8.545], "radius": 40}, "inclusion": True} for lat in (47.39, 47.40)]
    line = refusal(capsys, ("a.plan", plan(fence={"circles": apart})))
    assert "a.plan: cannot be flown: uavs = 1: must be few enough for area_m2 = 10000, its zones and r_m = 5" in line


@pytest.mark.parametrize(("inclusion", "uavs"), [(True, 3), (False, 10)])
def test_a_fence_alone_is_a_mission_that_flies(capsys: pytest.CaptureFixture[str], inclusion: bool, uavs: int) -> None:
    """The area is where the fence is, or round the stay-out zone; a small one gets as many UAVs as fit."""
    circle = {"circle": {"center": HOME, "radius": 12}, "inclusion": inclusion}
    Path("a.plan").write_text(plan(fence={"circles": [circle]}))
    assert main(["import", "a.plan", "-o", "m.toml"]) == 0
    assert f"no file holds a route: the mission draws its UAVs ({uavs})" in capsys.readouterr().out
    mission = complete_mission(load_mission("m.toml"))
    assert len(mission.roster) == mission.uavs == uavs
    (x_m, y_m), radius_m = mission.zone[0].centre, mission.zone[0].radius_m
    away_m = [math.hypot(entry.start_x_m - x_m, entry.start_y_m - y_m) for entry in mission.roster]
    assert all(away < radius_m if inclusion else away > radius_m + mission.r_m for away in away_m)
    lat_deg, lon_deg = to_wgs84(x_m, y_m, mission.origin_lat_deg, mission.origin_lon_deg)
    assert (lat_deg, lon_deg) == (pytest.approx(HOME[0], abs=2e-8), pytest.approx(HOME[1], abs=2e-8))


def test_an_existing_mission_is_not_overwritten(capsys: pytest.CaptureFixture[str]) -> None:
    """Nor is one written under another suffix."""
    Path("a.kml").write_text(kml(AREA))
    assert main(["import", "a.kml", "-o", "m.txt"]) == 2
    assert "--out = 'm.txt': must be a name that ends in .toml" in capsys.readouterr().err
    assert main(["import", "a.kml", "-o", "m.toml"]) == 0
    assert main(["import", "a.kml", "-o", "m.toml"]) == 2
    assert "a new file (or give --force)" in capsys.readouterr().err
    assert main(["import", "a.kml", "-o", "m.toml", "--force"]) == 0


def test_what_users_may_allow(capsys: pytest.CaptureFixture[str]) -> None:
    """Unknown commands are listed, and mixed altitudes read, if the user says so."""
    Path("a.waypoints").write_text(wpl(row(1), row(2, command=31999), row(3, frame=0, lat=47.3901)))
    assert main(["import", "a.waypoints", "--list-unknown", "--mixed-altitudes"]) == 0
    assert "unknown MAVLink command 31999: in 1 place: item 2" in capsys.readouterr().out
