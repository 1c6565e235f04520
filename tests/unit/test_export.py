"""`edc-swarm export` of recordings with gaps, odd places and odd ids, and where no file can be written.

Each format is read back by a reader of others: json and shapely, fastkml, the csv module. Positions are those that
geographiclib reckons from the messages.
"""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta
from functools import partial
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

from edc_swarm.protocol.codec import encode
from edc_swarm.protocol.keys import Keys
from edc_swarm.protocol.messages import Fix, Message, MissionMessage, Truth
from edc_swarm.recording.reader import read_recording
from edc_swarm.recording.writer import RecordingWriter
from processes.cli.main import main
from tests.unit.synthetic import EPOCH_NS, flight, parallel, straight, whole
from tests.unit.test_autopilot_evidence import STRAYS_FROM, astray, flown

FORMATS = ("geojson", "kml", "csv")
Place = tuple[float, float, float]
"""Mission time in seconds, latitude and longitude in degrees."""
Lines = dict[str, list[list[Place]]]


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run in an empty folder."""
    monkeypatch.chdir(tmp_path)


def save(messages: Sequence[Message], name: str = "a.mcap") -> None:
    """Write a recording."""
    keys = Keys("mission")
    with open(name, "wb") as stream:
        writer = RecordingWriter(stream, {"clock": "virtual"})
        for message in messages:
            writer.write(keys.of(message), encode(message), EPOCH_NS)
        writer.finish({})


def lines_of(kind: str) -> Lines:
    """Export a.mcap, and read the lines of every UAV."""
    began_ns = read_recording("a.mcap").mission.epoch_ns
    assert main(["export", "a.mcap", "--format", kind, "--force"]) == 0
    return {"geojson": of_geojson, "kml": of_kml, "csv": of_csv}[kind](Path(f"a.{kind}"), began_ns)


def of_geojson(path: Path, began_ns: int) -> Lines:
    """What shapely makes of the geometries."""
    found: Lines = {}
    for each in json.loads(path.read_text())["features"]:
        said = each["properties"]
        lines, times_s, utc = [], said["time_s"], said["utc"]
        if each["geometry"] is not None:
            read = shape(each["geometry"])
            lines = list(getattr(read, "geoms", [read]))
        if len(lines) == 1:
            times_s, utc = [times_s], [utc]
        assert [[seconds(text, began_ns) for text in part] for part in utc] == [pytest.approx(t) for t in times_s]
        found[said["uav"]] = [
            [(at_s, lat, lon) for at_s, (lon, lat) in zip(own_s, line.coords, strict=True)]
            for own_s, line in zip(times_s, lines, strict=True)
        ]
    return found


def of_kml(path: Path, began_ns: int) -> Lines:
    """What fastkml makes of the tracks."""
    found: Lines = {}
    marks: list[Any] = list(find_all(fastkml.KML.parse(path), of_type=fastkml.Placemark))
    for mark in marks:
        tracks: list[Any] = list(find_all(mark, of_type=Track))
        found[mark.name] = [
            [(each.when.dt.timestamp() - began_ns / 1e9, each.coord.y, each.coord.x) for each in track.track_items]
            for track in tracks
        ]
    return found


def of_csv(path: Path, began_ns: int) -> Lines:
    """The rows of each UAV, parted where slots are missing."""
    found: Lines = {}
    last = {"uav": "", "slot": ""}
    for row in csv.DictReader(path.read_text().splitlines()):
        if row["uav"] != last["uav"] or int(row["slot"]) != int(last["slot"]) + 1:
            found.setdefault(row["uav"], []).append([])
        assert seconds(row["utc"], began_ns) == pytest.approx(float(row["time_s"]))
        place = float(row["time_s"]), float(row["lat_deg"]), float(row["lon_deg"])
        found[row["uav"]][-1].append(place)
        last = row
    return found


def seconds(utc: str, began_ns: int) -> float:
    """Seconds since the epoch of the mission."""
    since = datetime.fromisoformat(utc) - datetime.fromtimestamp(0, UTC)
    return (since // timedelta(microseconds=1) - began_ns // 1000) / 1e6


def truth(messages: Sequence[Message], uav: str) -> dict[float, tuple[float, float]]:
    """Latitude and longitude at which a UAV is, by mission time, as its fixes say."""
    mission = messages[0]
    assert isinstance(mission, MissionMessage)
    places = {}
    for fix in (message for message in messages if isinstance(message, Fix) and message.uav == uav):
        for slot, x_m, y_m in (
            (fix.slot, fix.from_x_m, fix.from_y_m),
            (fix.slot + 1, fix.waypoint_x_m, fix.waypoint_y_m),
        ):
            at = Geodesic.WGS84.Direct(
                mission.origin_lat_deg, mission.origin_lon_deg, np.degrees(np.arctan2(x_m, y_m)), np.hypot(x_m, y_m)
            )
            places[slot * mission.dt_s] = at["lat2"], at["lon2"]
    return places


def assert_true(found: list[list[Place]], said: dict[float, tuple[float, float]]) -> None:
    """Every point of a slot is where the fixes say, to 0.2 mm; longitudes are equal modulo 360."""
    for at_s, lat_deg, lon_deg in (place for line in found for place in line):
        if at_s in said:
            assert abs(lat_deg - said[at_s][0]) < 2e-9
            apart_deg = (lon_deg - said[at_s][1] + 180) % 360 - 180
            assert abs(apart_deg) * np.cos(np.radians(lat_deg)) < 2e-9
    assert {place[0] for line in found for place in line} >= said.keys()


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize(
    "origin", [(60.1841, 24.8301), (0.0, 180.0), (-17.0, -180.0), (52.0, 179.9999), (89.0, 5.0), (-89.0, -170.0)]
)
def test_every_origin(kind: str, origin: tuple[float, float], capsys: pytest.CaptureFixture[str]) -> None:
    """East and west of the antimeridian, and round a pole."""
    paths = [straight((-9.0 + k, 12.0 * k), (9.0 + k, 12.0 * k), 9) for k in range(3)]
    messages = flight(paths, origin_lat_deg=origin[0], origin_lon_deg=origin[1])
    save(messages)
    found = lines_of(kind)
    for uav in ("u0", "u1", "u2"):
        assert_true(found[uav], truth(messages, uav))
        assert all(abs(lon_deg) <= 180 for line in found[uav] for _, _, lon_deg in line)
    capsys.readouterr()


def test_lines_are_cut_at_the_antimeridian() -> None:
    """No line of GeoJSON goes round the Earth, none has a gap: each part ends, and the next begins, on it."""
    save(flight([straight((-9.0, 0.0), (8.0, 0.0), 9), straight((8.0, 12.0), (-9.0, 30.0), 9)], origin_lon_deg=180.0))
    found = lines_of("geojson")
    for lines, first_deg in ((found["u0"], 180.0), (found["u1"], -180.0)):
        one, two = lines
        assert (one[-1][2], two[0][2]) == (first_deg, -first_deg)
        assert one[-1][:2] == two[0][:2]
        times_s = [place[0] for line in lines for place in line]
        assert times_s == sorted(times_s)
        assert all(abs(b[2] - a[2]) < 1e-3 for line in lines for a, b in pairwise(line))
    whole_s = {place[0] for place in found["u0"][0]} | {place[0] for place in found["u0"][1]}
    assert {0.5 * slot for slot in range(11)} < whole_s


def test_a_line_over_the_pole() -> None:
    """111.7 km north of the origin the longitude turns by half a circle within a slot."""
    messages = flight([straight((4.0, 111_680.0), (6.0, 111_710.0), 9)], origin_lat_deg=89.0, origin_lon_deg=90.0)
    assert np.ptp([lon for _, lon in truth(messages, "u0").values()]) > 90
    save(messages)
    for kind in FORMATS:
        assert_true(lines_of(kind)["u0"], truth(messages, "u0"))


def without(messages: Sequence[Message], uav: str, slots: range) -> list[Message]:
    """What is left of a mission without the fixes and truths of a UAV in some slots."""
    return [m for m in messages if not (isinstance(m, Fix | Truth) and m.uav == uav and m.slot in slots)]


@pytest.mark.parametrize("kind", FORMATS)
def test_a_uav_that_was_never_heard_has_no_line(kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    """It is named in one line; in GeoJSON and KML it is there without a geometry."""
    save(whole(without(flight(parallel()), "u1", range(99))))
    found = lines_of(kind)
    assert (found.get("u1", []), len(found["u0"]), len(found["u2"])) == ([], 1, 1)
    (warning,) = capsys.readouterr().err.splitlines()
    assert warning == "warning: the way of u1 is not known"
    if kind == "geojson":
        assert json.loads(Path("a.geojson").read_text())["features"][1]["geometry"] is None


@pytest.mark.parametrize("kind", FORMATS)
def test_no_line_goes_through_lost_slots(kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Its parts are those that the recording has; each point has its own time."""
    messages = flight(parallel(2, 12))
    save([m for m in messages if not (getattr(m, "slot", None) in {4, 5, 6} and m is not messages[0])])
    for uav, lines in lines_of(kind).items():
        assert [(line[0][0], line[-1][0]) for line in lines] == [(0.0, 2.0), (3.5, 6.5)], uav
    assert "warning: the way of u0, u1 is known in parts only" in capsys.readouterr().err
    if kind == "csv":
        assert all(row["true_x_m"] for row in csv.DictReader(Path("a.csv").read_text().splitlines()))


