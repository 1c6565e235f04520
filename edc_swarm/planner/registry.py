"""Planners by name. Nothing heavy is imported before a planner is made."""

from __future__ import annotations

import importlib

import msgspec

from edc_swarm.config import Mission
from edc_swarm.errors import MissionError
from edc_swarm.planner.interface import Planner, PlannerFactory, PlanRequest, Stopwatch, stopped

BUILT_IN = {
    "edc": "edc_swarm.planner.edc:Edc",
    "straight": "edc_swarm.planner.straight:Straight",
    "paper": "edc_swarm.planner.paper:Paper",
}


def make_planner(name: str, mission: Mission, stopwatch: Stopwatch = stopped) -> Planner:
    """A planner for `mission`: "edc", "straight", "paper", or a user's `package.module:Class`.

    Raises
    ------
    MissionError
        There is no such planner.
    """
    return _factory(name)(mission, stopwatch)


def check_planner(name: str) -> None:
    """Raise `MissionError` unless `name` is a planner that can be imported."""
    if name not in BUILT_IN:
        _factory(name)


def warm_up(mission: Mission) -> None:
    """Import, compile or load, and run everything that planning needs, on a tiny mission of its own.

    Afterwards the first slot of a new head costs no more than any other.
    """
    tiny = msgspec.structs.replace(mission, roster=[], lag_slots=0)
    planner = make_planner(mission.planner, tiny)
    r_m, u_max_m = mission.r_m, mission.u_max_m
    apart_m = 2 * r_m + 0.5 * u_max_m
    for slot in (0, 1):
        planner.plan(
            PlanRequest(
                slot=slot,
                uav=[0, 1],
                position_m=[(0.0, 0.0), (apart_m, 0.0)],
                target_m=[(4 * apart_m, 0.0), (-3 * apart_m, 0.0)],
                r_m=[r_m, r_m],
            )
        )


def _factory(name: str) -> PlannerFactory:
    module_name, _, attribute = BUILT_IN.get(name, name).partition(":")
    allowed = f"one of {', '.join(BUILT_IN)}, or package.module:Class"
    if not module_name or module_name.startswith(".") or not attribute:
        raise MissionError("planner", name, allowed)
    try:
        factory: PlannerFactory = getattr(importlib.import_module(module_name), attribute)
    except (ImportError, AttributeError, ValueError) as error:
        raise MissionError("planner", name, f"{allowed} ({error})") from None
    return factory
