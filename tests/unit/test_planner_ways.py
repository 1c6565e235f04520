"""Ways round hulls: the planner finds them, and where it cannot get to its goal is a place where it can wait."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from edc_swarm.geometry import capsule_distance_m, length_m, segment_distance_m
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster_entry import ARRIVED_M
from edc_swarm.planner.charts import Charts
from edc_swarm.planner.interface import Hull, PlanRequest
from edc_swarm.planner.registry import make_planner
from edc_swarm.planner.ways import free_goals, routed, walls_of
from edc_swarm.solver.barrier_rows import Airspace
from edc_swarm.solver.hull_rows import Obstacles
from edc_swarm.solver.normals import DELTA_M

R_M = 5.0
WALL = (1.0, 1.0)
"""Radius and GPS radius of a long capsule."""


def fly(hulls: Sequence[Sequence[float]], start_m: object, target_m: object, slots: int) -> tuple[int, float]:
    """Fly with the planner until all are at their targets: slots flown, and metres of way; nobody comes too near."""
    planner = make_planner("edc", Mission(uavs=4))
    position_m, goal_m = np.array(start_m, dtype=float), np.array(target_m, dtype=float)
    shapes = np.array(hulls, dtype=float)
    uav, way_m = np.arange(len(position_m)), 0.0
    for slot in range(slots):
        if (length_m(position_m - goal_m) <= ARRIVED_M).all():
            return slot, way_m
        request = PlanRequest(
            slot, uav.tolist(), position_m, goal_m, [R_M] * len(uav), [Hull(100 + i, *h) for i, h in enumerate(hulls)]
        )
        after_m = np.array(planner.plan(request).waypoint_m)
        way_m += float(length_m(after_m - position_m).sum())
        near_m = segment_distance_m(position_m[:, None], after_m[:, None], shapes[None, :, :2], shapes[None, :, 2:4])
        start_near_m = segment_distance_m(
            position_m[:, None], position_m[:, None], shapes[None, :, :2], shapes[None, :, 2:4]
        )
        assert (near_m >= np.minimum(R_M + shapes[:, 4] + shapes[:, 5], start_near_m) - 1e-9).all()
        position_m = after_m
    return slots, way_m


SLALOM = [(20, -100, 20, 20, *WALL), (50, -20, 50, 100, *WALL), (80, -100, 80, 20, *WALL), (110, -20, 110, 100, *WALL)]


def test_four_long_capsules_are_flown_round() -> None:
    """Each is wider than the look-ahead, and a disc about its middle would hold the UAV: it flies the shortest way."""
    slots, way_m = fly(SLALOM, [(0, 0)], [(130, 0)], 150)
    assert slots < 125
    assert way_m < 270


def test_several_fly_round_the_same_capsules() -> None:
    """Four UAVs one behind the other through the same gaps."""
    start_m = [(0, 0), (0, 20), (0, -20), (0, 40)]
    slots, _ = fly(SLALOM, start_m, [(130 + x, y) for x, y in start_m], 150)
    assert slots < 150


@pytest.mark.parametrize(
    ("hulls", "start_m", "target_m", "most"),
    [
        # Within four walls.
        ([(-60, -60, 60, -60, *WALL), (60, -60, 60, 60, *WALL), (60, 60, -60, 60, *WALL), (-60, 60, -60, -60, *WALL)],
         (-40, -40), (40, 40), 47),
        # Out of a pocket twice as deep as guidance looks ahead.
        ([(0, -100, 0, 100, *WALL), (0, 100, -200, 100, *WALL), (0, -100, -200, -100, *WALL)], (-20, 0), (40, 0), 230),
        # Round either end of a wall: it does not change its mind.
        ([(0, -150, 0, 150, *WALL)], (-8, 0), (40, 0), 140),
        # From nearer than R to a wall.
        ([(0, -50, 0, 50, *WALL)], (-6.5, 0), (20, 0), 60),
        # Between two balls that leave just room enough.
        ([(0, 12.53, 0, 12.53, 2.5, 5), (0, -12.53, 0, -12.53, 2.5, 5)], (-30, 1), (30, -1), 30),
    ],
)  # fmt: skip
def test_a_free_target_is_reached(
    hulls: list[Sequence[float]], start_m: tuple[float, float], target_m: tuple[float, float], most: int
) -> None:
    """Pockets, walls and gaps: a target that can be reached is reached, in about the time that the way takes."""
    slots, _ = fly(hulls, [start_m], [target_m], most)
    assert slots < most


@pytest.mark.parametrize("gap_m", [0.0, 0.005, 0.019, 0.5])
def test_a_target_just_beside_a_hull_is_reached(gap_m: float) -> None:
    """Free means R from the hull itself: not from a disc about it, and not R and the slot QP's buffer."""
    side = [(-1.25, 0.0, 1.25, 0.0, 0.0, 5.0)]
    slots, _ = fly(side, [(3, 40)], [(0.3, -2 * R_M - gap_m)], 40)
    assert slots < 40


