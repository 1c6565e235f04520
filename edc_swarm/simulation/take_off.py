"""The checks of a mission before take-off, which all ways to fly it share."""

from __future__ import annotations

from edc_swarm.emulation.energy import check_batteries, stranded
from edc_swarm.foreign_text import listed
from edc_swarm.mission.airspace import check_zones
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.faults import parse_faults
from edc_swarm.mission.passing import tight_passing
from edc_swarm.mission.roster import complete_mission
from edc_swarm.planner.registry import check_planner
from edc_swarm.simulation.plug_in_trial import try_plug_ins


def ready_mission(mission: Mission) -> Mission:
    """Return the mission, completed by draws and derived values, after every check that can refuse it.

    Raises
    ------
    MissionError
        With the field, the value and what is allowed.
    """
    mission = complete_mission(mission)
    parse_faults(mission)
    check_planner(mission)
    try_plug_ins(mission)
    check_batteries(mission)
    return mission


def warnings_of(mission: Mission) -> list[str]:
    """Return what a user should know of a mission that is valid all the same, a line each."""
    needed_j = stranded(mission)
    battery_j = {entry.uav: entry.energy_j for entry in mission.roster}
    named = [f"{uav} ({battery_j[uav]:.4g} of {needed_j[uav]:.4g} J)" for uav in needed_j]
    batteries = [f"no battery for the straight flight to the target at full speed: {listed(named)}"] if named else []
    return [*batteries, *check_zones(mission), *tight_passing(mission)]
