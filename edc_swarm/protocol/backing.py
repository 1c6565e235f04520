"""Backing of reports: whether a quorum of the head's own cluster is behind a plan or a claim."""

from __future__ import annotations

from edc_swarm.mission.clusters import cluster_names, of_cluster
from edc_swarm.mission.configuration import Mission
from edc_swarm.protocol.messages import Report


class Backing:
    """The UAVs and the quorum of every UAV's cluster."""

    def __init__(self, mission: Mission) -> None:
        self._of: dict[str, tuple[frozenset[str], int]] = {}
        for name in cluster_names(mission.roster):
            part = of_cluster(mission, name)
            ids = frozenset(entry.uav for entry in part.roster)
            self._of |= dict.fromkeys(ids, (ids, part.quorum))

    def backs(self, report: Report) -> bool:
        """Return True if the UAVs that grant it, with the head, are a quorum of the head's cluster."""
        ids, quorum = self._of.get(report.head, (frozenset[str](), report.quorum))
        return report.is_backed(ids, quorum)

    def is_plan(self, report: Report) -> bool:
        """Return True for a report of a plan, with a quorum of the head's cluster behind it."""
        return report.has_quorum and self.backs(report)
