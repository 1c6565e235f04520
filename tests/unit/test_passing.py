"""Missions in which one UAV would have to pass another where zones leave no room."""

from __future__ import annotations

import math
import re
from typing import Any

import pytest
from shapely.geometry import Polygon

from edc_swarm.errors import MissionError
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.passing import check_passing
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.mission.zone import Zone
from tests.builders import entry, mission

ALLEY = [(0.0, 0.0), (90.0, 0.0), (90.0, 11.0), (0.0, 11.0)]
NICHE = [(0.0, 0.0), (90.0, 0.0), (90.0, 11.0), (52.0, 11.0), (52.0, 24.0), (40.0, 24.0), (40.0, 11.0), (0.0, 11.0)]
SHALLOW = [(x, min(y, 16.0)) for x, y in NICHE]
RING = [(0.0, 0.0), (60.0, 0.0), (60.0, 60.0), (0.0, 60.0)]
BLOCK = [(11.0, 11.0), (49.0, 11.0), (49.0, 49.0), (11.0, 49.0)]
HEAD_ON = [entry("a", (6, 5.5), (84, 5.5)), entry("b", (84, 5.5), (6, 5.5))]


def fence(polygon: list[tuple[float, float]], **fields: Any) -> Zone:
    """An inclusion zone that whole discs keep to."""
    return Zone(**{"name": "fence", "kind": "inclusion", "polygon": polygon, "keep": "disc", **fields})


def refusal(roster: list[RosterEntry], *zones: Zone, **fields: Any) -> str:
    """Why the mission cannot be flown, "" if nothing is proven."""
    try:
        complete_mission(mission(roster, zone=list(zones), dt_s=0.5, v_max_mps=5.0, **fields))
    except MissionError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("width_m", [10.0, 14.0, 16.0, 18.0, 19.5])
def test_head_on_in_a_dead_end_is_refused(width_m: float) -> None:
    """One line with the UAV, its target, the other UAV and the reason."""
    roster = [entry("a", (6, width_m / 2), (84, width_m / 2)), entry("b", (84, width_m / 2), (6, width_m / 2))]
    said = refusal(roster, fence([(x, min(y, width_m) if y else y) for x, y in [*ALLEY[:2], (90, 99), (0, 99)]]))
    assert re.match(r"roster\[1\]\.target_x_m, target_y_m = \(6(\.0)?, .*: must be reachable without passing a", said)


@pytest.mark.parametrize(
    ("name", "roster", "zones"),
    [
        ("side by side", HEAD_ON, [fence([(x, 2 * y) for x, y in ALLEY])]),
        ("just wide enough", HEAD_ON, [fence([(x, 20 / 11 * y) for x, y in ALLEY])]),
        ("a niche", HEAD_ON, [fence(NICHE)]),
        ("round a block", [entry("a", (6, 5.5), (30, 54.5)), entry("b", (54.5, 30), (5.5, 30))],
         [fence(RING), Zone(name="block", kind="exclusion", polygon=BLOCK, keep="disc")]),
        ("one behind the other", [entry("a", (6, 5.5), (60, 5.5)), entry("b", (30, 5.5), (84, 5.5))], [fence(ALLEY)]),
        ("two alleys", [HEAD_ON[0], entry("b", (84, 35.5), (6, 35.5))],
         [fence([(0, 0), (90, 0), (90, 41), (0, 41)]),
          Zone(name="wall", kind="exclusion", polygon=[(-1, 11), (91, 11), (91, 30), (-1, 30)])]),
        ("no zones", HEAD_ON, []),
    ],
)  # fmt: skip
def test_what_can_be_flown_is_not_refused(name: str, roster: list[RosterEntry], zones: list[Zone]) -> None:
    """Room beside each other, a niche, a second way, or no need to pass."""
    assert refusal(roster, *zones) == "", name


@pytest.mark.parametrize("turn", [0.3, 1.2])
def test_a_lane_may_lie_askew(turn: float) -> None:
    """Of 3.8 radii, in any direction; UAVs in order are not refused."""

    def turned(x: float, y: float) -> tuple[float, float]:
        return x * math.cos(turn) - y * math.sin(turn), x * math.sin(turn) + y * math.cos(turn)

    zone = fence([turned(x, 19 / 11 * y) for x, y in ALLEY])
    left, right = turned(10, 9), turned(80, 10)
    assert "without passing a" in refusal([entry("a", left, right), entry("b", right, left)], zone)
    near = turned(40, 9.5)
    assert refusal([entry("a", left, near), entry("b", near, right)], zone) == ""


def test_a_shallow_niche_does_not_help() -> None:
    """A UAV in it still blocks the alley."""
    assert "without passing a" in refusal(HEAD_ON, fence(SHALLOW))


def test_three_uavs_in_one_order_and_in_another() -> None:
    """The first pair out of order is named, whichever the others are."""
    starts, zone = [(6, 5.5), (30, 5.5), (60, 5.5)], fence(ALLEY)
    in_order = [entry(uav, start, (start[0] + 20, 5.5)) for uav, start in zip("abc", starts, strict=True)]
    assert refusal(in_order, zone) == ""
    swapped = [in_order[0], entry("b", starts[1], (80, 5.5)), entry("c", starts[2], (50, 5.5))]
    assert "roster[2]" in (said := refusal(swapped, zone))
    assert "without passing b" in said


def test_unlike_radii_count_as_the_smaller_one() -> None:
    """Discs of 5 m and 3 m do not pass where two of 3 m do not."""
    roster = [HEAD_ON[0], entry("b", (84, 5.5), (6, 5.5), r_m=4.0)]
    assert "discs of 4 m" in refusal(roster, fence(ALLEY))


def test_routes_count_by_their_ends() -> None:
    """UAVs that turn back before they meet are not refused."""
    there = [entry("a", (6, 5.5), route=[(35, 5.5), (6, 5.5)]), entry("b", (84, 5.5), route=[(50, 5.5), (84, 5.5)])]
    assert refusal(there, fence(ALLEY)) == ""
    across = [entry("a", (6, 5.5), route=[(35, 5.5), (84, 5.5)]), there[1]]
    assert "without passing a" in refusal([across[0], entry("b", (84, 5.5), route=[(50, 5.5), (6, 5.5)])], fence(ALLEY))


def test_faults_and_lifelong_goals_prove_nothing() -> None:
    """A UAV that dies and lands makes way; lifelong targets need not be reached together."""
    base = Mission(roster=HEAD_ON, uavs=2, zone=[fence(ALLEY)])
    with pytest.raises(MissionError):
        check_passing(base)
    check_passing(Mission(roster=HEAD_ON, uavs=2, zone=[fence(ALLEY)], fault=["kill a @3"]))
    check_passing(Mission(roster=HEAD_ON, uavs=2, zone=[fence(ALLEY)], goals="lifelong"))


def test_the_alleys_are_as_they_are_described() -> None:
    """By an independent geometry library: a disc of 5 m fits into all of them, and into the deep niche as well."""
    middles = {
        name: Polygon(shape).buffer(-5) for name, shape in {"alley": ALLEY, "niche": NICHE, "x": SHALLOW}.items()
    }
    assert all(middle.geom_type == "Polygon" for middle in middles.values())
    assert middles["niche"].bounds[3] == pytest.approx(19.0)
    assert middles["x"].bounds[3] == pytest.approx(11.0)
