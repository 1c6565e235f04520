"""A trial of the plug-ins of a mission: each is made and used once, before anybody flies with it."""

from __future__ import annotations

from random import Random

import msgspec

from edc_swarm.agent.succession import Candidates
from edc_swarm.emulation.gps import GpsReceiver
from edc_swarm.emulation.links import LinkEmulator
from edc_swarm.errors import MissionError
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.plug_ins import CRITERIA
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.mission.vehicle_budget import gps_bound_m
from edc_swarm.protocol.messages import Fix

DRAWS = 10
"""Errors and messages of the trial."""


def try_plug_ins(mission: Mission) -> None:
    """Raise `MissionError` unless every plug-in of a mission with a roster does its part, for its first UAV."""
    entry = mission.roster[0]
    if mission.elect not in CRITERIA:
        x_m, y_m = entry.start_x_m, entry.start_y_m
        fix = Fix(uav=entry.uav, slot=0, r_m=entry.r_m, x_m=x_m, y_m=y_m, waypoint_x_m=x_m, waypoint_y_m=y_m)
        fix = msgspec.structs.replace(fix, energy_j=entry.energy_j)
        Candidates(mission).ranked([fix])
    receiver = GpsReceiver(mission.gps_model, gps_bound_m(mission, entry), mission.dt_s, "trial")
    for _ in range(DRAWS):
        receiver.next_error_m()
    chance = Random(0)
    for index, link in enumerate(mission.link):
        if link.model:
            _try_link(mission, index, chance)


def _try_link(mission: Mission, index: int, chance: Random) -> None:
    link = mission.link[index]
    ends = [
        end if end != "*" else entry.uav for end, entry in zip((link.sender, link.receiver), _two(mission), strict=True)
    ]
    emulator = LinkEmulator(mission, ends[1])
    emulator.add_rule(link)
    try:
        for _ in range(DRAWS):
            emulator.arrivals_ns(ends[0], link.start_s + chance.random() * (link.end_s - link.start_s) / 2, 500)
    except MissionError as error:
        raise MissionError(f"link[{index}].model", error.value, error.allowed) from None


def _two(mission: Mission) -> tuple[RosterEntry, RosterEntry]:
    return mission.roster[0], mission.roster[-1]
