"""The end of each publisher: with a `closed` event, by a fault, or unknown to the recording."""

from __future__ import annotations

from dataclasses import dataclass
from operator import attrgetter

from edc_swarm.mission.faults import Freeze, Kill, Restart, read_fault
from edc_swarm.mission.roles import OPERATOR, RECORDER
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.keys import KEY_FORMS
from edc_swarm.recording.model import DROPPED, Recording

BEGUN_SLOTS = 2
"""Slots after which every UAV that lives has published a message."""


@dataclass(frozen=True, slots=True)
class Ends:
    """Publishers, grouped by how they ended.

    Attributes
    ----------
    without_last_word
        Ids with at least one process that published no `closed` event, including killed processes.
    ended_by_fault
        Ids whose newest process was ended by a recorded fault, or was reported dead by the operator.
    unended
        Ids whose newest process published no `closed` event although no recorded fault or death ended it, and
        UAVs of the mission without any recorded message.
    replaced
        Ids of `without_last_word` that a later process has had too.
    unheard
        Ids of `unended` without any recorded message although a recorded fault or death ended them: it came so late
        that they must have said something.
    """

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
        # The recorder publishes no `closed` event: it writes `run_end` instead, after all of its own events. What is
        # made of a torn recording has a `run_end` without the recorder's own counts.
        first_ns = {who: at_ns for who, at_ns in first_ns.items() if who[0] != RECORDER}
    newest: dict[str, tuple[int, str]] = {}
    for (source, instance), began_ns in first_ns.items():
        newest[source] = max((began_ns, instance), newest.get(source, (-1, "")))
    closed = {(event.source, event.instance) for event in recording.events if event.kind == EventKind.CLOSED}
    deaths = _deaths(recording)
    killed = {source for source, at_ns in deaths.items() if at_ns >= newest.get(source, (0, ""))[0]}
    silent = {source for source, instance in first_ns.keys() - closed}
    replaced = {source for source, instance in first_ns.keys() - closed if newest[source][1] != instance}
    open_now = {source for source, (_, instance) in newest.items() if (source, instance) not in closed}
    unheard = {entry.uav for entry in recording.mission.roster} - newest.keys()
    # Who lived on into the mission has said something, which the file then lacks.
    begun_ns = recording.mission.epoch_ns + BEGUN_SLOTS * recording.mission.slot_ns
    lost = {uav for uav in unheard if deaths.get(uav, 0) >= begun_ns}
    killed -= lost
    return Ends(
        without_last_word=frozenset(silent | unheard),
        ended_by_fault=frozenset(killed),
        unended=frozenset((open_now | unheard) - killed),
        replaced=frozenset(replaced),
        unheard=frozenset(lost),
    )


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
