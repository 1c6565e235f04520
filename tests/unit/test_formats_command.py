"""`edc-swarm import` and `export` as users call them, and what other programs read of the result."""

from __future__ import annotations

import csv
import json
import tomllib
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import fastkml
import numpy as np
import pytest
from fastkml.gx import Track
from fastkml.utils import find_all
from geographiclib.geodesic import Geodesic
from shapely.geometry import shape

from edc_swarm.analysis.columns import columns_of
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.mission.validation import load_mission
from edc_swarm.mission.zone import Zone
from edc_swarm.recording.model import Recording
from edc_swarm.recording.reader import read_recording
from processes.cli.main import main
from tests.unit.test_formats_read import MAP, SCEN, SQUARE, WPL, item, kml, plan

GOLDEN = Path(__file__).resolve().parents[2] / "recordings" / "golden.mcap"
AGREED = {
    "uav",
    "start_x_m",
    "start_y_m",
    "target_x_m",
    "target_y_m",
    "route",
    "accept_m",
    "hover_s",
    "r_m",
    "v_max_mps",
}
"""Keys of a roster entry that an import may write."""


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run in an empty folder."""
    monkeypatch.chdir(tmp_path)


def test_import_lists_and_comments_what_a_mission_does_not_express(capsys: pytest.CaptureFixture[str]) -> None:
    """The same lines on standard output and in the file; items in short; the last line names the mission."""
    Path("a.waypoints").write_text(WPL)
    assert main(["import", "a.waypoints", "-o", "field.toml"]) == 0
    first, *lines, last = capsys.readouterr().out.splitlines()
    assert first == "a.waypoints: MAVLink way points: 1 route, 0 zones"
    assert last == "field.toml: 1 UAV, 0 zones"
    assert "a.waypoints: altitude: the mission is flown in a plane: in 4 places: item 1-2, item 4, item 0" in lines
    text = Path("field.toml").read_text()
    assert all(f"\n# {line}\n" in text for line in lines)
    assert tomllib.loads(text)["name"] == "field"


def test_import_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    """JSON alone, with every item."""
    Path("a.plan").write_text(plan(item(22, None, None), item(16, 47.3979, 8.546), item(16, 47.3985, 8.546), rally=2))
    assert main(["import", "a.plan", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["mission"], said["uavs"], said["zones"]) == ("mission.toml", 1, 0)
    (file,) = said["files"]
    assert (file["file"], file["format"], file["routes"]) == ("a.plan", "QGroundControl plan", 1)
    listed = {each["what"]: (each["count"], each["items"]) for each in file["not_expressed"]}
    assert listed["rally point"] == (2, ["rally point 1", "rally point 2"])
    assert listed["altitude: the mission is flown in a plane"] == (3, ["item 1", "item 2", "item 3"])


def test_import_writes_the_fields_of_a_mission(capsys: pytest.CaptureFixture[str]) -> None:
    """Every key is a field of the mission, of a zone, or one of those agreed for the roster."""
    fence = {"polygons": [{"polygon": SQUARE, "inclusion": True, "version": 1}]}
    Path("a.plan").write_text(
        plan(item(16, 47.3979, 8.546, params=(2, 1, 0, 0)), item(16, 47.398, 8.5465), fence=fence)
    )
    assert main(["import", "a.plan"]) == 0
    capsys.readouterr()
    mission = tomllib.loads(Path("mission.toml").read_text())
    assert mission.keys() <= set(Mission.__struct_fields__)
    assert all(zone.keys() <= set(Zone.__struct_fields__) for zone in mission["zone"])
    assert all(entry.keys() <= AGREED for entry in mission["roster"])
    (entry,) = mission["roster"]
    assert entry["hover_s"] == [2.0, 0.0]
    assert entry["accept_m"] == 1.0
    assert len(entry["route"]) == 2


@pytest.mark.skipif("route" not in RosterEntry.__struct_fields__, reason="roster entries have no route yet")
def test_imported_missions_fly(capsys: pytest.CaptureFixture[str]) -> None:
    """A plan, and a map with its scenario, are loaded and simulated: every UAV is home and no guarantee is broken."""
    Path("a.plan").write_text(plan(item(16, 47.3979, 8.546, params=(2, 0, 0, 0)), item(16, 47.398, 8.5458)))
    Path("m.map").write_text(MAP)
    Path("m.scen").write_text(SCEN)
    for name, files in (("plan", ["a.plan"]), ("map", ["m.map", "m.scen", "--agents", "2"])):
        assert main(["import", *files, "-o", f"{name}.toml"]) == 0
        assert load_mission(f"{name}.toml").roster
        assert main(["sim", f"{name}.toml", "--out", f"{name}.mcap"]) == 0
    capsys.readouterr()


@pytest.fixture(scope="module")
def golden() -> Recording:
    """The recording that all are compared with."""
    return read_recording(GOLDEN)


def exported(kind: str) -> Path:
    """Export the golden recording."""
    path = Path(f"tracks.{kind}")
    assert main(["export", str(GOLDEN), "--format", kind, "-o", str(path)]) == 0
    return path


def truth(golden: Recording, k: int) -> list[tuple[float, float]]:
    """Latitude and longitude of the centres of a UAV's disc, reckoned by geographiclib alone."""
    mission = golden.mission
    places = []
    for x_m, y_m in columns_of(golden).centre_m[:, k]:
        east = Geodesic.WGS84.Direct(
            mission.origin_lat_deg, mission.origin_lon_deg, np.degrees(np.arctan2(x_m, y_m)), np.hypot(x_m, y_m)
        )
        places.append((east["lat2"], east["lon2"]))
    return places


