"""Random zones for random missions: fences, stay-out polygons and circles, and corridors, round starts and targets."""

from __future__ import annotations

import math
from itertools import pairwise
from random import Random
from typing import Any

import numpy as np
from msgspec import convert
from msgspec.structs import replace

from edc_swarm.errors import MissionError
from edc_swarm.mission.airspace import check_zones
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.passing import check_passing
from edc_swarm.mission.zone import Zone
from edc_swarm.planner.charts import Charts
from edc_swarm.planner.safe import airspace_of

ZONE_TRIES = 8
"""Draws of a zone before it is left out."""


def random_zones(rng: Random, mission: Mission, *, with_ways: bool) -> list[dict[str, Any]]:
    """Draw, in half of all missions, a fence and up to five stay-out zones with which the mission is not refused.

    If `with_ways`, the planner also knows a way from each point of every route to the next one.
    """
    if rng.random() < 0.5:
        return []
    zones: list[dict[str, Any]] = []
    for number in range(rng.randint(1, 6)):
        for _ in range(ZONE_TRIES):
            drawn = rng.choice(_SHAPES)(rng, mission) if number else _fence(rng, mission)
            more = [*zones, *({"name": f"z{number}{part}", **zone} for part, zone in zip("ab", drawn, strict=False))]
            if _flyable(mission, more, with_ways):
                zones = more
                break
    return zones


def _flyable(mission: Mission, zones: list[dict[str, Any]], with_ways: bool) -> bool:
    """Return True if the mission is not refused with the zones and, if asked, the planner knows the ways."""
    zoned = replace(mission, zone=[convert(zone, Zone) for zone in zones])
    try:
        check_zones(zoned)
        check_passing(zoned)
    except MissionError:
        return False
    charts = Charts.of(airspace_of(zoned))
    routes_m = [np.array([(entry.start_x_m, entry.start_y_m), *entry.points]) for entry in mission.roster]
    legs = [(k, one_m, next_m) for k, route_m in enumerate(routes_m) for one_m, next_m in pairwise(route_m)]
    return not with_ways or all(charts.reaches(k, mission.roster[k].r_m, one_m, next_m) for k, one_m, next_m in legs)


def _fence(rng: Random, mission: Mission) -> list[dict[str, Any]]:
    """Draw a fence: the area, a circle about it, or a polygon with a dent."""
    side_m = math.sqrt(mission.area_m2)
    far_m = side_m + rng.choice([0.1, 2.0, 20.0])
    low_m, dent_m = side_m - far_m, rng.uniform(0.0, side_m)
    kind = rng.choice(["area", "circle", "dent"])
    if kind == "circle":
        return [{"kind": "inclusion", "centre": [side_m / 2, side_m / 2], "radius_m": 0.75 * far_m}]
    corners = [[low_m, low_m], [far_m, low_m], [far_m, far_m], [low_m, far_m]]
    dent = [[side_m / 2, far_m - 0.3 * dent_m]] if kind == "dent" else []
    return [{"kind": "inclusion", "polygon": [*corners[:3], *dent, corners[3]], "keep": rng.choice(["", "", "disc"])}]


def _star(rng: Random, mission: Mission) -> list[dict[str, Any]]:
    """Draw a polygon, convex or not."""
    (x_m, y_m), count = _spot(rng, mission), rng.randint(3, 8)
    turns = sorted(rng.uniform(0, math.tau) for _ in range(count))
    if max((b - a) % math.tau for a, b in zip(turns, [*turns[1:], turns[0]], strict=True)) > 0.9 * math.pi:
        turns = [math.tau * corner / count for corner in range(count)]
    size_m = 0.4 * math.sqrt(mission.area_m2)
    corners = [
        [round(x_m + away_m * math.cos(turn), 3), round(y_m + away_m * math.sin(turn), 3)]
        for turn in turns
        for away_m in [rng.uniform(0.1, 1.0) * size_m]
    ]
    return [{"kind": "exclusion", "polygon": corners, "keep": rng.choice(["", "", "centre"])}]


def _circle(rng: Random, mission: Mission) -> list[dict[str, Any]]:
    """Draw a circle."""
    radius_m = rng.uniform(0.02, 0.3) * math.sqrt(mission.area_m2)
    return [{"kind": "exclusion", "centre": list(_spot(rng, mission)), "radius_m": round(radius_m, 3)}]


def _corridor(rng: Random, mission: Mission) -> list[dict[str, Any]]:
    """Draw two long walls, with a corridor between them that is hardly wider than a disc."""
    (x_m, y_m), turn = _spot(rng, mission), rng.uniform(0, math.tau)
    gap_m = mission.r_m + rng.choice([0.03, 0.3, 3.0])
    long_m, wide_m = 0.25 * math.sqrt(mission.area_m2), rng.choice([0.5, 10.0])
    walls = []
    for side in (1, -1):
        ends = [(-long_m, gap_m), (long_m, gap_m), (long_m, gap_m + wide_m), (-long_m, gap_m + wide_m)]
        corners = [
            [
                round(x_m + u * math.cos(turn) - side * v * math.sin(turn), 3),
                round(y_m + u * math.sin(turn) + side * v * math.cos(turn), 3),
            ]
            for u, v in ends
        ]
        walls.append({"kind": "exclusion", "polygon": corners})
    return walls


def _spot(rng: Random, mission: Mission) -> tuple[float, float]:
    side_m = math.sqrt(mission.area_m2)
    return round(rng.uniform(-0.2, 1.2) * side_m, 3), round(rng.uniform(-0.2, 1.2) * side_m, 3)


_SHAPES = (_star, _star, _circle, _corridor)
