"""Heads of a recording by cluster and term, what fail-overs took, and the figures of each cluster."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from edc_swarm.mission.clusters import cluster_names, cluster_of
from edc_swarm.protocol.backing import Backing
from edc_swarm.recording.model import Recording


class HeadTerm(Struct, frozen=True):
    """The head of a term, with the first and the last slot whose fixes it planned with."""

    term: int
    head: str
    first_slot: int
    last_slot: int


class ClusterFigures(Struct, frozen=True):
    """The figures of one cluster. None: unknown.

    `arrived` UAVs are at their targets at the end; `path_m` and `straight_m` are sums over its UAVs; `messages` counts
    what its UAVs published.
    """

    name: str
    uavs: int
    arrived: int | None
    path_m: float | None
    straight_m: float | None
    heads: list[HeadTerm]
    failover_slots: list[int] | None
    messages: int


def heads_of(recording: Recording) -> dict[str, list[HeadTerm]]:
    """Return, by cluster, the heads that planned, by term; a plan without a quorum of grants does not count."""
    backing, cluster = Backing(recording.mission), cluster_of(recording.mission)
    slots: dict[tuple[str, int, str], list[int]] = {}
    for report in recording.reports:
        if backing.is_plan(report):
            slots.setdefault((cluster[report.head], report.term, report.head), []).append(report.slot)
    heads: dict[str, list[HeadTerm]] = {name: [] for name in cluster_names(recording.mission.roster)}
    for (name, term, head), led in sorted(slots.items()):
        heads[name].append(HeadTerm(term, head, min(led), max(led)))
    return heads


def failover_slots(heads: Mapping[str, Sequence[HeadTerm]]) -> list[int]:
    """Return the slots without a plan between the heads of each cluster, one cluster after another."""
    return [max(0, new.first_slot - old.last_slot - 1) for terms in heads.values() for old, new in pairwise(terms)]


def cluster_figures(
    recording: Recording,
    heads: Mapping[str, list[HeadTerm]],
    home: NDArray[np.bool_],
    path_m: NDArray[np.float64],
    straight_m: NDArray[np.float64],
    *,
    fixes_known: bool,
    reports_known: bool,
) -> list[ClusterFigures]:
    """Return the figures of each cluster; none for a mission with one."""
    roster = recording.mission.roster
    if len(heads) < 2:
        return []
    cluster, counts = cluster_of(recording.mission), dict.fromkeys(heads, 0)
    senders = [fix.uav for fix in recording.fixes] + [truth.uav for truth in recording.truths]
    senders += [command.head for command in recording.commands] + [report.head for report in recording.reports]
    for sender in senders:
        if sender in cluster:
            counts[cluster[sender]] += 1
    figures = []
    for name, terms in heads.items():
        own = np.array([entry.cluster == name for entry in roster])
        figures.append(
            ClusterFigures(
                name,
                int(own.sum()),
                int(home[own].sum()) if fixes_known else None,
                float(path_m[own].sum()) if fixes_known else None,
                float(straight_m[own].sum()) if fixes_known else None,
                terms,
                failover_slots({name: terms}) if reports_known else None,
                counts[name],
            )
        )
    return figures
