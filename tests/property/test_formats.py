"""Readers of files of other programs under random changes: a mission, or one of this project's errors; nothing else."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.strategies import DrawFn

from edc_swarm.errors import SwarmError
from edc_swarm.formats.assemble import Settings, assemble
from edc_swarm.formats.content import Options
from edc_swarm.formats.registry import FORMATS, read_files
from edc_swarm.formats.toml_text import mission_text, note_lines
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.validation import mission_from_dict
from tests.unit.test_formats_read import (
    AREA,
    HOLE,
    HOME,
    LINE,
    LSC,
    MAP,
    MULTI,
    RING,
    SCEN,
    SQUARE,
    TRACK,
    WPL,
    feature,
    item,
    kml,
    kmz,
    plan,
)

FENCE = {
    "polygons": [{"polygon": SQUARE, "inclusion": True, "version": 1}],
    "circles": [{"circle": {"center": [47.3975, 8.5465], "radius": 5}, "inclusion": False}],
}
COMPLEX = {
    "type": "ComplexItem",
    "complexItemType": "survey",
    "TransectStyleComplexItem": {"Items": [item(16, 47.3979, 8.546)]},
}
PLAN = plan(item(22, *HOME), item(16, 47.3979, 8.5460), COMPLEX, item(20, 0, 0), fence=FENCE, rally=1, hoverSpeed=3)
GEOJSON = json.dumps(
    {
        "type": "FeatureCollection",
        "features": [
            feature("LineString", [[8.5452, 47.3972, 30], [8.5465, 47.3988, 30]], uav="a"),
            feature("Polygon", [RING, HOLE], kind="inclusion"),
            feature("Point", [8.5462, 47.3974], kind="no-fly", radius_m=8),
        ],
    }
)
KML = kml(LINE + AREA + TRACK + MULTI)
SEEDS: list[tuple[str, bytes]] = [
    ("a.plan", PLAN.encode()),
    ("a.json", PLAN.encode()),
    ("a.waypoints", WPL.encode()),
    ("a.txt", b"-35.3629 149.1650\n-35.3628 149.1650\n-35.3630 149.1648\n-35.3631 149.1652\n"),
    ("a.kml", KML.encode()),
    ("a.kmz", kmz(("doc.kml", KML.encode()))),
    ("a.geojson", GEOJSON.encode()),
    ("a.csv", b"uav,lat,lon,hover_s\na,47.1,8.5,\nb,47.1005,8.5,\na,47.1002,8.5003,3\n"),
    ("m.map", MAP.encode()),
    ("a.lsc", json.dumps(LSC).encode()),
]
TOKENS = (
    b'NaN nan 1e999 -1 0 null {} [] true " , ; \t \n \0 \xff \xfe\xff <a> </a> &b; 99999999999999999999 e 16 5001 '
    b"inclusion type coordinates QGC"
).split(b" ")


@pytest.fixture(scope="module", autouse=True)
def few_tries() -> Iterator[None]:
    """Give the placement of UAVs up soon: most changed fences have no room for any."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("edc_swarm.mission.roster.TRIES", 200)
        yield


@st.composite
def changed(draw: DrawFn, data: bytes) -> bytes:
    """Bytes with some spans replaced, repeated, removed or cut off."""
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(data)))
        end = min(len(data), start + draw(st.integers(0, 12)))
        token = draw(st.one_of(st.sampled_from(TOKENS), st.binary(max_size=6), st.just(data[start:end] * 2)))
        data = data[:start] + token + (b"" if draw(st.integers(0, 9)) == 0 else data[end:])
    return data


def whole_import(files: list[tuple[str, bytes]]) -> bool:
    """Import files as the command does, into a mission file that says the same; False if they are refused."""
    try:
        found = assemble(read_files(files, Options(list_unknown=True)), Settings())
    except SwarmError:
        return False
    stated = {key: value for key, value in found.mission.items() if value != []}
    text = mission_text(found, [name for name, _ in files])
    assert tomllib.loads(text) == json.loads(json.dumps(stated))
    assert complete_mission(mission_from_dict(tomllib.loads(text))) == found.flown
    assert all("\n" not in line for line in note_lines(found))
    return True


@pytest.mark.parametrize(("name", "seed"), SEEDS)
def test_the_unchanged_files_are_read(name: str, seed: bytes) -> None:
    """Else the changed ones below would test nothing."""
    assert whole_import([(name, seed)])


@given(st.data())
def test_only_errors_of_this_project_come_out(data: st.DataObject) -> None:
    """Files of every format, with bytes changed at random."""
    name, seed = data.draw(st.sampled_from(SEEDS))
    whole_import([(name, data.draw(changed(seed)))])


@given(st.data())
def test_a_changed_map_or_scenario(data: st.DataObject) -> None:
    """Both are read together."""
    files = [("m.map", MAP.encode()), ("m.scen", SCEN.encode())]
    which = data.draw(st.integers(0, 1))
    files[which] = (files[which][0], data.draw(changed(files[which][1])))
    whole_import(files)


JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=6), inner, max_size=3),
    max_leaves=8,
)


@given(st.data())
def test_json_with_other_values(data: st.DataObject) -> None:
    """Any value anywhere in a plan, a GeoJSON file or an LSC mission may be of any type."""
    name, text = data.draw(st.sampled_from([("a.plan", PLAN), ("a.geojson", GEOJSON), ("a.json", json.dumps(LSC))]))
    tree = json.loads(text)
    for _ in range(data.draw(st.integers(1, 3))):
        place, key = tree, None
        while isinstance(place, dict | list) and place:
            parent = place
            key = data.draw(st.sampled_from(sorted(place) if isinstance(place, dict) else range(len(place))))
            place = parent[key]
            if data.draw(st.integers(0, 3)) == 0:
                break
        if key is not None:
            parent[key] = data.draw(JSON)
    try:
        raw = json.dumps(tree).encode()
    except UnicodeEncodeError:
        return
    whole_import([(name, raw)])


@pytest.mark.parametrize("kind", [kind.name for kind in FORMATS])
@given(st.binary(max_size=400))
def test_any_bytes_to_any_reader(kind: str, data: bytes) -> None:
    """Bytes of no format at all."""
    (row,) = (each for each in FORMATS if each.name == kind)
    with suppress(SwarmError):
        row.read(data, Options())
