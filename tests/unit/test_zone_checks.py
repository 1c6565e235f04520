"""Zones of missions: bad ones are refused in one line, random missions fit them, and messages hold them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edc_swarm.agent.goals import unflyable
from edc_swarm.errors import MessageError, MissionError, PlacementError
from edc_swarm.mission import airspace
from edc_swarm.mission.airspace import PLANNER_MARGIN_M, Airspace, check_zones, zones_refusal
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.field_types import MAX_ALL_CORNERS, MAX_CLUSTERS, MAX_UAVS, MAX_ZONES
from edc_swarm.mission.roster import complete_mission, random_roster
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.mission.validation import load_mission, mission_from_dict, with_options
from edc_swarm.mission.zone import Zone
from edc_swarm.protocol.codec import MAX_MISSION_BYTES, decode, encode
from edc_swarm.protocol.keys import Keys
from edc_swarm.protocol.messages import MissionMessage, mission_message
from edc_swarm.solver.normals import DELTA_M

SCENARIOS = Path(__file__).parents[2] / "scenarios"
SQUARE = [[0, 0], [100, 0], [100, 100], [0, 100]]
FENCE = {"name": "fence", "kind": "inclusion", "polygon": SQUARE}


def box(name: str, left: float, low: float, right: float, high: float, **more: Any) -> dict[str, Any]:
    """Return an exclusion zone, a rectangle."""
    corners = [[left, low], [right, low], [right, high], [left, high]]
    return {"name": name, "kind": "exclusion", "polygon": corners, **more}


def circle(name: str, x_m: float, y_m: float, radius_m: float, **more: Any) -> dict[str, Any]:
    """Return an exclusion zone, a circle."""
    return {"name": name, "kind": "exclusion", "centre": [x_m, y_m], "radius_m": radius_m, **more}


def mission(*zones: dict[str, Any], r_m: float = 5.0, **places: float) -> Mission:
    """Return the mission of one UAV that flies from (10, 50) to (90, 50)."""
    entry = {"start_x_m": 10, "start_y_m": 50, "target_x_m": 90, "target_y_m": 50, **places}
    roster = [{"uav": "a", **entry, "r_m": r_m, "body_m": 0.1, "energy_j": 1e5}]
    return mission_from_dict({"roster": roster, "zone": list(zones)})


def refused(*zones: dict[str, Any], **more: float) -> str:
    """Return the one line that refuses a mission, "" for an accepted one."""
    flown = mission(*zones, **more)
    try:
        complete_mission(flown)
    except MissionError as error:
        return str(error)
    return ""


# --- shapes ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("zone", "said"),
    [
        (
            {"polygon": [[0, 0], [9, 0]]},
            "[(0.0, 0.0), (9.0, 0.0)]: must be a simple polygon (zone x): it has 2 corners, fewer than three",
        ),
        (
            {"polygon": [[0, 0], [9, 9], [9, 0], [0, 9]]},
            "(zone x): edge 0 (from (0, 0) to (9, 9)) and edge 2 (from (9, 0) to (0, 9)) meet",
        ),
        (
            {"polygon": [[0, 0], [4, 0], [4, 4], [2, 0], [0, 4]]},
            "edge 0 (from (0, 0) to (4, 0)) and edge 3 (from (2, 0) to (0, 4)) meet",
        ),
        (
            {"polygon": [[0, 0], [4, 0], [2, 0], [2, 4]]},
            "edge 0 (from (0, 0) to (4, 0)) and edge 2 (from (2, 0) to (2, 4)) meet",
        ),
        ({"polygon": [[0, 0], [1, 1], [3, 3]]}, "its corners lie on one line, so its area is zero"),
        ({"polygon": [[0, 0], [1, 0], [1, 1], [0, 0]]}, "corners 0 and 3 are the same point (0, 0)"),
        ({"polygon": [[0, 0], [1, 0], [1, math.nan]]}, "zone[0].polygon[2][1] = nan: must be a finite number"),
        (
            {"polygon": [[0, 0], [1, 0], [1, 2e7]]},
            "zone[0].polygon[2][1] = 20000000.0: must be a number from -1e7 to 1e7",
        ),
        ({"polygon": [[0, 0], [1, 0], [1]]}, "zone[0].polygon[2] = [1]: must be a point [x, y]"),
        ({"polygon": [[0, 0], [1, 0], [1, "y"]]}, "zone[0].polygon[2][1] = 'y': must be a number from -1e7 to 1e7"),
        (
            {"polygon": SQUARE, "centre": [1, 1], "radius_m": 2},
            "zone[0] = 'x': must be a polygon or a circle (centre, radius_m), not both",
        ),
        ({}, "zone[0] = 'x': must be a polygon or a circle (centre, radius_m), and has neither"),
        ({"centre": [1, 1]}, "zone[0].radius_m = 0.0: must be above 0 (zone x)"),
        ({"centre": [1, 1], "radius_m": -1}, "zone[0].radius_m = -1: must be a number from 0 to 1e12"),
        ({"centre": [1], "radius_m": 2}, "zone[0].centre = [1.0]: must be two numbers [x, y] (zone x)"),
        ({"radius_m": 2}, "zone[0].centre = []: must be two numbers [x, y] (zone x)"),
        ({"polygon": SQUARE, "keep": "body"}, "zone[0].keep = 'body': must be one of \"\", centre, disc"),
        ({"polygon": SQUARE, "kind": "fence"}, "zone[0].kind = 'fence': must be one of exclusion, inclusion"),
        ({"polygon": SQUARE, "height_m": 3}, "zone[0].height_m = 3: must be one of the known keys"),
        ({"polygon": SQUARE, "radius": 3}, "radius_m (do you mean radius_m?)"),
        ({"polygon": SQUARE, "name": ""}, "zone[0].name = '': must be a text of 1 to 64 characters"),
    ],
)
def test_bad_zones_are_refused_with_their_place_and_reason(zone: dict[str, Any], said: str) -> None:
    """One line has the field, the value, the zone and what is allowed."""
    with pytest.raises(MissionError) as error:
        mission_from_dict({"zone": [{"name": "x", "kind": "exclusion", **zone}]})
    assert said in str(error.value)


def test_names_are_unique_and_numbers_are_limited() -> None:
    """The limits hold for all zones together, and say how many there are."""
    with pytest.raises(MissionError, match=r"zone\[1\].name = 'w': must be a name that zone\[0\] does not have"):
        mission_from_dict({"zone": [box("w", 0, 0, 1, 1), circle("w", 9, 9, 1)]})
    many = [circle(f"z{index}", index, 0, 0.1) for index in range(MAX_ZONES)]
    assert len(mission_from_dict({"zone": many}).zone) == MAX_ZONES
    with pytest.raises(MissionError, match=r"zone = .*must be a list of at most 1000 tables"):
        mission_from_dict({"zone": [*many, circle("more", 0, 5, 1)]})
    with pytest.raises(MissionError, match="zone = 1001: must be at most 1000 zones, with the fence"):
        complete_mission(mission_from_dict({"zone": many, "area_m2": 1e6}))
    gears = [{"name": f"g{i}", "kind": "exclusion", "polygon": gear(700, 1e3 * i)} for i in range(8)]
    with pytest.raises(MissionError, match="zone = 5600: must be at most 5000 corners in all zones together"):
        mission_from_dict({"zone": gears})
    rims = [{"name": f"r{i}", "kind": "inclusion", "centre": [0, 0], "radius_m": 500} for i in range(79)]
    with pytest.raises(MissionError, match="zone = 5056: must be at most 5000 corners"):
        mission_from_dict({"zone": rims})


def gear(corners: int, x_m: float) -> list[tuple[float, float]]:
    """Return a simple polygon with many corners, all with as many digits as a number can have."""
    turns = [2 * math.pi * i / corners for i in range(corners)]
    return [(x_m + (9 + i % 2) * math.cos(t) / 3, (9 + i % 2) * math.sin(t) / 3) for i, t in enumerate(turns)]


# --- places and ways -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("zones", "said"),
    [
        (
            [box("w", 14, 0, 20, 99)],
            "(10.0, 50.0): must be outside exclusion zone 'w' with its whole disc of 5 m, not 4.000 m from its edge",
        ),
        ([box("w", 14, 0, 20, 99, keep="centre")], ""),
        ([box("w", 15, 0, 20, 99)], ""),
        (
            [box("w", 80, 40, 99, 60)],
            "(90.0, 50.0): must be outside exclusion zone 'w' with its whole disc of 5 m, not 9.000 m inside it",
        ),
        (
            [circle("t", 90, 53, 4, keep="centre")],
            "must be outside exclusion zone 't' with its centre, not 1.000 m inside it",
        ),
        (
            [circle("t", 90, 58, 4)],
            "must be outside exclusion zone 't' with its whole disc of 5 m, not 4.000 m from its edge",
        ),
        ([box("f", 0, 0, 100, 53) | {"kind": "inclusion"}], ""),
        (
            [box("f", 0, 0, 100, 53) | {"kind": "inclusion", "keep": "disc"}],
            "must be inside inclusion zone 'f' with its whole disc of 5 m, not 3.000 m from its edge",
        ),
        (
            [box("f", 0, 0, 89, 99) | {"kind": "inclusion"}],
            "(90.0, 50.0): must be inside inclusion zone 'f' with its centre, not 1.000 m outside it",
        ),
        (
            [box("f", 10, 0, 95, 99) | {"kind": "inclusion"}],
            "(10.0, 50.0): must be inside inclusion zone 'f' with its centre, not 0.000 m from its edge",
        ),
        ([FENCE, box("f", 20, 0, 95, 99) | {"kind": "inclusion"}], "must be inside inclusion zone 'f'"),
        (
            [{"name": "c", "kind": "inclusion", "centre": [50, 50], "radius_m": 39}],
            "(10.0, 50.0): must be inside inclusion zone 'c' with its centre, not 1.000 m outside it",
        ),
    ],
)
def test_starts_and_targets_keep_to_zones(zones: list[dict[str, Any]], said: str) -> None:
    """By default the centre stays inside a fence and the whole disc outside an exclusion zone."""
    line = refused(*zones)
    assert said in line
    assert bool(said) == bool(line)
    assert "\n" not in line


LOW, HIGH = box("low", 45, -9, 55, 40), box("high", 45, 60, 55, 109)
BAY = [[0, 0], [100, 0], [100, 70], [70, 70], [70, 20], [30, 20], [30, 70], [0, 70]]


@pytest.mark.parametrize(
    ("zones", "closers"),
    [
        ([FENCE, box("wall", 45, -9, 55, 109)], {"fence", "wall"}),
        ([box("wall", 45, -9, 55, 109)], set()),
        ([FENCE, LOW, HIGH], set()),
        ([FENCE, LOW, HIGH, box("gate", 45, 40, 55, 60)], {"fence", "low", "high", "gate"}),
        ([FENCE, LOW, HIGH, circle("post", 50, 50, 1)], {"fence", "low", "high", "post"}),
        ([FENCE, LOW, HIGH, circle("post", 50, 50, 1, keep="centre")], set()),
        ([circle("ring", 90, 50, 30) | {"kind": "inclusion"}, box("wall", 0, 0, 1, 1)], None),
        ([{"name": "bay", "kind": "inclusion", "polygon": BAY}], set()),
        ([{"name": "bay", "kind": "inclusion", "polygon": BAY}, box("plug", 40, 0, 60, 19)], {"bay", "plug"}),
        ([{"name": "bay", "kind": "inclusion", "polygon": BAY}, circle("plug", 50, 10, 6)], {"bay", "plug"}),
        ([{"name": "bay", "kind": "inclusion", "polygon": BAY}, circle("plug", 50, 10, 4)], set()),
        (
            [
                box("n", 80, 60, 100, 65),
                box("e", 100, 40, 105, 65),
                box("s", 80, 35, 105, 40),
                box("w", 75, 35, 80, 65),
            ],
            {"n", "e", "s", "w"},
        ),
        (
            [
                box("n", 80, 60, 100, 65),
                box("e", 100, 40, 105, 65),
                box("s", 80, 35, 105, 40),
                box("w", 75, 35, 80, 54),
            ],
            {"n", "e", "s", "w"},
        ),
        (
            [
                box("n", 80, 60, 100, 65),
                box("e", 100, 40, 105, 65),
                box("s", 80, 35, 105, 40),
                box("w", 75, 35, 80, 49),
            ],
            set(),
        ),
    ],
)
def test_a_way_that_zones_close_is_refused_and_the_zones_are_named(
    zones: list[dict[str, Any]], closers: set[str] | None
) -> None:
    """Walls, gates, touching zones, a concave fence, a ring of zones: None stands for a start outside."""
    said = refused(*zones)
    if closers is None:
        assert "must be inside inclusion zone 'ring'" in said
    elif closers:
        names = said.rpartition("closed by zones ")[2]
        assert set(names.split(", ")) == closers
        assert said.startswith("roster[0].target_x_m, target_y_m = (90.0, 50.0): must be reachable from its start")
    else:
        assert said == ""


@pytest.mark.parametrize(
    ("width_m", "outcome"),
    [
        (9.99, "refused"),
        (10.0, "warned"),
        (10 + 1.9 * PLANNER_MARGIN_M, "warned"),
        (10 + 2.1 * PLANNER_MARGIN_M, ""),
        (11.0, ""),
    ],
)
def test_a_corridor_one_disc_wide(width_m: float, outcome: str) -> None:
    """It can be flown by law from the width of the disc on, and by the planner with the margin on either side."""
    half_m = width_m / 2
    zones = [FENCE, box("low", 30, -9, 70, 50 - half_m), box("high", 30, 50 + half_m, 70, 109)]
    flown = mission(*zones)
    if outcome == "refused":
        with pytest.raises(MissionError, match="closed by zones"):
            check_zones(flown)
        return
    warnings = check_zones(flown)
    assert bool(warnings) == (outcome == "warned")
    assert all(said.startswith("a may not arrive: the only way leaves less than 0.02 m") for said in warnings)


def test_the_margin_is_the_planners() -> None:
    """The mission knows no solver, so the number is written twice."""
    assert PLANNER_MARGIN_M == DELTA_M


def test_every_uav_is_checked_with_its_own_radius() -> None:
    """A corridor of 6 m lets a disc of 5 m through, and not one of 10 m."""
    zones = [FENCE, box("low", 45, -9, 55, 47), box("high", 45, 53, 55, 109)]
    assert refused(*zones, r_m=2.5) == ""
    small = mission(*zones, r_m=2.5)
    large = msgspec.structs.replace(small.roster[0], uav="b", r_m=5.0, start_y_m=80.0, target_y_m=80.0)
    both = msgspec.structs.replace(small, roster=[small.roster[0], large], uavs=2)
    with pytest.raises(MissionError, match=r"roster\[1\].target_x_m, target_y_m = .* for a disc of 5 m"):
        complete_mission(both)


def test_routes_are_checked_leg_by_leg() -> None:
    """A way point in a court without a gate is refused, with the leg that leads there."""
    court = [box("n", 40, 70, 60, 75), box("s", 40, 40, 60, 45), box("w", 35, 40, 40, 75), box("e", 60, 40, 65, 75)]
    flown = mission(FENCE, *court, r_m=1.0)
    assert check_zones(flown) == []
    with pytest.raises(MissionError) as error:
        check_zones(flown, [[(10, 50), (20, 20), (50, 50), (90, 50)]])
    assert "roster[0].route[1] = (50.0, 50.0): must be reachable from point 1 of its route" in str(error.value)
    with pytest.raises(
        MissionError, match=r"roster\[0\].route\[0\] = \(50.0, 42.0\): must be outside exclusion zone 's'"
    ):
        check_zones(flown, [[(10, 50), (50, 42), (90, 50)]])
    assert zones_refusal(flown.zone, 1.0, [(10, 50), (20, 20), (90, 50)]) == ""
    assert zones_refusal(flown.zone, 1.0, [(10, 50), (50, 50)]).startswith("no way from point 0 to point 1: closed by")
    assert zones_refusal(flown.zone, 1.0, [(10, 50), (50, 42)]).startswith("point 1 (50, 42) must be outside exclusion")


def test_a_question_beyond_the_limits_is_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is refused that was not checked, and the user hears of it."""
    closed = mission(FENCE, box("wall", 45, -9, 55, 109))
    with pytest.raises(MissionError):
        check_zones(closed)
    for limit in ("MAX_OVERLAPS", "MAX_WORK"):
        with monkeypatch.context() as changed:
            changed.setattr(airspace, limit, 3)
            (said,) = check_zones(closed)
            assert said == "the zones are too many or too dense to check that 1 UAVs have a way to their targets"


