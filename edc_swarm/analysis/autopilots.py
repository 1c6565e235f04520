"""UAVs of autopilots in a recording: which of them stray, and which slots of their flights nobody has reported.

A stray has no disc any more: others keep clear of its hull, a disc about its last reported position. Nothing but its
own word lands it. Only its body is judged from then on, as far as its autopilot reports.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from msgspec import UNSET
from numpy.typing import NDArray

from edc_swarm.analysis.true_paths import parts_of, tells_path
from edc_swarm.mission.autopilots import autopilots
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.messages import Fix
from edc_swarm.recording.model import Recording

Bools = NDArray[np.bool_]
TOLD_AFTER = 2
"""Slots after which an autopilot has reported a slot: its report of the slot's end comes after the next one begins."""


def strays_of(recording: Recording) -> frozenset[str]:
    """Return the UAVs whose vehicles did not follow their commands in the end: the failsafe says nothing of them."""
    return frozenset(fix.uav for fix in recording.fixes if fix.stray_m is not UNSET)


def stray_slots(fixes: Sequence[Fix], index: Mapping[str, int], shape: tuple[int, int]) -> tuple[Bools, Bools]:
    """Return (S, K) slots in which a UAV strays, and those in which a stray is on the ground."""
    astray, down = np.zeros(shape, bool), np.zeros(shape, bool)
    for fix in fixes:
        if fix.stray_m is not UNSET:
            astray[fix.slot :, index[fix.uav]] = True
            if fix.on_ground is True:
                down[fix.slot :, index[fix.uav]] = True
    return astray, down


def strayed_by(recording: Recording, uav: str, slot: int) -> str:
    """Return why a UAV strayed, if it did by the end of the slot after `slot`; else ""."""
    for event in recording.events:
        if event.kind == EventKind.STRAYED and event.source == uav and event.slot <= slot + 1:
            return event.detail
    return ""


def never_flew(recording: Recording) -> frozenset[str]:
    """Return the UAVs whose vehicles stayed on the ground, as they said."""
    return frozenset(event.source for event in recording.events if event.kind == EventKind.GROUNDED)


def unreported(recording: Recording) -> dict[str, int]:
    """Return, by UAV, in how many slots an autopilot in the air has reported too little for a truth."""
    flown = autopilots(recording.mission).keys() - never_flew(recording)
    if not flown:
        return {}
    parts = parts_of(recording.mission)
    told: dict[str, set[int]] = {uav: set() for uav in flown}
    last = dict.fromkeys(flown, -1)
    for truth in recording.truths:
        if truth.uav in told and tells_path(truth, parts):
            told[truth.uav].add(truth.slot)
    for fix in recording.fixes:
        if fix.uav in last and fix.on_ground is not True:
            last[fix.uav] = max(last[fix.uav], fix.slot)
    untold = {uav: sum(slot not in told[uav] for slot in range(last[uav] + 1 - TOLD_AFTER)) for uav in sorted(flown)}
    return {uav: count for uav, count in untold.items() if count}
