"""Causes of holds: the first cause that applies to each UAV-slot without a step, from the recording alone."""

from __future__ import annotations

from collections import Counter, defaultdict

import numpy as np
from numpy.typing import NDArray

from edc_swarm.analysis.tracks import Tracks
from edc_swarm.protocol.messages import roster_index
from edc_swarm.recording.model import Recording

CAUSES = {
    "silent": "the UAV sent no fix in the slot",
    "no-plan": "no head planned for the slot",
    "fix-missed": "the head planned, but the UAV's fix had not reached it in time",
    "not-commanded": "the head heard the UAV and sent it no command",
    "command-late": "its command was sent after the slot had begun",
    "command-missed": "its command was sent in time and not flown: it was lost, came too late, or was refused",
    "no-own-step": "the UAV plans for itself, and had no step in time",
}
"""Causes, in the order in which they are tried."""


def holds_by_cause(recording: Recording, tracks: Tracks, held: NDArray[np.bool_]) -> dict[str, int]:
    """Return how many of the UAV-slots `held` (S, K) have each cause, those that occur."""
    mission, index = recording.mission, roster_index(recording.mission.roster)
    heard = defaultdict[int, set[int]](set)
    for report in recording.reports:
        if report.has_quorum:
            heard[report.slot + 1].update(index[uav] for uav in report.heard if uav in index)
    sent_ns = defaultdict[tuple[int, int], list[int]](list)
    for command in (command for command in recording.commands if command.uav in index):
        sent_ns[command.slot, index[command.uav]].append(command.sent_ns)
    counts = Counter[str]()
    for slot, k in zip(*(axis.tolist() for axis in np.nonzero(held)), strict=True):
        begun_ns = mission.epoch_ns + slot * mission.slot_ns
        if not tracks.heard[slot, k]:
            counts["silent"] += 1
        elif (slot, k) in sent_ns:
            counts["command-missed" if min(sent_ns[slot, k]) < begun_ns else "command-late"] += 1
        elif mission.control == "local":
            counts["no-own-step"] += 1
        elif slot not in heard:
            counts["no-plan"] += 1
        else:
            counts["not-commanded" if k in heard[slot] else "fix-missed"] += 1
    return {cause: counts[cause] for cause in CAUSES if counts[cause]}