def test_many_uavs_without_a_way_are_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    """The line names some and counts the others."""
    messages = flight(parallel(30, 2))
    save(whole(m for m in messages if getattr(m, "uav", "u0") == "u0"))
    lines_of("csv")
    (warning,) = capsys.readouterr().err.splitlines()
    assert warning == "warning: the way of u1, u2, u3, u4, u5 and 24 more is not known"


def test_a_dead_uav_ends_where_it_was_last_heard() -> None:
    """No point is made up after its end, and the true place at its end is that of its last truth."""
    messages = flight(parallel(3, 20))
    save(whole(without(messages, "u1", range(6, 99))))
    (line,) = lines_of("csv")["u1"]
    assert (line[0][0], line[-1][0]) == (0.0, 3.0)
    rows = [row for row in csv.DictReader(Path("a.csv").read_text().splitlines()) if row["uav"] == "u1"]
    (last,) = (m for m in messages if isinstance(m, Truth) and m.uav == "u1" and m.slot == 5)
    assert (float(rows[-1]["true_x_m"]), float(rows[-1]["true_y_m"])) == (last.to_x_m, last.to_y_m)


@pytest.mark.parametrize("kind", FORMATS)
def test_a_stray_has_no_line_from_where_it_strays(kind: str) -> None:
    """It has no disc any more."""
    save(astray(flown(), "u0"))
    found = lines_of(kind)
    assert [(line[0][0], line[-1][0]) for line in found["u0"]] == [(0.0, 0.5 * STRAYS_FROM)]
    assert found["u1"][0][-1][0] > 10


