"""Zones in planning: the ways round them, goals, starts on an edge, and planners that ignore them."""

from __future__ import annotations

import itertools
import math
from typing import Any

import msgspec
import numpy as np
import pytest
from msgspec import convert

from edc_swarm.experiments.fuzzing import fly
from edc_swarm.geometry import Floats, length_m, segment_distance_m
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster_entry import ARRIVED_M, RosterEntry
from edc_swarm.mission.zone import Zone
from edc_swarm.mission.zones import barriers
from edc_swarm.planner import charts as chart_module
from edc_swarm.planner.charts import Charts, clear_of
from edc_swarm.planner.interface import Hull, PlanRequest
from edc_swarm.planner.registry import make_planner
from edc_swarm.planner.ways import free_goals
from edc_swarm.solver.barrier_rows import Airspace
from edc_swarm.solver.certificate import certify
from edc_swarm.solver.hull_rows import Obstacles
from edc_swarm.solver.normals import DELTA_M
from edc_swarm.solver.slot_qp import slot_problem

R_M = 5.0
Pair = tuple[tuple[float, float], tuple[float, float]]


def zone(name: str, kind: str, *corners: tuple[float, float], **fields: Any) -> Zone:
    """Return a zone with these corners."""
    return convert({"name": name, "kind": kind, "polygon": corners, **fields}, Zone)


def box(name: str, kind: str, x_m: float, y_m: float, wide_m: float, high_m: float) -> Zone:
    """Return a rectangle."""
    far_x_m, far_y_m = x_m + wide_m, y_m + high_m
    return zone(name, kind, (x_m, y_m), (far_x_m, y_m), (far_x_m, far_y_m), (x_m, far_y_m))


def mission_of(ways: list[Pair], zones: list[Zone]) -> Mission:
    """Return a mission of UAVs that fly from the first to the second point of each pair."""
    roster = [
        RosterEntry(
            uav=f"u{k}", start_x_m=start[0], start_y_m=start[1], target_x_m=end[0], target_y_m=end[1],
            r_m=R_M, body_m=0.5, energy_j=1e9,
        )
        for k, (start, end) in enumerate(ways)
    ]  # fmt: skip
    return Mission(roster=roster, uavs=len(roster), zone=zones)


def flown(ways: list[Pair], zones: list[Zone], slots: int = 400) -> tuple[Floats, Floats]:
    """Fly with the planner alone; return the last positions and the ways flown, after checks of every step."""
    planner = make_planner("edc", mission_of(ways, zones))
    position_m, target_m = np.array(ways, dtype=float).transpose(1, 0, 2)
    r_m, edges = np.full(len(ways), R_M), barriers(zones)
    path_m = np.zeros(len(ways))
    for slot in range(slots):
        plan = planner.plan(PlanRequest(slot, range(len(ways)), position_m, target_m, r_m))
        end_m = np.array(plan.waypoint_m)
        away_m = segment_distance_m(position_m[:, None], end_m[:, None], edges.a_m, edges.b_m) - edges.least_m(r_m)
        assert away_m.min() >= 0
        path_m += length_m(end_m - position_m)
        position_m = end_m
        if (length_m(position_m - target_m) < ARRIVED_M).all():
            break
    return position_m, path_m


POCKET = zone("pocket", "exclusion", (30, -40), (60, -40), (60, 40), (30, 40), (30, 35), (55, 35), (55, -35), (30, -35))
GATE_M = 2 * (R_M + DELTA_M) + 1e-4
"""Width of a corridor for one disc: twice the radius and the slot QP's buffer, and rounding."""
CORRIDOR = [
    box("north", "exclusion", 40, GATE_M / 2, 20, 100),
    box("south", "exclusion", 40, -GATE_M / 2 - 100, 20, 100),
    box("area", "inclusion", -20, -60, 140, 120),
]
ELBOW = zone("elbow", "inclusion", (0, 0), (100, 0), (100, 20), (20, 20), (20, 100), (0, 100))
TOUCHING = [box("west", "exclusion", 30, -20, 20, 30), box("east", "exclusion", 50, -10, 20, 40)]


@pytest.mark.parametrize(
    ("zones", "ways"),
    [
        ([POCKET], [((50, 0), (100, 0)), ((0, 0), (90, 20))]),
        (CORRIDOR, [((0, 0), (100, 0)), ((100, 20), (0, 20)), ((0, -20), (100, -20))]),
        ([ELBOW], [((95, 10), (10, 95)), ((0, 0), (100, 0))]),
        (TOUCHING, [((40, -40), (60, 50)), ((0, 0), (100, 0))]),
        ([convert({"name": "c", "kind": "exclusion", "centre": [50, 0], "radius_m": 20.0}, Zone)], [((0, 0), (99, 0))]),
    ],
    ids=["pocket", "corridor", "concave fence", "touching zones", "circle"],
)
def test_uavs_find_their_ways_round_zones(zones: list[Zone], ways: list[Pair]) -> None:
    """Out of a pocket, through a corridor one disc wide, along a concave fence that passes through their starts."""
    position_m, _ = flown(ways, zones)
    assert (length_m(position_m - np.array([end for _, end in ways])) < ARRIVED_M).all()