def test_overlapping_zones_by_the_hundred_are_checked_in_time() -> None:
    """A thousand zones that all overlap are within the limits of work, whatever the answer is."""
    zones = [circle(f"z{i}", 40 + 20 * (i % 32) / 32, 10 + 0.5 * (i // 32), 1.0) for i in range(MAX_ZONES)]
    assert [said for said in check_zones(mission(FENCE, *zones[:-1])) if "too dense" not in said] == []


# --- random missions -----------------------------------------------------------------------------


def test_a_random_mission_has_its_area_as_fence_once() -> None:
    """The fence stands with the drawn roster; a mission that has a roster has the zones that it states."""
    drawn = complete_mission(Mission(uavs=3, area_x_m=200.0, area_y_m=50.0))
    (fence,) = drawn.zone
    assert (fence.name, fence.kind, fence.keeps_disc) == ("area", "inclusion", False)
    assert fence.polygon == [(0, 0), (200, 0), (200, 50), (0, 50)]
    assert complete_mission(drawn) == drawn
    assert complete_mission(with_options(drawn, {"seed": 5})).zone == drawn.zone
    assert complete_mission(Mission(uavs=3, fence="none")).zone == []
    assert complete_mission(mission()).zone == []
    squares = [complete_mission(Mission(uavs=3, fence=fence)) for fence in ("area", "none")]
    assert squares[0].roster == squares[1].roster


def test_a_zone_may_not_take_the_name_of_the_fence() -> None:
    """Unless the mission has no fence."""
    zone = Zone(name="area", kind="exclusion", centre=[50, 50], radius_m=5)
    with pytest.raises(MissionError, match=r"zone\[0\].name = 'area': must be not \"area\", which is the fence"):
        complete_mission(Mission(zone=[zone]))
    assert complete_mission(Mission(uavs=2, zone=[zone], fence="none")).zone == [zone]


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"area_x_m": 50}, "area_y_m = 0.0: must be above 0 beside area_x_m, or both are left out"),
        ({"area_y_m": 50}, "area_x_m = 0.0: must be above 0 beside area_y_m, or both are left out"),
        ({"area_x_m": 50, "area_y_m": 60, "area_m2": 3000}, "area_m2 = 3000.0: must be left out beside area_x_m and"),
        ({"area_x_m": -1, "area_y_m": 60}, "area_x_m = -1: must be a number from 0 to 1e7"),
        ({"fence": "square"}, "fence = 'square': must be one of area, none"),
    ],
)
def test_the_rectangle_is_given_whole_and_alone(fields: dict[str, Any], said: str) -> None:
    """Both sides, and no other area."""
    with pytest.raises(MissionError) as error:
        mission_from_dict(fields)
    assert said in str(error.value)


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 10**6),
    st.lists(st.tuples(*[st.integers(0, 100)] * 2, st.integers(1, 15), st.sampled_from(["", "centre"])), max_size=5),
)
def test_random_starts_and_targets_keep_to_zones(seed: int, discs: Sequence[tuple[int, int, int, str]]) -> None:
    """They lie in the rectangle, inside all inclusion zones, and outside exclusion zones by what each asks."""
    zones = [circle(f"z{i}", x, y, radius_m, keep=keep) for i, (x, y, radius_m, keep) in enumerate(discs)]
    field = {"name": "field", "kind": "inclusion", "polygon": [[0, 0], [120, 0], [120, 60], [0, 90]], "keep": "disc"}
    fields = {"seed": seed, "uavs": 4, "r_m": 2.0, "area_x_m": 120, "area_y_m": 80, "zone": [field, *zones]}
    drawn = random_roster(mission_from_dict(fields))
    for entry in drawn:
        for x_m, y_m in ((entry.start_x_m, entry.start_y_m), (entry.target_x_m, entry.target_y_m)):
            assert 2 <= x_m <= 118
            assert 2 <= y_m <= 80
            assert 120 * (90 - y_m) - 30 * x_m >= 2 * math.hypot(120, 30) - 1e-6
            for x, y, radius_m, keep in discs:
                assert math.dist((x_m, y_m), (x, y)) >= radius_m + (0 if keep == "centre" else 2) - 1e-6


