"""Clusters: the parts of a roster that each elect a head of their own.

`of_cluster` is the mission as one cluster flies it: its own roster, hence its own quorum. A mission with one cluster
has no names of clusters in its roster.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import msgspec

from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster_entry import RosterEntry

M = TypeVar("M", bound=Mission)

CLUSTER_COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9", "#F0E442", "#7F7F7F")
"""Colours of clusters on maps, which most kinds of colour blindness tell apart; more clusters begin again."""


def cluster_names(roster: Sequence[RosterEntry]) -> list[str]:
    """Return the names of the clusters, in the order in which the roster has them; [""] for a mission with one."""
    return list(dict.fromkeys(entry.cluster for entry in roster))


def cluster_of(mission: Mission) -> dict[str, str]:
    """Return the cluster of every UAV, by id."""
    return {entry.uav: entry.cluster for entry in mission.roster}


def of_cluster(mission: M, cluster: str) -> M:
    """Return the mission as one cluster flies it; the mission itself if it has no other cluster."""
    roster = [entry for entry in mission.roster if entry.cluster == cluster]
    if len(roster) == len(mission.roster):
        return mission
    fields = {"roster": roster, "uavs": len(roster), "clusters": 1}
    if claimants := getattr(mission, "claimants", ()):
        pairs = zip(mission.roster, claimants, strict=True)
        fields["claimants"] = tuple(claimant for entry, claimant in pairs if entry.cluster == cluster)
    return msgspec.structs.replace(mission, **fields)
