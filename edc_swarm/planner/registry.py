"""Planners by name. This module imports no numpy before it makes a planner."""

from __future__ import annotations

import importlib

import msgspec

from edc_swarm.errors import MissionError, SwarmError
from edc_swarm.mission.braking import changes_m
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.planner.interface import Hull, Planner, PlannerFactory, PlanRequest, Stopwatch, stopped

BUILT_IN = {
    "edc": "edc_swarm.planner.edc:Edc",
    "straight": "edc_swarm.planner.straight:Straight",
    "paper": "edc_swarm.planner.paper:Paper",
    "orca": "edc_swarm.planner.orca:Orca",
    "bvc": "edc_swarm.planner.bvc:Bvc",
    "cbf": "edc_swarm.planner.cbf:Cbf",
    "priority": "edc_swarm.planner.priority:Priority",
}


def make_planner(name: str, mission: Mission, stopwatch: Stopwatch = stopped) -> Planner:
    """Return a planner for `mission`: one of `BUILT_IN`, or a user's `package.module:Class`.

    Raises
    ------
    MissionError
        There is no such planner, or its construction fails.
    SwarmError
        A planner of this package cannot be imported, which is no error of the mission.
    """
    factory, own = _factory(name), name in BUILT_IN or name.startswith("edc_swarm.")
    return factory(mission, stopwatch) if own else _guarded(name, factory, mission, stopwatch)


def check_planner(mission: Mission) -> None:
    """Raise `MissionError` unless the mission's planner is built in, or has a plan for a tiny mission."""
    if mission.planner not in BUILT_IN:
        warm_up(mission)


def warm_up(mission: Mission) -> None:
    """Import, compile or load, and run all code that planning needs, on a tiny mission.

    Afterwards the first slot of a new head takes no longer than any other.

    Raises
    ------
    MissionError
        There is no such planner, its construction fails, or it has no plan for two UAVs that pass each other.
    """
    tiny = _tiny(mission)
    planner = make_planner(mission.planner, tiny)
    position_m = [(entry.start_x_m, entry.start_y_m) for entry in tiny.roster]
    hull = Hull(2, 2 * mission.r_m, -mission.r_m, 2 * mission.r_m, mission.r_m, 0.0, mission.r_m)
    for slot in (0, 1):
        plan = planner.plan(
            PlanRequest(
                slot=slot,
                uav=[0, 1],
                position_m=position_m,
                target_m=[(entry.target_x_m, entry.target_y_m) for entry in tiny.roster],
                r_m=[entry.r_m for entry in tiny.roster],
                hulls=[hull] if slot else [],
                previous_m=position_m if tiny.lag_slots or changes_m(tiny) else None,
            )
        )
        if plan.problem:
            raise MissionError("planner", mission.planner, f"one that has a plan for two UAVs ({plan.problem})")
    if mission.planner == "edc" and mission.zone:
        from edc_swarm.planner.room import rehearse  # noqa: PLC0415  (imports numpy)

        rehearse()


def _tiny(mission: Mission) -> Mission:
    """Return the mission with two UAVs that meet, and without zones, in which they might start."""
    r_m, u_max_m = mission.r_m, mission.u_max_m
    apart_m = 2 * r_m + 0.5 * u_max_m
    ways_m = {"u001": (0.0, 4 * apart_m), "u002": (apart_m, -3 * apart_m)}
    roster = [
        RosterEntry(
            uav=uav, start_x_m=from_m, start_y_m=0, target_x_m=to_m, target_y_m=0, r_m=r_m, body_m=r_m, energy_j=1e5
        )
        for uav, (from_m, to_m) in ways_m.items()
    ]
    return msgspec.structs.replace(mission, roster=roster, uavs=len(roster), zone=[])


def _guarded(name: str, factory: PlannerFactory, mission: Mission, stopwatch: Stopwatch) -> Planner:
    from edc_swarm.planner.guarded import Guarded, described  # noqa: PLC0415  (imports numpy)

    try:
        planner = factory(mission, stopwatch)
    except Exception as error:  # noqa: BLE001  (user code may raise anything)
        why = described(error, factory.__module__)
        raise MissionError("planner", name, f"made as Class(mission, stopwatch) ({why})") from None
    if not callable(getattr(planner, "plan", None)):
        raise MissionError("planner", name, "a class with a method plan(request)")
    return Guarded(planner, mission, stopwatch)


def _factory(name: str) -> PlannerFactory:
    module_name, _, attribute = BUILT_IN.get(name, name).partition(":")
    allowed = f"one of {', '.join(BUILT_IN)}, or package.module:Class"
    if not module_name or module_name.startswith(".") or not attribute:
        raise MissionError("planner", name, allowed)
    try:
        factory: PlannerFactory = getattr(importlib.import_module(module_name), attribute)
    except Exception as error:
        why = f"{type(error).__name__}: {error}"
        if name in BUILT_IN:
            raise SwarmError(f"the planner {name} of this package cannot be imported: {why}") from error
        raise MissionError("planner", name, f"{allowed} ({why})") from None
    if not callable(factory):
        raise MissionError("planner", name, f"{allowed} ({attribute} is no class)")
    return factory
