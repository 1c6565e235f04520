"""Inheritance of the roster: what an entry leaves out, it has from the mission."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster_entry import RosterEntry


def with_radii(mission: Mission) -> list[RosterEntry]:
    """Return the roster with the radii of the mission where an entry has none of its own."""
    return [
        msgspec.structs.replace(entry, r_m=entry.r_m or mission.r_m, body_m=entry.body_m or mission.body_m)
        for entry in mission.roster
    ]


def with_charges(roster: Sequence[RosterEntry], energies_j: Sequence[float]) -> list[RosterEntry]:
    """Return the roster with the charges (K,) of a random mission where an entry has none of its own."""
    return [
        msgspec.structs.replace(entry, energy_j=entry.energy_j or energy_j)
        for entry, energy_j in zip(roster, energies_j, strict=True)
    ]