def test_the_way_round_a_circle_is_the_shortest() -> None:
    """It is two tangents and an arc, but for the corners of the chart."""
    circle = convert({"name": "c", "kind": "exclusion", "centre": [50.0, 0.0], "radius_m": 20.0}, Zone)
    _, path_m = flown([((0.0, 0.0), (100.0, 0.0))], [circle])
    keep_m = 20.0 + R_M
    shortest_m = 2 * math.sqrt(50**2 - keep_m**2) + keep_m * (math.pi - 2 * math.acos(keep_m / 50))
    assert shortest_m < path_m[0] < 1.02 * shortest_m


def test_a_zone_that_closes_the_only_way_is_not_entered() -> None:
    """The UAV has no way, flies as near as it gets, and stays in the airspace."""
    area, wall = box("area", "inclusion", 0, 0, 100, 40), box("wall", "exclusion", 50, -5, 5, 50)
    charts = Charts.of(Airspace.of(barriers([area, wall]), R_M, R_M))
    start_m, end_m = np.array([10.0, 20.0]), np.array([90.0, 20.0])
    assert not charts.reaches(0, R_M, start_m, end_m)
    assert charts.reaches(0, R_M, start_m, np.array([40.0, 35.0]))
    position_m, _ = flown([((10.0, 20.0), (90.0, 20.0))], [area, wall], 60)
    assert position_m[0, 0] <= 45.0


def test_a_target_in_a_corner_of_the_fence_that_a_hull_covers_becomes_a_place_inside() -> None:
    """A dead UAV hovers over the corner; the goal keeps away from it and does not leave the fence."""
    airspace = Airspace.of(barriers([box("area", "inclusion", 0, 0, 100, 100)]), R_M, R_M)
    dead = Obstacles(np.array([[4.0, 4.0]]), np.array([[4.0, 4.0]]), np.zeros(1), np.full(1, R_M))
    target_m = np.array([[1.0, 1.0], [100.0, 50.0]])
    goal_m = free_goals(target_m, np.full(2, R_M), dead, airspace)
    assert airspace.contains(goal_m).all()
    assert clear_of(airspace, goal_m, np.full(2, R_M)).all()
    assert length_m(goal_m[0] - dead.a_m[0]) >= 2 * R_M + DELTA_M
    assert length_m(goal_m[1] - target_m[1]) < ARRIVED_M


def test_a_hull_in_the_corridor_sends_uavs_the_other_way_round() -> None:
    """The chart's way is blocked by a dead UAV: hulls and zones are passed together."""
    wall = box("wall", "exclusion", 40, -20, 20, 40)
    planner = make_planner("edc", mission_of([((0, 1), (100, 1)), ((50, 26), (50, 26))], [wall]))
    position_m, dead = np.array([[0.0, 1.0]]), Hull(1, 50.0, 26.0, 50.0, 26.0, 0.0, R_M)
    for slot in range(200):
        position_m = np.array(
            planner.plan(PlanRequest(slot, [0], position_m, [(100.0, 1.0)], [R_M], [dead])).waypoint_m
        )
    assert length_m(position_m[0] - (100.0, 1.0)) < ARRIVED_M


@pytest.mark.parametrize("turn", [0.0, 0.7, 2.4])
def test_from_an_edge_only_the_airspace_is_open(turn: float) -> None:
    """Rounding puts a start on a sloping fence a hair to either side; no step leads out, and steps lead in."""
    angle = turn + np.arange(4) * math.pi / 2
    corner_m = 50 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    airspace = Airspace.of(barriers([zone("area", "inclusion", *map(tuple, corner_m.tolist()))]), R_M, R_M)
    for share, sign in itertools.product((0.0, 0.1, 1 / 3, 0.77), (1.0, -1.0)):
        start_m = corner_m[0] + share * (corner_m[1] - corner_m[0])
        wish_m = start_m - sign * 2 * start_m / length_m(start_m)
        problem = slot_problem(start_m[None], wish_m[None], np.full(1, R_M), 2.5, airspace=airspace)
        end_m = certify(problem, problem.wish_step_m).waypoint_m
        assert (length_m(end_m - start_m)[0] > 1.9) == (sign > 0)
        assert sign > 0 or length_m(end_m - start_m)[0] < 1e-9


def test_the_search_for_ways_ends_at_its_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    """With few tests a slot the chart is completed over several slots, and then the UAV has its way."""
    charts = Charts.of(Airspace.of(barriers([POCKET]), R_M, R_M))
    start_m, goal_m = np.array([50.0, 0.0]), np.array([100.0, 0.0])
    budget, spent, node = 300, [], -1
    while node < 0:
        _, node, _, tests = charts.way(0, R_M, start_m, goal_m, budget)
        spent.append(tests)
        assert len(spent) < 50
    assert len(spent) > 1
    assert max(spent) < 2 * budget + 2 * len(charts.chart(R_M).known) * len(charts.airspace.barriers.a_m)
    monkeypatch.setattr(chart_module, "MAX_NODES", 5)
    assert len(chart_module.nodes(charts.airspace, R_M)) <= 5


@pytest.mark.parametrize("planner", ["straight", "paper"])
def test_planners_that_avoid_nothing_break_zones(planner: str) -> None:
    """They ignore zones, and G8 says so."""
    mission = mission_of([((0, 0), (40, 0)), ((0, 30), (40, 30))], [box("z", "exclusion", 15, -5, 10, 10)])
    said = fly(msgspec.structs.replace(mission, planner=planner, max_slots=60))
    assert any(line.startswith("G8: u0: its disc is in zone 'z' by up to") for line in said)
