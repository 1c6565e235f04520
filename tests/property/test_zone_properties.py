"""Zones: our geometry against shapely, and steps near random zones however they are flown."""

from __future__ import annotations

import math
from random import Random
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import convert
from msgspec.structs import replace

from edc_swarm.analysis.breaches import breaches
from edc_swarm.experiments.random_zones import random_zones
from edc_swarm.geometry import Floats, segment_distance_m
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.zone import Zone
from edc_swarm.mission.zones import barriers
from edc_swarm.planner import guidance_kernel as kernel
from edc_swarm.planner.charts import Charts, clear_of
from edc_swarm.planner.interface import PlanRequest
from edc_swarm.planner.registry import make_planner
from edc_swarm.planner.safe import airspace_of
from edc_swarm.solver.barrier_rows import Airspace
from edc_swarm.solver.certificate import certify
from edc_swarm.solver.normals import DELTA_M
from edc_swarm.solver.slot_qp import slot_problem
from edc_swarm.solver.solution import Memory, active_program, solve

TOLERANCE_M = 1e-9
seeds = st.integers(0, 2**32 - 1)


def star(rng: np.random.Generator, around_m: Floats, size_m: float) -> list[list[float]]:
    """Return the corners of a simple polygon, convex or not, of one sense of rotation or the other."""
    count = int(rng.integers(3, 12))
    turn = (np.arange(count) + rng.uniform(0, 0.8, count)) * math.tau / count
    away_m = size_m * rng.uniform(0.1, 1.0, count)
    corners = around_m + away_m[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    polygon: list[list[float]] = corners[:: rng.choice([1, -1])].tolist()
    return polygon


def any_zone(rng: np.random.Generator, name: str) -> Zone:
    """Return a polygon or circle of either kind and rule, near the origin."""
    rules: Any = {
        "name": name,
        "kind": rng.choice(["inclusion", "exclusion"]),
        "keep": rng.choice(["", "disc", "centre"]),
    }
    around_m = rng.uniform(-10, 10, 2)
    if rng.random() < 0.3:
        return convert({**rules, "centre": around_m.tolist(), "radius_m": float(rng.uniform(1, 20))}, Zone)
    return convert({**rules, "polygon": star(rng, around_m, float(rng.uniform(2, 30)))}, Zone)


def shape(zone: Zone) -> shapely.Polygon:
    """Return the zone as a polygon of shapely."""
    assert zone.polygon
    return shapely.Polygon(zone.polygon)


def depth_m(zone: Zone, p_m: Floats, q_m: Floats, keep_m: float) -> float:
    """Return by how much a motion breaks a polygon, by shapely: exact if it does not reach the wrong side."""
    motion, polygon = shapely.LineString([p_m, q_m]), shape(zone)
    gap_m = float(motion.distance(polygon.boundary))
    wrong = motion.difference(polygon) if zone.kind == "inclusion" else motion.intersection(polygon)
    if wrong.is_empty or (gap_m == 0 and wrong.length == 0):
        return keep_m - gap_m
    points = shapely.points(shapely.get_coordinates(shapely.segmentize(wrong, max(wrong.length / 64, 1e-9))))
    return keep_m + float(shapely.distance(points, polygon.boundary).max())


@settings(max_examples=150, deadline=None)
@given(seed=seeds)
def test_breaches_are_those_of_shapely(seed: int) -> None:
    """Broken or not, and by how much, for polygons of both kinds and both rules."""
    rng = np.random.default_rng(seed)
    zone = any_zone(rng, "z")
    p_m, q_m = rng.uniform(-35, 35, (2, 8, 2))
    q_m = np.where(rng.random((8, 1)) < 0.7, p_m + 0.1 * (q_m - p_m), q_m)
    keep_m = rng.uniform(0.1, 6.0, 8) * zone.keeps_disc
    breach_m, share = breaches(zone, p_m, q_m, keep_m)
    assert ((share >= 0) & (share <= 1)).all()
    for k in range(8):
        if zone.polygon:
            expected_m = depth_m(zone, p_m[k], q_m[k], float(keep_m[k]))
        else:
            centre, motion = shapely.Point(zone.centre), shapely.LineString([p_m[k], q_m[k]])
            away_m = motion.distance(centre) if zone.kind == "exclusion" else motion.hausdorff_distance(centre)
            expected_m = keep_m[k] + (1 if zone.kind == "inclusion" else -1) * (away_m - zone.radius_m)
        assert (breach_m[k] > TOLERANCE_M) == (expected_m > TOLERANCE_M)
        if 0 < expected_m < keep_m[k]:
            assert breach_m[k] == pytest.approx(expected_m, abs=1e-9)
        elif expected_m > TOLERANCE_M:
            assert breach_m[k] == pytest.approx(expected_m, rel=0.2, abs=1e-9)


@settings(max_examples=120, deadline=None)
@given(seed=seeds)
def test_touching_is_no_breach_but_crossing_is(seed: int) -> None:
    """On a grid of integers motions run along edges and through corners; shapely is exact there."""
    rng = np.random.default_rng(seed)
    corners = rng.integers(-4, 5, (int(rng.integers(3, 7)), 2)).astype(float)
    polygon = shapely.Polygon(corners)
    if not polygon.is_valid or polygon.area == 0:
        return
    p_m, q_m = rng.integers(-5, 6, (2, 40, 2)).astype(float)
    for kind in ("inclusion", "exclusion"):
        zone = convert({"name": "z", "kind": kind, "polygon": corners.tolist(), "keep": "centre"}, Zone)
        breach_m, _ = breaches(zone, p_m, q_m, np.zeros(40))
        for k in range(40):
            if (p_m[k] == q_m[k]).all():
                continue  # Shapely has no line without a length.
            motion = shapely.LineString([p_m[k], q_m[k]])
            if kind == "inclusion":
                expected = not polygon.covers(motion)
            else:
                inside = motion.intersection(polygon).difference(polygon.boundary.buffer(1e-7))
                expected = not inside.is_empty
            assert (breach_m[k] > TOLERANCE_M) == expected, (kind, corners, p_m[k], q_m[k])


@settings(max_examples=40, deadline=None)
@given(seed=seeds)
def test_the_airspace_is_that_of_shapely(seed: int) -> None:
    """Its points, the places clear of barriers, and the open ways."""
    rng = np.random.default_rng(seed)
    zones = [any_zone(rng, f"z{number}") for number in range(int(rng.integers(1, 5)))]
    zones = [zone for zone in zones if zone.polygon or zone.kind == "exclusion"]
    edges, r_m = barriers(zones), float(rng.uniform(0.2, 6))
    airspace = Airspace.of(edges, r_m, 5.0)
    barred = Charts.of(airspace).barred
    point_m, end_m = rng.uniform(-50, 50, (2, 60, 2))
    contained, clear = airspace.contains(point_m), clear_of(airspace, point_m, np.full(60, r_m))
    lines = shapely.linestrings(np.stack([edges.a_m, edges.b_m + 1e-300], axis=1))
    keep_m = edges.least_m(np.full(1, r_m))[0] + DELTA_M
    for k in range(60):
        inside = [
            shape(zone).contains(shapely.Point(point_m[k])) if zone.polygon
            else math.dist(zone.centre, point_m[k]) < zone.radius_m
            for zone in zones
        ]  # fmt: skip
        assert contained[k] == all(
            within == (zone.kind == "inclusion") for within, zone in zip(inside, zones, strict=True)
        )
        room_m = shapely.distance(lines, shapely.Point(point_m[k])) - keep_m
        assert clear[k] == (room_m.min(initial=np.inf) >= 0)
        way = shapely.LineString([point_m[k], end_m[k]])
        bar_m = np.minimum(keep_m, 0.9995 * (room_m + keep_m))
        is_open, _ = kernel.open_leg(barred, r_m, DELTA_M, *point_m[k].tolist(), *end_m[k].tolist())
        assert is_open == (shapely.distance(lines, way) >= bar_m - kernel.ROUNDING_M).all()


@settings(max_examples=30, deadline=None)
@given(seed=seeds, broken=st.booleans())
def test_no_part_of_a_step_breaks_a_zone(seed: int, broken: bool) -> None:
    """From any place that keeps to the zones, touching ones included; whatever the solver returned."""
    rng = np.random.default_rng(seed)
    zones = [any_zone(rng, f"z{number}") for number in range(int(rng.integers(1, 6)))]
    zones = [zone for zone in zones if zone.polygon or zone.kind == "exclusion"]
    r_m = rng.uniform(0.2, 4.0, 40)
    airspace = Airspace.of(barriers(zones), float(r_m.max()), 5.0)
    position_m = rng.uniform(-30, 30, (40, 2))
    edges = airspace.barriers
    if len(edges.a_m):
        # Some of them are at an edge's distance, to a rounding error, and some on it.
        edge = rng.integers(len(edges.a_m), size=40)
        out_m = (edges.radius_m[edge] + edges.keeps_disc[edge] * r_m) * rng.choice([1.0, 1 + 1e-15, 1.001], 40)
        on_m = edges.a_m[edge] + rng.random((40, 1)) * (edges.b_m - edges.a_m)[edge] + out_m[:, None] * edges.side[edge]
        position_m = np.where(rng.random((40, 1)) < 0.7, on_m, position_m)
    start_breach_m = np.array([_breach(zones, p_m, p_m, r) for p_m, r in zip(position_m, r_m, strict=True)])
    good = start_breach_m <= TOLERANCE_M
    position_m, r_m = position_m[good], r_m[good]
    # One UAV at a time: the zones alone are tested.
    for start_m, r in zip(position_m, r_m, strict=True):
        p_m = start_m
        for _ in range(3):
            step_m = rng.normal(0, 2.0, (1, 2))
            problem = slot_problem(p_m[None], p_m + step_m, np.array([r]), 2.5, airspace=airspace)
            if not broken:
                step_m = solve(problem, active_program(problem, np.arange(1)), Memory()).step_m
            end_m = certify(problem, step_m).waypoint_m[0]
            assert _breach(zones, p_m, end_m, r) <= TOLERANCE_M
            p_m = p_m + rng.choice([0.0, 0.3, 1.0]) * (end_m - p_m)


def _breach(zones: list[Zone], p_m: Floats, q_m: Floats, r_m: float) -> float:
    keeps = [np.full(1, r_m * zone.keeps_disc) for zone in zones]
    found = [breaches(zone, p_m[None], q_m[None], keep_m)[0] for zone, keep_m in zip(zones, keeps, strict=True)]
    return float(np.max(found, initial=-np.inf))


@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_missions_keep_to_their_zones_and_apart(seed: int) -> None:
    """A swarm with the planner edc, each UAV anywhere on its last step: shapely and the discs agree."""
    plain = complete_mission(Mission(uavs=5, area_m2=2500.0, seed=seed, r_m=3.0))
    zones = [convert(zone, Zone) for zone in random_zones(Random(seed), plain, with_ways=True)]
    mission = replace(plain, zone=zones)
    planner, rng = make_planner("edc", mission), np.random.default_rng(seed)
    position_m = np.array([(entry.start_x_m, entry.start_y_m) for entry in mission.roster])
    target_m = np.array([(entry.target_x_m, entry.target_y_m) for entry in mission.roster])
    r_m, edges = np.full(5, 3.0), airspace_of(mission).barriers
    i, j = np.triu_indices(5, 1)
    for slot in range(60):
        plan = planner.plan(PlanRequest(slot, range(5), position_m, target_m, r_m))
        end_m = np.array(plan.waypoint_m)
        for zone in zones:
            if zone.polygon:
                for k in range(5):
                    assert depth_m(zone, position_m[k], end_m[k], 3.0 * zone.keeps_disc) <= TOLERANCE_M
        if len(edges.a_m):
            away_m = segment_distance_m(position_m[:, None], end_m[:, None], edges.a_m, edges.b_m)
            assert (away_m >= edges.least_m(r_m) - TOLERANCE_M).all()
        gap_m = segment_distance_m(position_m[i], end_m[i], position_m[j], end_m[j])
        assert gap_m.min() >= 6.0 - TOLERANCE_M
        share = np.where(rng.random((5, 1)) < 0.3, rng.random((5, 1)), 1.0)
        position_m = position_m + share * (end_m - position_m)
