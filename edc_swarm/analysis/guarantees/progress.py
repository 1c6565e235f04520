"""G7: every living UAV is at its target within a limit after the last fault.

`edc_swarm.mission.prospect` defines the limit, and the UAVs for which G7 promises progress after a fault without an
end. A mission that stopped because nothing could change any more (`prospect.STALLED`) is judged at that slot, since
more slots would change nothing.

A living UAV is excused, and named in the notes, if a UAV that no longer flies keeps it away: this one covers its
target, or its hull in the last plan does; or its hull contains the place of the living UAV, which then must hold
(ARCHITECTURE.md, near a hull). An empty battery is neither an excuse nor a violation: if a battery is empty within
the limit, the verdict is "not judged". Else a swarm that hovers until all batteries are empty would pass.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from edc_swarm.analysis.guarantees.evidence import Evidence
from edc_swarm.analysis.guarantees.verdict import GuaranteeResult, Violation, not_applicable, not_judged, verdict
from edc_swarm.analysis.living import living_at_end
from edc_swarm.geometry import Floats, capsule_distance_m
from edc_swarm.mission.configuration import ARRIVED_M, OPERATOR
from edc_swarm.mission.faults import Fault, parse_faults, read_fault
from edc_swarm.mission.prospect import STALLED, default_max_slots, prospect_of, settled_slot
from edc_swarm.protocol.events import EventKind

_G7 = ("G7", "Progress")


def check_progress(evidence: Evidence) -> GuaranteeResult:
    """Return the verdict on G7: not applicable without a living quorum, or after a fault that forbids any promise."""
    tracks, mission = evidence.tracks, evidence.mission
    if not tracks.heard.any():
        return not_judged(*_G7, "the record has no fixes")
    faults = _faults(evidence)
    prospect = prospect_of(mission, [fault for fault in faults if fault.at_s < tracks.slots * mission.dt_s])
    inside = np.array([uav in prospect.side for uav in tracks.uavs])
    drained, living = _drained(evidence), living_at_end(evidence.recording, tracks)
    bound = inside & living
    due = bound | (inside & (drained >= 0))
    if due.sum() < mission.quorum:
        where = "" if inside.all() else " on the larger side of a partition that never heals"
        return not_applicable(*_G7, f"{due.sum()} UAVs live at the end{where}, {mission.quorum} are a quorum")
    excuses = {k: _excuse(evidence, k, bound) for k in _away(evidence, due)}
    excuses |= dict.fromkeys(
        _away(evidence, living & ~inside), "a partition that never heals cuts it off from the quorum"
    )
    notes = [f"{tracks.uavs[k]} need not arrive: {why}" for k, why in excuses.items() if why]
    astray = [k for k, why in excuses.items() if not why]
    if astray and prospect.obstacle:
        return not_applicable(*_G7, prospect.obstacle)
    needed = _settled_slot(evidence, faults) + prospect.limit_slots
    lasting = due & ((drained < 0) | (drained >= needed))
    missing = [k for k in astray if lasting[k]] if lasting.sum() >= mission.quorum else []
    if missing and tracks.slots < needed and not _stalled(evidence):
        return not_judged(*_G7, f"stopped after {tracks.slots} slots{_given(evidence)}, before slot {needed}", notes)
    if astray and not missing:
        names = ", ".join(tracks.uavs[k] for k in np.flatnonzero(due & ~lasting).tolist())
        return not_judged(*_G7, f"empty batteries before slot {needed}: {names}", notes)
    return verdict(*_G7, [_missing(evidence, k) for k in missing], notes)


def _drained(evidence: Evidence) -> NDArray[np.int64]:
    """Return (K,) slots in which the battery of each UAV that can be commanded became empty, -1 for never."""
    slots = np.full(len(evidence.tracks.uavs), -1)
    forgetful = {fix.uav for fix in evidence.recording.fixes if not fix.voter}
    for event in evidence.recording.events:
        if event.kind == EventKind.BATTERY_EMPTY and event.source in evidence.index.keys() - forgetful:
            slots[evidence.index[event.source]] = event.slot
    return slots


def _away(evidence: Evidence, among: NDArray[np.bool_]) -> list[int]:
    return [k for k in np.flatnonzero(among).tolist() if _away_m(evidence, k) > ARRIVED_M]


def _away_m(evidence: Evidence, k: int) -> float:
    entry = evidence.mission.roster[k]
    x_m, y_m = evidence.tracks.centre_m[-1, k].tolist()
    return math.hypot(entry.target_x_m - x_m, entry.target_y_m - y_m)


def _excuse(evidence: Evidence, k: int, bound: NDArray[np.bool_]) -> str:
    """Return the reason why UAV `k` need not arrive, with the UAVs that keep it away; "" if it must arrive."""
    uavs, roster = evidence.tracks.uavs, evidence.mission.roster
    target_m, centre_m = np.array([roster[k].target_x_m, roster[k].target_y_m]), evidence.tracks.centre_m[-1, k]
    covering, holding = [], []
    for other in np.flatnonzero(~bound & (np.arange(len(uavs)) != k)).tolist():
        if _clearance_m(evidence, target_m, other) < roster[k].r_m + roster[other].r_m:
            covering.append(uavs[other])
        if _clearance_m(evidence, centre_m, other) <= 0:
            holding.append(uavs[other])
    if covering:
        return f"its target is, or may be, covered by {' and '.join(covering)}, which no longer flies"
    if holding:
        return f"it must hold, since {' and '.join(holding)}, which no longer flies, may be where it is"
    return ""


def _clearance_m(evidence: Evidence, point_m: Floats, other: int) -> float:
    """Return the distance from a point to the disc, or the hull in the last plan, of a UAV that no longer flies."""
    centre_m = float(np.hypot(*(evidence.tracks.centre_m[-1][other] - point_m)))
    plan = max(evidence.plans, key=lambda report: (report.term, report.slot), default=None)
    uav = evidence.mission.roster[other].uav
    if plan is None or uav not in plan.hull_uav:
        return centre_m
    i = plan.hull_uav.index(uav)
    ends_m = (plan.hull_ax_m[i], plan.hull_ay_m[i]), (plan.hull_bx_m[i], plan.hull_by_m[i])
    return min(centre_m, float(capsule_distance_m(point_m, *ends_m, plan.hull_r_m[i])))


def _missing(evidence: Evidence, k: int) -> Violation:
    uav, away_m = evidence.tracks.uavs[k], _away_m(evidence, k)
    slot = evidence.tracks.slots - 1
    return Violation("not-arrived", f"{uav} is {away_m:.2f} m from its target", slot, [uav], None, away_m)


def _faults(evidence: Evidence) -> list[Fault]:
    """Return the faults by time: as the events report them, and the planned ones that no event reports."""
    mission, events = evidence.mission, evidence.recording.events
    told = [
        read_fault(event.detail, mission.dt_s)
        for event in events
        if event.kind == EventKind.FAULT and event.source == OPERATOR
    ]
    done = [fault for fault in told if fault is not None]
    accounted = {fault.without_names() for fault in done}
    aimless = {
        event.detail for event in events if event.kind == EventKind.FAULT_WITHOUT_TARGET and event.source == OPERATOR
    }
    planned = [f for f in parse_faults(mission) if f.without_names() not in accounted and str(f) not in aimless]
    return sorted([*done, *planned], key=lambda fault: fault.at_s)


def _settled_slot(evidence: Evidence, faults: list[Fault]) -> int:
    """Return the first slot after the last fault, which may have been carried out later than planned."""
    reported = [event.slot + 1 for event in evidence.recording.events if event.kind == EventKind.FAULT]
    return max([settled_slot(evidence.mission, faults), *reported])


def _stalled(evidence: Evidence) -> bool:
    """Return True if the operator stopped the mission because nothing could change any more."""
    events = evidence.recording.events
    return any(event.kind == EventKind.END and event.source == OPERATOR and event.detail == STALLED for event in events)


def _given(evidence: Evidence) -> str:
    """Return a remark if the user gave a `max_slots` below the default, else ""."""
    mission = evidence.mission
    return f" (max_slots = {mission.max_slots} was given)" if mission.max_slots < default_max_slots(mission) else ""