def capsule(*ends_m: float) -> Obstacles:
    """One hull, with R about it."""
    ends = np.array([ends_m])
    return Obstacles(ends[:, :2], ends[:, 2:], np.zeros(1), np.full(1, R_M))


def test_goals_that_are_free_stay() -> None:
    """To the bit, with and without hulls."""
    target_m = np.array([[30.0, 0.1], [0.0, 30.3]])
    assert free_goals(target_m, np.full(2, R_M), Obstacles.none()).tolist() == target_m.tolist()
    assert free_goals(target_m, np.full(2, R_M), capsule(0, 0, 1, 0)).tolist() == target_m.tolist()


def test_a_goal_within_the_buffer_moves_by_less_than_arriving_takes() -> None:
    """A target at R is free, so whoever stops at R + delta from the hull has arrived."""
    target_m = np.array([[0.5, 2 * R_M]])
    goal_m = free_goals(target_m, np.array([R_M]), capsule(0, 0, 1, 0))
    assert capsule_distance_m(goal_m, (0, 0), (1, 0), 0.0) >= 2 * R_M + DELTA_M
    assert length_m(goal_m - target_m) < ARRIVED_M / 2


def test_a_covered_target_becomes_a_place_out_of_the_way() -> None:
    """A UAV whose target is covered waits near by, clear of the hull and of the targets of the others."""
    target_m = np.array([[0.5, 1.0], [0.5, 10.5], [0.5, -0.5]])
    goal_m = free_goals(target_m, np.full(3, R_M), capsule(0, 0, 1, 0))
    assert goal_m[1].tolist() == target_m[1].tolist()
    assert (capsule_distance_m(goal_m, (0, 0), (1, 0), 0.0) >= 2 * R_M + DELTA_M).all()
    apart_m = length_m(goal_m[:, None] - goal_m[None])[np.triu_indices(3, 1)]
    assert apart_m.min() >= 2 * R_M + DELTA_M
    assert (length_m(goal_m - target_m) < 25).all()


def test_the_way_is_the_shortest_and_none_is_none() -> None:
    """Round one disc the way is two tangents and an arc, but for the polygon; out of a closed box there is none."""
    hull = capsule(0, 0, 0, 0)
    position_m, goal_m = np.array([[-30.0, 0.0]]), np.array([[30.0, 0.0]])
    alone = np.zeros(1, np.int64), np.array([R_M]), Charts.of(Airspace.unbounded())
    _, way_m = routed(position_m, goal_m, walls_of(position_m, np.array([R_M]), hull), 0, *alone)
    keep_m = 2 * R_M + DELTA_M
    tangent_m = np.sqrt(30**2 - keep_m**2)
    shortest_m = 2 * tangent_m + keep_m * (np.pi - 2 * np.arccos(keep_m / 30))
    assert shortest_m < way_m[0] < 1.02 * shortest_m
    corner_m = np.array([(-40.0, -40.0), (40.0, -40.0), (40.0, 40.0), (-40.0, 40.0)])
    box = Obstacles(corner_m, np.roll(corner_m, -1, axis=0), np.zeros(4), np.full(4, R_M))
    walls = walls_of(np.zeros((1, 2)), np.array([R_M]), box)
    first_m, way_m = routed(np.zeros((1, 2)), 3 * goal_m, walls, 0, *alone)
    assert first_m.tolist() == (3 * goal_m).tolist()
    assert way_m.tolist() == [90.0]


def test_nobody_waits_for_a_uav_that_is_held() -> None:
    """One within a hull wants to fly across the others and never does; the one whose target is free flies home."""
    planner = make_planner("edc", Mission(uavs=4))
    position_m = np.array([(22.06, 9.92), (3.83, 10.23), (29.45, 24.97)])
    target_m = np.array([(12.76, 5.75), (27.21, 28.68), (23.83, 8.49)])
    hull = Hull(3, -5.69, 13.40, -6.07, 12.01, 15.0, R_M)
    for slot in range(60):
        request = PlanRequest(slot, [0, 1, 2], position_m, target_m, [R_M] * 3, [hull])
        position_m = np.array(planner.plan(request).waypoint_m)
    assert position_m[1].tolist() == [3.83, 10.23]
    assert length_m(position_m[2] - target_m[2]) <= ARRIVED_M
