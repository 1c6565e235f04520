"""Limits of the baseline planners and of local control: what they do not support is refused by name, never ignored."""

from __future__ import annotations

from edc_swarm.errors import MissionError
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.faults import SlowSolver, parse_faults
from edc_swarm.mission.vehicle_budget import vehicle_of

LOCAL_PLANNERS = ("orca", "bvc", "cbf")
"""Baselines with which a UAV can plan for itself alone."""
BASELINES = (*LOCAL_PLANNERS, "priority")
"""Planners that are published methods of others."""


def check_baselines(mission: Mission) -> None:
    """Raise `MissionError` if a mission asks a baseline planner or local control for what it does not support."""
    if mission.planner in BASELINES:
        _check_baseline(mission)
    if mission.control == "local":
        _check_local(mission)


def _check_baseline(mission: Mission) -> None:
    planner = mission.planner
    if mission.zone:
        names = ", ".join(zone.name or zone.kind for zone in mission.zone[:3])
        allowed = f'none with planner {planner}, which knows no zones (fence = "none", option --fence none)'
        raise MissionError("zone", names, allowed)
    if mission.lag_slots:
        raise MissionError("lag_slots", mission.lag_slots, f"0 with planner {planner}")
    if mission.minimise != "distance":
        raise MissionError("minimise", mission.minimise, f"distance with planner {planner}")
    if mission.responses != 1:
        raise MissionError("responses", mission.responses, f"1 with planner {planner}, which knows no best response")
    if model := _model_with_inertia(mission):
        raise MissionError("planner", planner, f"edc, straight or an own one: it plans no acceleration of {model}")


def _check_local(mission: Mission) -> None:
    if mission.planner not in LOCAL_PLANNERS and ":" not in mission.planner:
        local = f'one of {", ".join(LOCAL_PLANNERS)}, or package.module:Class (--planner), with control = "local"'
        raise MissionError("planner", mission.planner, local)
    if mission.elect != "energy":
        raise MissionError("elect", mission.elect, 'left out with control = "local", which elects nobody')
    if mission.resends:
        raise MissionError("resends", mission.resends, '0 with control = "local", which repeats no message')
    if model := _model_with_inertia(mission):
        raise MissionError("control", "local", f"head with vehicles that have inertia ({model})")
    for fault in parse_faults(mission):
        if isinstance(fault, SlowSolver):
            raise MissionError("fault", str(fault), 'a fault other than of a solver, with control = "local"')
        if getattr(fault, "target", "") in {"head", "standby"}:
            raise MissionError("fault", str(fault), 'a fault of a UAV by its id: control = "local" has no head')


def _model_with_inertia(mission: Mission) -> str:
    """Return the model of a vehicle with inertia, "" if there is none."""
    vehicles = (vehicle_of(mission, entry) for entry in mission.roster)
    return next((vehicle.model for vehicle in vehicles if not vehicle.is_ideal), "")
