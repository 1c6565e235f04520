"""G7: every living UAV is at its target within `max_slots` of the last healed fault."""

from __future__ import annotations

import math

import numpy as np

from edc_swarm.config import ARRIVED_M
from edc_swarm.faults import Fault, parse_fault
from edc_swarm.geometry import Floats, capsule_distance_m
from edc_swarm.invariants.evidence import Evidence
from edc_swarm.invariants.report import GuaranteeResult, Violation, not_applicable, verdict
from edc_swarm.recording.living import FAULT, living_at_end

_G7 = ("G7", "Progress")
LASTING = frozenset({"partition", "link", "slow", "clock"})
"""Faults that go on until they are healed; the others are over at once."""


def check_progress(evidence: Evidence) -> GuaranteeResult:
    """G7. Not held against a run without a living quorum, with a fault unhealed, or cut short."""
    tracks, mission = evidence.tracks, evidence.mission
    living = living_at_end(evidence.recording, tracks)
    if living.sum() < mission.quorum:
        return not_applicable(*_G7, f"{living.sum()} UAVs live at the end, {mission.quorum} are a quorum")
    astray = [k for k in np.flatnonzero(living).tolist() if not _excused(evidence, k, living)]
    if not astray:
        return verdict(*_G7, [])
    settled = _settled_slot(evidence)
    if settled is None:
        return not_applicable(*_G7, "a fault was never healed")
    if tracks.slots < settled + mission.max_slots:
        why = f"the record ends after {tracks.slots} slots, before {settled} + {mission.max_slots}"
        return not_applicable(*_G7, why)
    return verdict(*_G7, [_missing(evidence, k) for k in astray])


def _away_m(evidence: Evidence, k: int) -> float:
    entry = evidence.mission.roster[k]
    x_m, y_m = evidence.tracks.centre_m[-1, k].tolist()
    return math.hypot(entry.target_x_m - x_m, entry.target_y_m - y_m)


def _excused(evidence: Evidence, k: int, living: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> bool:
    """Whether UAV `k` has arrived, or its target is, or may be, covered by one that no longer flies."""
    if _away_m(evidence, k) <= ARRIVED_M:
        return True
    roster = evidence.mission.roster
    target_m = np.array([roster[k].target_x_m, roster[k].target_y_m])
    return any(
        _clearance_m(evidence, target_m, other) < roster[k].r_m + roster[other].r_m
        for other in np.flatnonzero(~living).tolist()
    )


def _clearance_m(evidence: Evidence, target_m: Floats, other: int) -> float:
    """From a point to where a UAV that no longer flies is, or can be by the last plan's hulls."""
    centre_m = float(np.hypot(*(evidence.tracks.centre_m[-1][other] - target_m)))
    plan = max(evidence.plans, key=lambda report: (report.term, report.slot), default=None)
    uav = evidence.mission.roster[other].uav
    if plan is None or uav not in plan.hull_uav:
        return centre_m
    i = plan.hull_uav.index(uav)
    ends_m = (plan.hull_ax_m[i], plan.hull_ay_m[i]), (plan.hull_bx_m[i], plan.hull_by_m[i])
    return min(centre_m, float(capsule_distance_m(target_m, *ends_m, plan.hull_r_m[i])))


def _missing(evidence: Evidence, k: int) -> Violation:
    uav, away_m = evidence.tracks.uavs[k], _away_m(evidence, k)
    slot = evidence.tracks.slots - 1
    return Violation("not-arrived", f"{uav} is {away_m:.2f} m from its target", slot, [uav], None, away_m)


def _settled_slot(evidence: Evidence) -> int | None:
    """First slot after the last fault; None when one was never healed."""
    mission = evidence.mission
    faults = [parse_fault(text, mission.dt_s) for text in mission.fault]
    healed_s = max((fault.at_s for fault in faults if fault.verb == "heal"), default=-1.0)
    ends_s = [_end_s(fault, healed_s) for fault in faults]
    ends_s += [link.end_s for link in mission.link if link.end_s < 1e9]
    if math.inf in ends_s:
        return None
    told = [event.slot + 1 for event in evidence.recording.events if event.kind == FAULT]
    return max([0, *told, *(math.ceil(end_s / mission.dt_s) for end_s in ends_s)])


def _end_s(fault: Fault, healed_s: float) -> float:
    if fault.verb not in LASTING:
        return fault.end_s if math.isfinite(fault.end_s) else fault.at_s
    if fault.verb == "partition" and healed_s >= fault.at_s:
        return min(fault.end_s, healed_s)
    return fault.end_s
