"""Variety of the fuzzer's missions: speeds of the UAVs' own, routes, and new goals in flight.

Each draws from a generator of its own, so that a mission without them is the same as ever.
"""

from __future__ import annotations

import math
from random import Random
from typing import Any

import msgspec

from edc_swarm.mission.airspace import zones_refusal
from edc_swarm.mission.configuration import Mission


def varied_roster(rng: Random, mission: Mission) -> list[dict[str, Any]]:
    """Draw the roster of half of the missions, with speeds of the UAVs' own or routes; empty for the other missions."""
    kind = rng.choice(["plain", "plain", "plain", "speeds", "routes", "both"])
    if kind == "plain":
        return []
    roster: list[dict[str, Any]] = msgspec.to_builtins(mission.roster)
    if kind != "routes":
        roster = [{**entry, "v_max_mps": rng.choice([0.0, 2.0, 8.0, 15.0])} for entry in roster]
    return roster if kind == "speeds" else [{**entry, **_route(rng, mission, entry)} for entry in roster]


def _route(rng: Random, mission: Mission, entry: dict[str, Any]) -> dict[str, Any]:
    """Draw a route of up to three points before the target, the first near the start, with times to hover at some."""
    side_m = math.sqrt(mission.area_m2)
    between = [[rng.uniform(0, side_m), rng.uniform(0, side_m)] for _ in range(rng.randint(0, 3))]
    if between:
        between[0] = [entry["start_x_m"] + rng.uniform(-4, 4), entry["start_y_m"] + rng.uniform(-4, 4)]
    hover_s = [rng.choice([0.0, 0.0, 0.3, 2.0]) for _ in between] + [0.0]
    route = [*between, [entry["target_x_m"], entry["target_y_m"]]]
    return {"route": route, "hover_s": hover_s, "accept_m": rng.choice([0.5, 1.0, 5.0])}


def new_goals(rng: Random, mission: Mission, last_slot: int) -> list[str]:
    """Draw, in every fourth mission, new goals for up to three UAVs, clear of all targets and allowed by the zones."""
    if rng.random() > 1 / 4:
        return []
    side_m, taken = math.sqrt(mission.area_m2), [(entry.target_x_m, entry.target_y_m) for entry in mission.roster]
    goals: list[str] = []
    for entry in rng.sample(mission.roster, min(3, len(mission.roster))):
        points = [(round(rng.uniform(0, side_m), 3), round(rng.uniform(0, side_m), 3)) for _ in range(2)]
        allowed = not zones_refusal(mission.zone, entry.r_m, [(entry.start_x_m, entry.start_y_m), *points])
        if allowed and all(math.dist(points[-1], other) > 2.1 * mission.r_m for other in taken):
            taken.append(points[-1])
            at_s = rng.randint(1, last_slot) * mission.dt_s + rng.random() * mission.dt_s
            goals.append(f"goal {entry.uav} {' '.join(f'{x},{y}' for x, y in points)} @{at_s:.3f}s")
    return goals