def near(found: list[tuple[float, float]], expected: list[tuple[float, float]]) -> None:
    """The same latitudes and longitudes to 0.2 mm."""
    assert len(found) == len(expected)
    assert np.abs(np.array(found) - np.array(expected)).max() < 2e-9


def test_geojson_is_read_back_by_shapely(golden: Recording, capsys: pytest.CaptureFixture[str]) -> None:
    """A line per UAV, without altitudes, with as many times as points."""
    features = json.loads(exported("geojson").read_text())["features"]
    capsys.readouterr()
    assert [each["properties"]["uav"] for each in features] == [entry.uav for entry in golden.mission.roster]
    for k, each in enumerate(features):
        line = shape(each["geometry"])
        assert (line.geom_type, line.has_z, line.is_valid) == ("LineString", False, True)
        near([(lat, lon) for lon, lat in line.coords], truth(golden, k))
        times_s = each["properties"]["time_s"]
        assert times_s == [slot * golden.mission.dt_s for slot in range(len(line.coords))]


def test_kml_is_read_back_by_fastkml(golden: Recording, capsys: pytest.CaptureFixture[str]) -> None:
    """A track per UAV, whose times are those of the slots, without altitudes."""
    tree = fastkml.KML.parse(exported("kml"))
    capsys.readouterr()
    marks: list[Any] = list(find_all(tree, of_type=fastkml.Placemark))
    assert [mark.name for mark in marks] == [entry.uav for entry in golden.mission.roster]
    for k, mark in enumerate(marks):
        track: Any = next(find_all(mark, of_type=Track))
        near([(point.coord.y, point.coord.x) for point in track.track_items], truth(golden, k))
        assert not any(point.coord.has_z for point in track.track_items)
        begun_ns = track.track_items[0].when.dt.timestamp() * 1e9
        assert begun_ns == pytest.approx(golden.mission.epoch_ns, abs=2e6)
        for one, two in pairwise(track.track_items):
            assert (two.when.dt - one.when.dt).total_seconds() == pytest.approx(golden.mission.dt_s, abs=2e-3)


def test_csv_is_read_back(golden: Recording, capsys: pytest.CaptureFixture[str]) -> None:
    """A row per UAV and slot; units are in the names; true positions are those of the recording."""
    with exported("csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    capsys.readouterr()
    columns = columns_of(golden)
    slots, count = columns.step_m.shape
    assert len(rows) == (slots + 1) * count
    truths = {(t.uav, t.slot): (t.from_x_m, t.from_y_m) for t in reversed(golden.truths)}
    compared = 0
    for row in rows:
        slot, k = int(row["slot"]), columns.uavs.index(row["uav"])
        assert [float(row["x_m"]), float(row["y_m"])] == columns.centre_m[slot, k].tolist()
        assert float(row["time_s"]) == slot * golden.mission.dt_s
        assert datetime.fromisoformat(row["utc"]).tzinfo is not None
        if (row["uav"], slot) in truths:
            assert (float(row["true_x_m"]), float(row["true_y_m"])) == truths[row["uav"], slot]
            compared += 1
    assert compared >= slots * count


def test_tracks_can_be_imported_again(capsys: pytest.CaptureFixture[str]) -> None:
    """As GeoJSON and as KML: each track is a route that ends where the UAV's did."""
    for kind in ("geojson", "kml"):
        path = exported(kind)
        assert main(["import", str(path), "-o", f"{kind}.toml"]) == 0
    capsys.readouterr()
    one, two = (tomllib.loads(Path(f"{kind}.toml").read_text())["roster"] for kind in ("geojson", "kml"))
    assert [entry["route"] for entry in one] == [entry["route"] for entry in two]
    assert len(one) == 4


def test_export_refuses_what_it_cannot_do(capsys: pytest.CaptureFixture[str]) -> None:
    """One line, status 2: an unknown format, a wrong suffix, a file that exists, no recording."""
    Path("a.kml").write_text(kml(""))
    for arguments, named in [
        ([str(GOLDEN), "--format", "shp"], "--format = 'shp': must be one of geojson, kml, csv"),
        ([str(GOLDEN), "--format", "kml", "-o", "a.csv"], "a name that ends in .kml"),
        ([str(GOLDEN), "--format", "kml", "-o", "a.kml"], "a new file (or give --force)"),
        (["a.kml"], "must be a readable recording"),
    ]:
        assert main(["export", *arguments]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert named in line
