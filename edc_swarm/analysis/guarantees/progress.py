"""G7: every living UAV is at its target within a limit after the last fault.

`edc_swarm.mission.prospect` defines the limit, and the UAVs for which G7 promises progress after a fault without an
end. A mission that stopped because nothing could change any more (`prospect.STALLED`) is judged at that slot, since
more slots would change nothing.

Excused, and named in the notes, is whoever a UAV that no longer flies keeps away: it covers the target or, by the
last plan's hulls, may cover it; or no step leads away from where it may be; or there is no way round it (the rule:
`edc_swarm.protocol.hindrance`). An empty battery is no excuse but no proof either: it counts as "not judged" if it was
empty within the limit, since a swarm that does nothing until all batteries are empty must not pass for one that had no
time.
"""

from __future__ import annotations

import math
from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from edc_swarm.analysis.guarantees.evidence import Evidence
from edc_swarm.analysis.guarantees.verdict import GuaranteeResult, Violation, not_applicable, not_judged, verdict
from edc_swarm.analysis.living import living_at_end
from edc_swarm.mission.configuration import ARRIVED_M, OPERATOR
from edc_swarm.mission.faults import Fault, parse_faults, read_fault
from edc_swarm.mission.prospect import STALLED, default_max_slots, prospect_of, settled_slot
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.hindrance import Hindrance, hindrances, places_of, point

PROGRESS = "G7"
_G7 = (PROGRESS, "Progress")


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
    excuses = _excuses(evidence, _away(evidence, due), bound)
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


def _excuses(evidence: Evidence, away: list[int], bound: NDArray[np.bool_]) -> dict[int, str]:
    """Why each UAV of `away` need not arrive: where the UAVs that no longer fly are, or may be. "" if it must."""
    roster, centre_m = evidence.mission.roster, evidence.tracks.centre_m[-1]
    plan = max(evidence.plans, key=lambda report: (report.term, report.slot), default=None)
    places = [
        place for k in np.flatnonzero(~bound).tolist() for place in places_of(roster[k], point(centre_m[k]), plan)
    ]
    found = hindrances([(roster[k], point(centre_m[k])) for k in away], places)
    living = {roster[k].uav for k in np.flatnonzero(bound).tolist()}
    return {k: _excuse(found[roster[k].uav], living) if roster[k].uav in found else "" for k in away}


def _excuse(found: Hindrance, living: Collection[str]) -> str:
    gone = all(uav not in living for uav in found.uavs)
    verb = "flies" if len(found.uavs) == 1 else "fly"
    who = f"{' and '.join(found.uavs)}, which {f'no longer {verb}' if gone else 'can no longer move'}"
    match found.kind:
        case "covered":
            return f"its target is, or may be, covered by {who}"
        case "held":
            return f"it must hold, since no step leads away from {who}"
        case "closed in":
            return f"there is no way to its target round {who}"


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
