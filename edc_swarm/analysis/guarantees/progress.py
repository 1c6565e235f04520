"""G7: every living UAV is at its target within a limit after the last fault, and after the last new goal.

In a lifelong mission a UAV has always another goal: there, within each limit after the last fault, every living UAV
reaches one. A new goal begins where its UAV was, and its way counts from there.

`edc_swarm.mission.prospect` defines the limit, and the UAVs for which G7 promises progress after a fault without an
end. A mission that stopped because nothing could change any more (`prospect.STALLED`) is judged at that slot, since
more slots would change nothing.

Excused, and named in the notes, is whoever a UAV that no longer flies keeps away: it covers the target or, by the
last plan's hulls, may cover it; or no step leads away from where it may be; or there is no way round it (the rule:
`edc_swarm.protocol.hindrance`). An empty battery is no excuse but no proof either: it counts as "not judged" if it was
empty within the limit, since a swarm that does nothing until all batteries are empty must not pass for one that had no
time.

New goals may send two UAVs to places where their discs overlap. Whoever is not there need not arrive if the other one
is. If none of them is there, G7 is not judged, except for UAVs elsewhere in a mission without zones, where nobody is
closed in.

With the failsafe a UAV that no longer flies keeps nobody away once it has left the airspace. A UAV that has landed need
not arrive, if the operator ordered it to land, or a fault can be the cause: its last accepted step is before the last
fault was over, or links lose messages for good. Any other landing is a swarm's failure to command a UAV that it could
hear: it breaks G7, and is no excuse for others.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import combinations, pairwise

import msgspec
import numpy as np
from numpy.typing import NDArray

from edc_swarm.analysis.guarantees.evidence import Evidence
from edc_swarm.analysis.guarantees.verdict import GuaranteeResult, Violation, not_applicable, not_judged, verdict
from edc_swarm.analysis.landing import landings
from edc_swarm.analysis.living import living_at_end
from edc_swarm.analysis.voyages import Voyages, forgotten, voyages_of
from edc_swarm.emulation.energy import step_energy_j
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.faults import Fault, OrderLanding, parse_faults, read_fault
from edc_swarm.mission.prospect import STALLED, Prospect, default_max_slots, prospect_of, settled_slot
from edc_swarm.mission.roles import OPERATOR
from edc_swarm.mission.roster_entry import ARRIVED_M, RosterEntry
from edc_swarm.mission.routes import Course
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.hindrance import Hindrance, Place, Point, hindrances, places_of, point
from edc_swarm.protocol.messages import Fix

PROGRESS = "G7"
_G7 = (PROGRESS, "Progress")


def check_progress(evidence: Evidence) -> GuaranteeResult:
    """Return the verdict on G7: not applicable without a living quorum, or after a fault that forbids any promise."""
    tracks, mission = evidence.tracks, evidence.mission
    if not tracks.heard.any():
        return not_judged(*_G7, "the record has no fixes")
    if astray := [_forgotten(fix, course) for fix, course in forgotten(evidence.recording)]:
        return verdict(*_G7, astray)
    faults, voyages = _faults(evidence), voyages_of(evidence.recording, tracks)
    prospect = prospect_of(_as_flown(mission, voyages), [f for f in faults if f.at_s < tracks.slots * mission.dt_s])
    inside = np.array([uav in prospect.side for uav in tracks.uavs])
    drained, living = _drained(evidence), living_at_end(evidence.recording, tracks)
    bound = inside & living
    settled = _settled_slot(evidence, faults)
    ordered = [fault.target for fault in faults if isinstance(fault, OrderLanding)]
    unasked = inside & _landed_unasked(evidence, settled, prospect) & ~np.isin(tracks.uavs, ordered)
    due = bound | unasked | (inside & (drained >= 0))
    if due.sum() < mission.quorum:
        where = "" if inside.all() else " on the larger side of a partition that never heals"
        return not_applicable(*_G7, f"{due.sum()} UAVs live at the end{where}, {mission.quorum} are a quorum")
    if mission.goals == "lifelong":
        return _lifelong(evidence, voyages, prospect, settled, bound)
    excuses = _excuses(evidence, voyages, away_of(evidence, voyages, due), bound)
    excuses |= dict.fromkeys(
        away_of(evidence, voyages, living & ~inside), "a partition that never heals cuts it off from the quorum"
    )
    excuses |= _landed_by_fault(evidence, away_of(evidence, voyages, ~due & ~living))
    begun = max((voyage.since_slot for voyage in voyages.each), default=0)
    lasting = due & ((drained < 0) | (drained >= max(settled, begun) + prospect.limit_slots))
    if (final := away_of(evidence, voyages, unasked)) and not prospect.obstacle:
        # A UAV that has landed never flies again, so no later slot can mend it.
        return verdict(*_G7, [_missing(evidence, voyages, k) for k in final])
    return _judged(evidence, voyages, prospect, max(settled, begun), excuses, due, lasting)


def _judged(
    evidence: Evidence,
    voyages: Voyages,
    prospect: Prospect,
    settled: int,
    excuses: Mapping[int, str],
    due: NDArray[np.bool_],
    lasting: NDArray[np.bool_],
) -> GuaranteeResult:
    """Return the verdict on the UAVs that are away: `excuses` has why each need not arrive, "" if it must."""
    tracks, needed = evidence.tracks, settled + prospect.limit_slots
    notes = [f"{tracks.uavs[k]} need not arrive: {why}" for k, why in excuses.items() if why]
    astray = [k for k, why in excuses.items() if not why]
    if astray and prospect.obstacle:
        return not_applicable(*_G7, prospect.obstacle)
    missing = [k for k in astray if lasting[k]] if lasting.sum() >= evidence.mission.quorum else []
    rivals = _rivals(voyages, due)
    beaten = {k: home for k in missing if (home := [i for i in rivals.get(k, []) if i not in astray])}
    notes += [_beside(tracks.uavs, k, home) for k, home in beaten.items()]
    missing = [k for k in missing if k not in beaten]
    contested = [k for k in missing if k in rivals]
    if contested and (contested == missing or evidence.mission.zone):
        names = " and ".join(tracks.uavs[k] for k in sorted([rivals[contested[0]][0], contested[0]]))
        return not_judged(*_G7, f"the discs of {names} overlap at their targets, and none of them is there", notes)
    missing = [k for k in missing if k not in rivals]
    if missing and tracks.slots < needed and not _stalled(evidence):
        return not_judged(*_G7, f"stopped after {tracks.slots} slots{_given(evidence)}, before slot {needed}", notes)
    if set(astray) - set(beaten) and not missing:
        names = ", ".join(tracks.uavs[k] for k in np.flatnonzero(due & ~lasting).tolist())
        return not_judged(*_G7, f"empty batteries before slot {needed}: {names}", notes)
    return verdict(*_G7, [_missing(evidence, voyages, k) for k in missing], notes)


def _rivals(voyages: Voyages, due: NDArray[np.bool_]) -> dict[int, list[int]]:
    """Return the UAVs that new goals send to places where their discs overlap, each with its rivals."""
    each, rivals = {k: voyages.each[k] for k in np.flatnonzero(due).tolist()}, dict[int, list[int]]()
    if not any(voyage.course.goal for voyage in each.values()):
        return rivals
    for i, j in combinations(each, 2):
        if math.dist(each[i].left[-1], each[j].left[-1]) < each[i].entry.r_m + each[j].entry.r_m:
            rivals.setdefault(i, []).append(j)
            rivals.setdefault(j, []).append(i)
    return rivals


def _beside(uavs: Sequence[str], k: int, home: list[int]) -> str:
    there = " and ".join(uavs[i] for i in home)
    return f"{uavs[k]} need not arrive: its disc would overlap that of {there} there, which has arrived"


def _forgotten(fix: Fix, course: Course) -> Violation:
    """Return the violation of a UAV whose goal, or place in it, went back."""
    text = (
        f"{fix.uav} is at point {fix.course.leg} of goal {fix.course.goal}, after point {course.leg} of {course.goal}"
    )
    return Violation("course-forgotten", text, fix.slot, [fix.uav])


def _as_flown(mission: Mission, voyages: Voyages) -> Mission:
    """Return the mission with the newest goal of each UAV as its route, from where the UAV began it."""
    if mission.goals == "lifelong":
        return mission
    return msgspec.structs.replace(mission, roster=[voyage.now for voyage in voyages.each])


def _lifelong(
    evidence: Evidence, voyages: Voyages, prospect: Prospect, settled: int, bound: NDArray[np.bool_]
) -> GuaranteeResult:
    """Return the verdict on a lifelong mission: every UAV reaches a goal within each limit after the last fault."""
    if prospect.obstacle:
        return not_applicable(*_G7, prospect.obstacle)
    tracks, limit = evidence.tracks, prospect.limit_slots
    standing: list[int] = np.flatnonzero(bound).tolist()
    excuses = _excuses(evidence, voyages, standing, bound)
    notes = [f"{tracks.uavs[k]} need not arrive: {why}" for k, why in excuses.items() if why]
    idle, waiting = [], False
    for k in (k for k in standing if not excuses[k]):
        slots = [settled, *(slot for slot in voyages.each[k].reached_slots if slot > settled), tracks.slots]
        idle += [(k, begin) for begin, end in pairwise(slots) if end - begin > limit]
        waiting |= len(slots) == 2
    if not idle and waiting and tracks.slots < settled + limit:
        return not_judged(*_G7, f"stopped after {tracks.slots} slots, before slot {settled + limit}", notes)
    return verdict(*_G7, [_idle(evidence, k, begin, limit) for k, begin in idle], notes)


def _idle(evidence: Evidence, k: int, begin: int, limit: int) -> Violation:
    uav = evidence.tracks.uavs[k]
    return Violation("no-goal", f"{uav} reaches no goal in the {limit} slots from slot {begin}", begin, [uav])


def _landed_unasked(evidence: Evidence, settled_slot: int, prospect: Prospect) -> NDArray[np.bool_]:
    """Return (K,) flags of the UAVs that say that they have landed although no fault kept commands from them."""
    found = landings(evidence.recording, evidence.tracks)
    # Without a fault, a UAV that has never stepped counts too.
    first_slot = settled_slot or -math.inf
    unasked = [landing.uav for landing in found if landing.told and landing.stepped_slot >= first_slot]
    return np.isin(evidence.tracks.uavs, [] if prospect.lossy else unasked)


def _landed_by_fault(evidence: Evidence, away: list[int]) -> dict[int, str]:
    """Return why each UAV of `away` that said that it landed need not arrive: a fault or a link can be the cause."""
    slots = {found.uav: found.slot for found in landings(evidence.recording, evidence.tracks) if found.told}
    uavs = evidence.tracks.uavs
    return {
        k: f"it landed in slot {slots[uavs[k]]}, which a fault or a lossy link can cause"
        for k in away
        if uavs[k] in slots
    }


def _drained(evidence: Evidence) -> NDArray[np.int64]:
    """Return (K,) slots in which the battery of each UAV that can be commanded became empty, -1 for never.

    A UAV also counts that has landed since its battery did not cover a step.
    """
    steps_j = [step_energy_j(evidence.mission, step_m) for step_m in evidence.mission.steps_m]
    least_j = np.fmin.reduce(evidence.tracks.energy_j, axis=0, initial=np.inf)
    slots = np.full(len(evidence.tracks.uavs), -1)
    forgetful = {fix.uav for fix in evidence.recording.fixes if not fix.voter}
    for event in evidence.recording.events:
        if event.source not in evidence.index.keys() - forgetful:
            continue
        k = evidence.index[event.source]
        if event.kind == EventKind.BATTERY_EMPTY or (event.kind == EventKind.LANDED and least_j[k] < steps_j[k]):
            slots[k] = event.slot
    return slots


def away_of(evidence: Evidence, voyages: Voyages, among: NDArray[np.bool_]) -> list[int]:
    """Return which UAVs of `among` are away from their targets at the end."""
    return [
        k for k in np.flatnonzero(among).tolist() if voyages.pending[-1, k] or _away_m(evidence, voyages, k) > ARRIVED_M
    ]


def _away_m(evidence: Evidence, voyages: Voyages, k: int) -> float:
    return math.dist(voyages.each[k].left[-1], point(evidence.tracks.centre_m[-1, k]))


def _excuses(evidence: Evidence, voyages: Voyages, away: list[int], bound: NDArray[np.bool_]) -> dict[int, str]:
    """Return why each of `away` need not arrive: where the UAVs that no longer fly are, or may be. "" if it must."""
    roster = evidence.mission.roster
    places = [*places_without(evidence, bound), *evidence.foreign]
    astray = [*points_of(evidence, voyages, away), *evidence.foreign_away]
    found = hindrances(astray, places, evidence.mission.zone)
    living = {roster[k].uav for k in np.flatnonzero(bound).tolist()} | {entry.uav for entry, _ in evidence.foreign_away}
    return {k: _excuse(found[roster[k].uav], living) if roster[k].uav in found else "" for k in away}


def places_without(evidence: Evidence, bound: NDArray[np.bool_]) -> Iterator[Place]:
    """Yield where the UAVs in the airspace are, or may be, of which no progress is expected."""
    mission, centre_m = evidence.mission, evidence.tracks.centre_m[-1]
    plan = max(evidence.plans, key=lambda report: (report.term, report.slot), default=None)
    for k in np.flatnonzero(~bound & ~evidence.tracks.grounded[-1:].any(axis=0)).tolist():
        entry = mission.roster[k]
        yield from places_of(entry, point(centre_m[k]), plan, step_m=mission.step_m(entry))


def points_of(evidence: Evidence, voyages: Voyages, away: Collection[int]) -> list[tuple[RosterEntry, Point]]:
    """Return UAVs with their newest goals and their points at the end."""
    return [(voyages.each[k].present, point(evidence.tracks.centre_m[-1, k])) for k in away]


def _excuse(found: Hindrance, living: Collection[str]) -> str:
    gone = all(uav not in living for uav in found.uavs)
    verb = "flies" if len(found.uavs) == 1 else "fly"
    who = f"{' and '.join(found.uavs)}, which {f'no longer {verb}' if gone else 'can no longer move'}"
    match found.kind:
        case "covered":
            return f"its target is, or may be, covered by {who}"
        case "held":
            return f"it must hold, since no step leads away from {'zones and ' * found.with_zones}{who}"
        case "closed in":
            return f"there is no way to its target round {'zones and ' * found.with_zones}{who}"


def _missing(evidence: Evidence, voyages: Voyages, k: int) -> Violation:
    uav, away_m = evidence.tracks.uavs[k], _away_m(evidence, voyages, k)
    slot = evidence.tracks.slots - 1
    return Violation("not-arrived", f"{uav} is {away_m:.2f} m from its target", slot, [uav], None, away_m)


def _faults(evidence: Evidence) -> list[Fault]:
    """Return the faults by time: as the events report them, and the planned ones that no event reports."""
    mission, events = evidence.whole, evidence.recording.events
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
    mission = evidence.whole
    return f" (max_slots = {mission.max_slots} was given)" if mission.max_slots < default_max_slots(mission) else ""