def test_a_landed_uav_leaves_the_map(capsys: pytest.CaptureFixture[str]) -> None:
    """The line of a frozen UAV ends before its airspace is free, though it wakes up later and says so."""
    fault = ["--fault", "freeze u001 @4 for 30", "--land-after", "2", "--quiet"]
    main(["sim", "--uavs", "4", "--speed-max", "3", "--out", "a.mcap", *fault])
    ((uav, free_slot),) = ((each["uav"], each["free_slot"]) for each in metrics(capsys)["landed"])
    ends_s = {uav: lines[-1][-1][0] for uav, lines in lines_of("csv").items()}
    assert uav == "u001"
    assert ends_s["u001"] <= 0.5 * free_slot
    assert all(ends_s[other] > 0.5 * 34 for other in ("u002", "u003", "u004"))


def metrics(capsys: pytest.CaptureFixture[str]) -> Any:
    """The metrics of a.mcap."""
    capsys.readouterr()
    main(["metrics", "a.mcap", "--json"])
    return json.loads(capsys.readouterr().out)


def test_two_clusters_and_their_zones() -> None:
    """The lines are those of all UAVs, and of nothing else."""
    Path("m.toml").write_text(
        'uavs = 6\nclusters = 2\narea_m2 = 10000\n[[zone]]\nname = "mast"\nkind = "exclusion"\ncentre = [50, 50]\n'
        'radius_m = 4\n[[zone]]\nname = "field"\nkind = "inclusion"\npolygon = [[-9, -9], [110, -9], [0, 300]]\n'
    )
    assert main(["sim", "m.toml", "--out", "a.mcap", "--quiet"]) == 0
    for kind in FORMATS:
        assert list(lines_of(kind)) == [f"u{number:03}" for number in range(1, 7)]


ODD = ["-", "_", "0", "1e5", "TRUE", "x" * 32]


@pytest.mark.parametrize("kind", FORMATS)
def test_odd_ids(kind: str) -> None:
    """Ids that spreadsheets and XML take for something else come back as they are, and no XML id is invalid."""
    roster = "".join(
        f'[[roster]]\nuav = "{uav}"\nstart_x_m = {12 * k}\nstart_y_m = 0\ntarget_x_m = {12 * k}\ntarget_y_m = 9\n'
        for k, uav in enumerate(ODD)
    )
    Path("m.toml").write_text(f'name = "-"\n{roster}')
    assert main(["sim", "m.toml", "--out", "a.mcap", "--quiet"]) == 0
    assert list(lines_of(kind)) == ODD
    if kind == "kml":
        assert " id=" not in Path("a.kml").read_text()


