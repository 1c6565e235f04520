"""The end of each publisher: with a `closed` event, by a fault, or unknown to the recording."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter, itemgetter

from edc_swarm.mission.configuration import NS_PER_S
from edc_swarm.mission.failsafe import failsafe_of
from edc_swarm.mission.faults import ChangeClock, Freeze, Kill, Restart, read_fault
from edc_swarm.mission.roles import OPERATOR, RECORDER, ROUTER
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.keys import KEY_FORMS
from edc_swarm.recording.model import DROPPED, Recording

BEGUN_SLOTS = 2
"""Slots after which every UAV that lives has published a message."""
STARTED_NS = 5 * NS_PER_S
"""Time after which a process that a fault has started again has published a message."""


@dataclass(frozen=True, slots=True)
class Ends:
    """Publishers, grouped by how they ended.

    Attributes
    ----------
    cut
        Processes, as (id, instance), that published no `closed` event; (id, "") of a process without any message.
    without_last_word
        Ids with at least one process that published no `closed` event, including killed processes.
    ended_by_fault
        Ids whose newest process was ended by a recorded fault, or was reported dead by the operator.
    unended
        Ids whose newest process published no `closed` event although no recorded fault or death ended it,
        UAVs of the mission without any recorded message, and UAVs of which the file lacks every message of a process
        that has spoken.
    replaced
        Ids of `without_last_word` that a later process has had too.
    unheard
        UAVs of which the file lacks every message of a process that has spoken.
    """

    cut: frozenset[tuple[str, str]]
    without_last_word: frozenset[str]
    ended_by_fault: frozenset[str]
    unended: frozenset[str]
    replaced: frozenset[str]
    unheard: frozenset[str]


def ends_of(recording: Recording) -> Ends:
    """Return how every UAV and every other publisher ended.

    A process has certainly ended if a later process with the same id has published.
    """
    first_ns: dict[tuple[str, str], int] = {}
    for kind, form in KEY_FORMS.items():
        speaker = attrgetter(form.fields[0], "instance")
        for message in recording.lists()[kind]:
            who = speaker(message)
            first_ns[who] = min(message.sent_ns, first_ns.get(who, message.sent_ns))
    first_ns.pop((recording.mission.name, recording.mission.instance), None)
    if DROPPED in (recording.run_end or {}):
        # The recorder publishes no `closed` event (`sequences.unknown_tails`).
        first_ns = {who: at_ns for who, at_ns in first_ns.items() if who[0] != RECORDER}
    newest: dict[str, tuple[int, str]] = {}
    for (source, instance), began_ns in first_ns.items():
        newest[source] = max((began_ns, instance), newest.get(source, (-1, "")))
    closed = {(event.source, event.instance) for event in recording.events if event.kind == EventKind.CLOSED}
    deaths = _deaths(recording)
    killed = {source for source, at_ns in deaths.items() if at_ns >= newest.get(source, (0, ""))[0]}
    open_now = {source for source, (_, instance) in newest.items() if (source, instance) not in closed}
    unheard = {entry.uav for entry in recording.mission.roster} - newest.keys()
    begun_ns: dict[str, list[int]] = {}
    for (source, _), began_ns in first_ns.items():
        begun_ns.setdefault(source, []).append(began_ns)
    missed = _missed(recording, begun_ns)
    cut = (first_ns.keys() - closed) | {(uav, "") for uav in unheard | missed}
    return Ends(
        cut=frozenset(cut),
        without_last_word=frozenset(source for source, _ in cut),
        ended_by_fault=frozenset(killed),
        unended=frozenset(missed | (open_now | unheard) - killed),
        replaced=frozenset(source for source, instance in first_ns.keys() - closed if newest[source][1] != instance),
        unheard=frozenset(missed),
    )


def _missed(recording: Recording, begun_ns: Mapping[str, Sequence[int]]) -> set[str]:
    """Return the UAVs of which the file lacks every message of a process that lived for so long that it has spoken.

    The operator's events say how many such processes have ended, and when; `begun_ns` has the first message of each
    process that the file knows. A UAV whose clock a fault set says nothing on when.

    Without a router nobody is heard, so a mission whose router fails promises nothing of processes started again. Nor
    does the restart of a UAV that has landed, or may have.
    """
    mission, operator = recording.mission, [event for event in recording.events if event.source == OPERATOR]
    uavs = {entry.uav for entry in mission.roster}
    speaks_ns: dict[str, float] = dict.fromkeys(uavs, mission.epoch_ns + BEGUN_SLOTS * mission.slot_ns)
    faults = [(e.sent_ns, read_fault(e.detail, mission.dt_s)) for e in operator if e.kind == EventKind.FAULT]
    strikes = [(at_ns, fault) for at_ns, fault in faults if isinstance(fault, Kill | Freeze | Restart)]
    routed = all(fault.target != ROUTER for _, fault in strikes)
    set_clocks = {fault.target for _, fault in faults if isinstance(fault, ChangeClock)}
    exits = [(e.sent_ns, e.detail.split(" ", 1)[0]) for e in operator if e.kind == EventKind.EXITED]
    spoke, missed = Counter[str](), set[str]()
    for at_ns, end in sorted([*strikes, *exits], key=itemgetter(0)):
        if (uav := end if isinstance(end, str) else end.target) not in uavs:
            continue
        spoke[uav] += speaks_ns.pop(uav, math.inf) <= at_ns
        heard = sum(began_ns < at_ns or uav in set_clocks for began_ns in begun_ns.get(uav, ()))
        missed |= {uav} if spoke[uav] > heard else set()
        if isinstance(end, Restart | Kill) and routed:
            down_s = end.for_s if isinstance(end, Kill) else 0.0
            spoken_ns = at_ns + down_s * NS_PER_S / mission.time_scale + STARTED_NS
            if spoken_ns < _lands_ns(recording, uav, at_ns):
                speaks_ns[uav] = spoken_ns
    last_ns = max((event.sent_ns for event in operator), default=0)
    spoke.update(uav for uav, at_ns in speaks_ns.items() if at_ns <= last_ns)
    return missed | {uav for uav, lives in spoke.items() if lives > len(begun_ns.get(uav, ()))}


def _lands_ns(recording: Recording, uav: str, at_ns: int) -> float:
    """Return when a UAV lands, by the steps and events that it told before `at_ns`; infinite if nothing tells it."""
    mission, failsafe = recording.mission, failsafe_of(recording.mission)
    told = (e for e in recording.events if e.source == uav and e.kind in {EventKind.LANDED, EventKind.BATTERY_EMPTY})
    if any(event.sent_ns <= at_ns for event in told):
        return at_ns
    if failsafe is None:
        return math.inf
    steps = (fix.slot for fix in recording.fixes if fix.uav == uav and fix.executing and fix.sent_ns <= at_ns)
    return mission.epoch_ns + failsafe.landing_slot(max(steps, default=-1)) * mission.slot_ns


def _deaths(recording: Recording) -> dict[str, int]:
    """Return, by id, the time of the last recorded kill, freeze or observed death in nanoseconds.

    A fault `mid-step` strikes in the next step of its process, up to a slot after its event, unless a restart of the
    process comes first.
    """
    deaths: dict[str, int] = {}
    for event in recording.events:
        if event.source != OPERATOR:
            continue
        if event.kind == EventKind.FAULT:
            fault = read_fault(event.detail, recording.mission.dt_s)
            if isinstance(fault, Restart) and fault.target in deaths:
                deaths[fault.target] = min(deaths[fault.target], event.sent_ns)
            if isinstance(fault, (Kill, Freeze)):
                struck_ns = event.sent_ns + fault.mid_step * recording.mission.slot_ns
                deaths[fault.target] = max(struck_ns, deaths.get(fault.target, 0))
        elif event.kind == EventKind.EXITED:
            who = event.detail.split(" ", 1)[0]
            deaths[who] = max(event.sent_ns, deaths.get(who, 0))
    return deaths
