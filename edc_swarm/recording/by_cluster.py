"""A recording of several clusters, split: what each cluster says, as a recording of its own."""

from __future__ import annotations

from dataclasses import replace

from edc_swarm.mission.clusters import cluster_names, of_cluster
from edc_swarm.mission.roles import ROLES
from edc_swarm.recording.model import Recording


def by_cluster(recording: Recording) -> dict[str, Recording]:
    """Return the recording of every cluster by name: its UAVs' messages, and those of operator and other processes.

    A mission with one cluster is that cluster's own recording.
    """
    names = cluster_names(recording.mission.roster)
    return {name: _part(recording, name) for name in names} if len(names) > 1 else {names[0]: recording}


def _part(recording: Recording, name: str) -> Recording:
    ids = {entry.uav for entry in recording.mission.roster if entry.cluster == name}
    return replace(
        recording,
        missions=[of_cluster(mission, name) for mission in recording.missions],
        fixes=[fix for fix in recording.fixes if fix.uav in ids],
        truths=[truth for truth in recording.truths if truth.uav in ids],
        commands=[command for command in recording.commands if command.head in ids or command.uav in ids],
        reports=[report for report in recording.reports if report.head in ids],
        events=[event for event in recording.events if event.source in ids or event.source in ROLES],
        goals=[goal for goal in recording.goals if goal.uav in ids],
    )
