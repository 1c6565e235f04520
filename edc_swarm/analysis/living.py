"""The UAVs that still fly at the end of a recording."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from edc_swarm.analysis.tracks import Tracks
from edc_swarm.mission.faults import Freeze, Kill, read_fault
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.messages import roster_index
from edc_swarm.recording.model import Recording

SILENT_SLOTS = 3
"""A UAV without a fix in more than this many last slots is not counted as living."""


def alive_in(tracks: Tracks, living: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return (S, K) flags of the UAVs that fly: one that does not live at the end flies until its last known slot."""
    slots = np.arange(tracks.slots)[:, None]
    newest = np.max(np.where(tracks.heard | tracks.executed, slots, -1), axis=0, initial=-1)
    alive: NDArray[np.bool_] = living | (slots <= newest)
    return alive


def living_at_end(recording: Recording, tracks: Tracks) -> NDArray[np.bool_]:
    """Return (K,) flags of the UAVs that publish, have charge and may be commanded when the recording ends.

    A UAV that lost its memory never grants again, so it holds for the rest of the mission and does not count.
    """
    index = roster_index(recording.mission.roster)
    slots = np.arange(tracks.slots)[:, None]
    newest = np.max(np.where(tracks.heard, slots, -1), axis=0, initial=-1)
    living: NDArray[np.bool_] = newest >= tracks.slots - 1 - SILENT_SLOTS
    for fix in recording.fixes:
        if not fix.voter and fix.uav in index:
            living[index[fix.uav]] = False
    for uav, slot in _stopped(recording):
        if uav in index and slot >= newest[index[uav]]:
            living[index[uav]] = False
    living &= newest >= 0
    return living


def _stopped(recording: Recording) -> list[tuple[str, int]]:
    """Return (UAV, slot) of every event that ends, or may end, a UAV's flight."""
    stopped = []
    for event in recording.events:
        if event.kind in {EventKind.BATTERY_EMPTY, EventKind.LANDED}:
            stopped.append((event.source, event.slot))
        elif event.kind == EventKind.FAULT:
            fault = read_fault(event.detail, recording.mission.dt_s)
            if isinstance(fault, (Kill, Freeze)):
                stopped.append((fault.target, event.slot))
    return stopped