def test_a_rectangle_that_zones_fill_is_a_clear_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """It states the rectangle, not a square that nobody asked for."""
    monkeypatch.setattr("edc_swarm.mission.roster.TRIES", 50)
    full = Zone(name="full", kind="exclusion", polygon=[(-1, -1), (61, -1), (61, 31), (-1, 31)])
    with pytest.raises(PlacementError, match=r"few enough for area_x_m = 60, area_y_m = 30, its zones and r_m = 5"):
        complete_mission(Mission(uavs=1, area_x_m=60.0, area_y_m=30.0, zone=[full]))


# --- messages and files --------------------------------------------------------------------------


def test_the_message_of_a_mission_carries_its_zones_and_old_ones_have_none() -> None:
    """A message of a version without zones reads as a mission without zones."""
    whole = complete_mission(mission(FENCE, circle("pond", 50, 20, 9), r_m=2.0))
    message = mission_message(whole)
    key = Keys(whole.name).mission
    assert decode(key, encode(message)) == message
    old = msgspec.json.decode(encode(message))
    for name in ("zone", "fence", "area_x_m", "area_y_m"):
        del old[name]
    read = decode(key, msgspec.json.encode(old))
    assert isinstance(read, MissionMessage)
    assert read.zone == []


@pytest.mark.parametrize("bad", [[[0, 0], [1, 1]], [[0, 0], [2, 2], [2, 0], [0, 2]], [[0, 0], [1, 0]] * 600])
def test_a_message_with_a_bad_zone_is_rejected(bad: list[list[float]]) -> None:
    """A mission that would be refused as a file is refused on the bus."""
    raw = msgspec.json.decode(encode(mission_message(complete_mission(mission(FENCE)))))
    raw["zone"][0]["polygon"] = bad
    with pytest.raises(MessageError):
        decode(Keys("mission").mission, msgspec.json.encode(raw))


