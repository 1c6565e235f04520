"""Who still flies at the end of a recording."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from edc_swarm.analysis.tracks import Tracks
from edc_swarm.mission.faults import Freeze, Kill, read_fault
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.messages import roster_index
from edc_swarm.recording.model import Recording

SILENT_SLOTS = 3
"""A UAV without a fix for more slots than this, at the end, is not counted as living."""


def alive_in(tracks: Tracks, living: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(S, K) whether each UAV flies in each slot: who does not live at the end, to the last slot it is known from."""
    slots = np.arange(tracks.slots)[:, None]
    newest = np.max(np.where(tracks.heard | tracks.executed, slots, -1), axis=0, initial=-1)
    alive: NDArray[np.bool_] = living | (slots <= newest)
    return alive


def living_at_end(recording: Recording, tracks: Tracks) -> NDArray[np.bool_]:
    """(K,) whether each UAV still answers, has charge and may still be commanded when the record ends.

    A UAV that lost its memory never grants again and so stays where it is: an obstacle.
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
    """UAV and slot of every event that ends, or may end, a UAV's flight."""
    stopped = []
    for event in recording.events:
        if event.kind == EventKind.BATTERY_EMPTY:
            stopped.append((event.source, event.slot))
        elif event.kind == EventKind.FAULT:
            fault = read_fault(event.detail, recording.mission.dt_s)
            if isinstance(fault, (Kill, Freeze)):
                stopped.append((fault.target, event.slot))
    return stopped