def test_the_shortest_slots() -> None:
    """In slots of 20 microseconds no two times are equal; the epoch may be the first instant of 1970."""
    save(flight(parallel(), epoch_ns=0, dt_s=0.02, tau_s=0.008, time_scale=1000.0))
    assert main(["export", "a.mcap", "--format", "csv"]) == 0
    rows = [row for row in csv.DictReader(Path("a.csv").read_text().splitlines()) if row["uav"] == "u0"]
    since_s = [seconds(row["utc"], 0) for row in rows]
    assert since_s == pytest.approx([20e-6 * slot for slot in range(len(rows))], abs=3e-6)


def torn() -> None:
    """A recording that ends in its middle."""
    save(flight(parallel()))
    data = Path("a.mcap").read_bytes()
    Path("a.mcap").write_bytes(data[: len(data) // 2])


def mission_alone() -> None:
    """A recording of nothing but the mission."""
    save(flight(parallel())[:1])


def no_mission() -> None:
    """A recording without the mission."""
    save(flight(parallel())[1:])


def good() -> None:
    """A recording of a whole mission."""
    save(flight(parallel()))


UNREADABLE = "recording = 'a.mcap': must be a readable recording"
UNWRITABLE = "must be where it can be written"
REFUSED: list[tuple[list[Callable[[], object]], str, str]] = [
    ([torn], "a.mcap", f"{UNREADABLE}; it is torn: "),
    ([mission_alone], "a.mcap", "recording = 'a.mcap': must be one that has the way of a UAV"),
    ([no_mission], "a.mcap", UNREADABLE),
    ([Path("a.mcap").touch], "a.mcap", f"{UNREADABLE}; it is empty"),
    ([Path("a.mcap").mkdir], "a.mcap", UNREADABLE),
    ([partial(os.mkfifo, "a.mcap")], "a.mcap", UNREADABLE),
    ([], "a.mcap", UNREADABLE),
    ([good], "a.mcap -o b.json", "--out = 'b.json': must be a name that ends in .csv"),
    ([good], "a.mcap -o no/b.csv", f"--out = 'no/b.csv': {UNWRITABLE} (no such file or directory)"),
    ([good], "a.mcap -o a.mcap/b.csv", "--out = 'a.mcap/b.csv': must be a path that can be written (not a directory)"),
    ([good], "a.mcap -o /proc/b.csv", f"--out = '/proc/b.csv': {UNWRITABLE}"),
    ([good, Path("b.csv").mkdir], "a.mcap -o b.csv", "must be a regular file, not a folder"),
    ([good, partial(os.mkfifo, "b.csv")], "a.mcap -o b.csv --force", "must be a regular file, not a device"),
    ([good, partial(os.symlink, "b.csv", "b.csv")], "a.mcap -o b.csv", "symbolic links"),
    ([good, partial(os.symlink, "no/x", "b.csv")], "a.mcap -o b.csv", f"{UNWRITABLE} (no such file"),
    ([good, partial(os.rename, "a.mcap", "b.csv")], "b.csv -o b.csv --force", "another file than the recording"),
    ([good, Path("a.csv").touch], "a.mcap", "--out = 'a.csv': must be a new file"),
]


@pytest.mark.parametrize(("prepare", "arguments", "named"), REFUSED)
def test_one_line_and_nothing_written(
    prepare: list[Callable[[], object]], arguments: str, named: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Recordings without a track, and places where no file can be written."""
    for step in prepare:
        step()
    before = {path: path.is_file() and path.read_bytes() for path in Path().rglob("*")}
    assert main(["export", *arguments.split(), "--format", "csv"]) == 2
    said = capsys.readouterr()
    (line,) = said.err.splitlines()
    assert line.startswith("error: ")
    assert named in line
    assert said.out == ""
    assert {path: path.is_file() and path.read_bytes() for path in Path().rglob("*")} == before


def test_force_replaces_the_file_a_link_leads_to() -> None:
    """The link stays; a file that was there is replaced by the whole new one."""
    good()
    Path("b.csv").write_text("old " * 99_999)
    os.symlink("b.csv", "a.csv")
    assert main(["export", "a.mcap", "--format", "csv", "--force"]) == 0
    assert Path("a.csv").is_symlink()
    assert Path("b.csv").read_text().startswith("uav,slot,")
    assert sorted(path.name for path in Path().iterdir()) == ["a.csv", "a.mcap", "b.csv"]