def test_the_largest_mission_fits_into_one_message() -> None:
    """Most UAVs, most zones and most corners, each number with as many digits as it can have."""
    digits = -9_999_999.123456789
    entry: dict[str, Any] = {"start_x_m": digits, "start_y_m": digits, "target_x_m": digits, "target_y_m": digits}
    own: dict[str, Any] = dict.fromkeys(("r_m", "v_max_mps"), math.e)
    roster = [
        RosterEntry(
            uav=f"{i:032d}",
            **entry,
            **own,
            body_m=math.e / 10,
            gps_m=math.e / 2,
            vehicle="hummingbird",
            energy_j=98765.4321012345,
            cluster=f"{i % MAX_CLUSTERS:032d}",
        )
        for i in range(MAX_UAVS)
    ]
    corners = [(digits, digits)] * (MAX_ALL_CORNERS // MAX_ZONES)
    zones = [Zone(name=f"{i:064d}", kind="inclusion", polygon=corners, keep="centre") for i in range(MAX_ZONES)]
    largest = mission_message(Mission(uavs=MAX_UAVS, roster=roster, zone=zones))
    assert 0.75 * MAX_MISSION_BYTES < len(encode(largest)) <= MAX_MISSION_BYTES


@pytest.mark.parametrize("file", sorted(SCENARIOS.glob("*.toml")), ids=lambda file: file.stem)
def test_every_scenario_can_be_flown(file: Path) -> None:
    """It loads, its zones are sound, every UAV has a way, and nothing warns."""
    whole = complete_mission(load_mission(file))
    assert check_zones(whole) == []
    places = [[(e.start_x_m, e.start_y_m), (e.target_x_m, e.target_y_m)] for e in whole.roster]
    lines = [
        [(a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])) for share in (0.25, 0.5, 0.75)] for a, b in places
    ]
    inside = [zones_refusal(whole.zone, e.r_m, line) for e, line in zip(whole.roster, lines, strict=True)]
    # In a scenario that is about zones, straight lines lead through them.
    assert any(inside) == (file.stem in {"city_blocks", "courtyard"})


