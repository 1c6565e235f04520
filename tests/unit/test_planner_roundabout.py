"""The roundabout: when a planner that knows no tracks starts with one, and what it costs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from edc_swarm.geometry import Floats, length_m
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import random_roster
from edc_swarm.planner import guidance_kernel, roundabout, roundabout_kernel, ways
from edc_swarm.planner.charts import Charts
from edc_swarm.planner.interface import PlanRequest
from edc_swarm.planner.registry import make_planner
from edc_swarm.solver.barrier_rows import Airspace
from edc_swarm.solver.hull_rows import Obstacles

STEP_M = 2.5


def circle(uavs: int, radius_m: float = 40.0) -> Floats:
    """Return evenly spaced places on a circle about the origin."""
    angle = np.arange(uavs) * 2 * math.pi / uavs
    return radius_m * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def bends_m(start_m: Floats, goal_m: Floats, hulls: Obstacles | None = None) -> Floats:
    """Return the points by which UAVs of radius 5 m fly."""
    r_m = np.full(len(start_m), 5.0)
    walls = ways.walls_of(start_m, r_m, hulls or Obstacles.none())
    barred = Charts.of(Airspace.unbounded()).barred
    return roundabout.roundabout(start_m, goal_m, r_m, np.full(len(start_m), STEP_M), walls, barred)


def turns(start_m: Floats, bend_m: Floats) -> Floats:
    """Return the sense in which each passes the origin: -1, 0 or 1."""
    return np.sign(np.round(start_m[:, 0] * bend_m[:, 1] - start_m[:, 1] * bend_m[:, 0], 6))


@pytest.mark.parametrize("uavs", [10, 20, 50])
def test_all_pass_the_centre_of_a_circle_on_the_same_side(uavs: int) -> None:
    """On a circle every UAV passes the centre in the same sense, at the same distance."""
    start_m = circle(uavs, max(40.0, 10.5 * uavs / (2 * math.pi)))
    bend_m = bends_m(start_m, -start_m)
    assert abs(turns(start_m, bend_m).sum()) == uavs
    assert np.ptp(length_m(bend_m)) < 1e-6


@pytest.mark.parametrize(("uavs", "bends"), [(6, False), (7, True), (300, True), (301, False)])
def test_few_and_very_many_fly_straight(uavs: int, bends: bool) -> None:
    """Fewer than seven are near the optimum without, and more than 300 would take too long to compare."""
    start_m = circle(uavs, max(40.0, 10.5 * uavs / (2 * math.pi)))
    assert (bends_m(start_m, -start_m) != start_m).any() == bends


@pytest.mark.parametrize("scale_m", [1e-6, 1.0, 1e6])
def test_any_places_have_a_roundabout_or_none(scale_m: float) -> None:
    """Places on one line, on one point, or next to each other give finite bends."""
    place = np.arange(24.0).reshape(12, 2)
    line, point = np.stack([place[:, 0], np.zeros(12)], axis=-1), np.zeros((12, 2))
    for start_m, goal_m in ((line, -line), (line, line[::-1]), (place, point), (point, place), (point, point)):
        assert np.isfinite(bends_m(scale_m * start_m, scale_m * goal_m)).all()


def test_it_turns_about_the_crowd_and_leaves_the_others_alone() -> None:
    """The centre is that of the UAVs that fly; one at its goal stays."""
    beside_m = np.array([[200.0, 0.0], [200.0, 50.0]])
    middle_m = np.array([300.0, -70.0])
    start_m = np.concatenate([circle(16) + middle_m, beside_m])
    goal_m = np.concatenate([middle_m - circle(16), beside_m])
    bend_m = bends_m(start_m, goal_m)
    assert abs(turns(start_m[:16] - middle_m, bend_m[:16] - middle_m).sum()) == 16
    assert (bend_m[16:] == beside_m).all()


@pytest.mark.parametrize("seed", range(5))
def test_ways_that_cross_by_chance_stay_straight(seed: int) -> None:
    """Random missions, even dense ones, begin with straight ways."""
    roster = random_roster(Mission(uavs=50, area_m2=10_000.0, seed=seed, fence="none"))
    start_m = np.array([(entry.start_x_m, entry.start_y_m) for entry in roster])
    goal_m = np.array([(entry.target_x_m, entry.target_y_m) for entry in roster])
    assert (bends_m(start_m, goal_m) == start_m).all()


def test_parallel_ways_and_uavs_at_their_goals_stay_straight() -> None:
    """Nobody is sent aside who meets nobody in the middle."""
    start_m = np.stack([np.zeros(8), np.arange(8) * 3.0], axis=-1)
    assert (bends_m(start_m, start_m + np.array([60.0, 0.0])) == start_m).all()
    assert (bends_m(start_m, start_m) == start_m).all()


def test_no_leg_leads_through_a_hull() -> None:
    """A UAV whose bend would lead through a hull flies straight, the others do not."""
    start_m = circle(20)
    free_m = bends_m(start_m, -start_m)
    hulls = Obstacles(free_m[:1], free_m[:1], np.ones(1), np.zeros(1))
    bend_m = bends_m(start_m, -start_m, hulls)
    straight = (bend_m == start_m).all(axis=1)
    assert straight.any()
    assert not straight.all()
    walls = ways.walls_of(start_m, np.full(20, 5.0), hulls)
    for k in np.flatnonzero(~straight).tolist():
        assert guidance_kernel.open_way(walls, k, *start_m[k], *bend_m[k])
        assert guidance_kernel.open_way(walls, k, *bend_m[k], *-start_m[k])


def test_the_least_distance_is_that_of_dense_samples() -> None:
    """Conflicts cost what the exact closest approach of two bent ways says."""
    random = np.random.default_rng(1)
    slots = np.linspace(0.0, 60.0, 20_001)
    for _ in range(20):
        start_m, bend_m, goal_m = random.uniform(0.0, 40.0, (3, 2, 2))
        if random.random() < 0.3:
            bend_m = start_m
        u_max_m = random.uniform(1.0, 3.0, 2)
        place_m = []
        for k in range(2):
            first, second = length_m(bend_m[k] - start_m[k]), length_m(goal_m[k] - bend_m[k])
            flown_m = slots * u_max_m[k]
            share = np.clip(flown_m / max(first, 1e-12), 0.0, 1.0)[:, None]
            rest = np.clip((flown_m - first) / second, 0.0, 1.0)[:, None]
            place_m.append(start_m[k] + share * (bend_m[k] - start_m[k]) + rest * (goal_m[k] - bend_m[k]))
        sampled_m = length_m(place_m[0] - place_m[1]).min()
        r_m = np.full(2, 30.0)
        flown, lost = roundabout_kernel.entangled(start_m, bend_m, goal_m, r_m, u_max_m)
        legs_m = length_m(bend_m - start_m) + length_m(goal_m - bend_m)
        assert flown == pytest.approx((legs_m / u_max_m).sum())
        assert lost == pytest.approx((60.0 - sampled_m) * 2 / u_max_m.sum(), abs=0.02)


def flown_m(uavs: int, seed: int) -> float:
    """Return the distance that all fly from one side of a circle to the other."""
    mission = Mission(uavs=uavs, area_m2=10_000.0, seed=seed, fence="none")
    planner = make_planner("edc", mission)
    start_m = position_m = circle(uavs)
    distance_m = 0.0
    for slot in range(150):
        request = PlanRequest(slot, range(uavs), position_m, -start_m, np.full(uavs, 5.0))
        after_m = np.array(planner.plan(request).waypoint_m)
        distance_m += float(length_m(after_m - position_m).sum())
        position_m = after_m
    assert length_m(position_m + start_m).max() < 1e-6
    return distance_m


def test_a_circle_costs_less_than_without(monkeypatch: pytest.MonkeyPatch) -> None:
    """UAVs on a circle fly less with a roundabout than without."""
    with_it_m = flown_m(20, 1)
    monkeypatch.setattr(roundabout, "LARGEST_CROWD", 0)
    assert with_it_m < 0.95 * flown_m(20, 1)