def test_the_airspace_of_no_zones_is_free() -> None:
    """A mission without zones has nothing to check."""
    assert check_zones(mission()) == []
    assert zones_refusal([], 5.0, [(0, 0), (1e6, 0)]) == ""
    assert Airspace.of([]).clear_m(np.zeros((1, 2))).shape == (1, 0)


def test_rings_run_inside_the_grown_barriers() -> None:
    """A place beside a narrow gap between slanting walls is inside the ring, although it is far from both walls."""
    walls = [
        Zone(name="west", kind="exclusion", polygon=[(0, -50), (0, 50), (-0.01, 0)]),
        Zone(name="slope", kind="exclusion", polygon=[(30, 40), (9.9, 0), (30.01, 40)]),
        Zone(name="north", kind="exclusion", polygon=[(0, 50), (30, 40), (15, 46)]),
    ]
    assert zones_refusal(walls, 5.0, [(9.0, 11.5), (200.0, 0.0)]).endswith("closed by zones north, west, slope")
    assert zones_refusal(walls, 4.9, [(9.0, 11.5), (200.0, 0.0)]) == ""


def test_goals_in_flight_keep_to_the_zones() -> None:
    """A fault that gives a goal in a zone, or behind one, is refused by name."""
    tower = {"name": "tower", "kind": "exclusion", "centre": [75.0, 50.0], "radius_m": 12.0}
    fields: dict[str, Any] = {"uavs": 2, "zone": [tower], "seed": 3}
    complete_mission(mission_from_dict({**fields, "fault": ["goal u001 20,20 @5"]}))
    for faults, wrong in ((["goal u001 75,50 @5"], "tower"), (["kill u002 @3", "goal head 20,20 200,200 @5"], "area")):
        with pytest.raises(MissionError) as caught:
            complete_mission(mission_from_dict({**fields, "fault": faults}))
        assert caught.value.field == f"fault[{len(faults) - 1}]"
        assert wrong in str(caught.value)


def test_a_uav_refuses_a_goal_in_a_zone() -> None:
    """The UAV itself judges a goal that any client of the bus may send."""
    tower = Zone(name="tower", kind="exclusion", centre=[75.0, 50.0], radius_m=12.0)
    mission = complete_mission(mission_from_dict({"uavs": 2, "seed": 3}))
    zoned = msgspec.structs.replace(mission, zone=[*mission.zone, tower])
    entry, here_m = zoned.roster[0], (50.0, 50.0)
    assert unflyable(zoned, entry, here_m, 1e6, [(20.0, 20.0)]) == ""
    assert "tower" in unflyable(zoned, entry, here_m, 1e6, [(75.0, 50.0)])
