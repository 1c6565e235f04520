"""How each publisher ended: by its last word, by a fault, or, as far as the record tells, not at all."""

from __future__ import annotations

from dataclasses import dataclass
from operator import attrgetter

from edc_swarm.mission.configuration import OPERATOR
from edc_swarm.mission.faults import Freeze, Kill, read_fault
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.keys import KEY_FORMS
from edc_swarm.recording.model import Recording


@dataclass(frozen=True, slots=True)
class Ends:
    """Publishers by how they ended.

    Attributes
    ----------
    without_last_word
        Ids of which some process never said its last numbers, killed ones among them.
    ended_by_fault
        Ids that a recorded fault, or the death that the operator saw, has ended.
    unended
        Ids whose newest process never said its last numbers, though nothing recorded ended it, and UAVs of
        the mission of which nothing at all is recorded.
    """

    without_last_word: frozenset[str]
    ended_by_fault: frozenset[str]
    unended: frozenset[str]


def ends_of(recording: Recording) -> Ends:
    """Tell for every UAV, and everybody else who spoke, how it ended.

    A process that was followed by another of the same id has ended, whatever it was that ended it.
    """
    first_ns: dict[tuple[str, str], int] = {}
    for kind, form in KEY_FORMS.items():
        speaker = attrgetter(form.fields[0], "instance")
        for message in recording.lists()[kind]:
            who = speaker(message)
            first_ns[who] = min(message.sent_ns, first_ns.get(who, message.sent_ns))
    first_ns.pop((recording.mission.name, recording.mission.instance), None)
    newest: dict[str, tuple[int, str]] = {}
    for (source, instance), began_ns in first_ns.items():
        newest[source] = max((began_ns, instance), newest.get(source, (-1, "")))
    closed = {(event.source, event.instance) for event in recording.events if event.kind == EventKind.CLOSED}
    deaths = _deaths(recording)
    killed = {source for source, at_ns in deaths.items() if at_ns >= newest.get(source, (0, ""))[0]}
    silent = {source for source, instance in first_ns.keys() - closed}
    open_now = {source for source, (_, instance) in newest.items() if (source, instance) not in closed}
    unheard = {entry.uav for entry in recording.mission.roster} - newest.keys()
    return Ends(frozenset(silent | unheard), frozenset(killed), frozenset((open_now | unheard) - killed))


def _deaths(recording: Recording) -> dict[str, int]:
    """When each id was last told to be killed or frozen, or was seen dead."""
    deaths: dict[str, int] = {}
    for event in recording.events:
        if event.source != OPERATOR:
            continue
        who = ""
        if event.kind == EventKind.FAULT:
            fault = read_fault(event.detail, recording.mission.dt_s)
            who = fault.target if isinstance(fault, (Kill, Freeze)) else ""
        elif event.kind == EventKind.EXITED:
            who = event.detail.split(" ", 1)[0]
        deaths[who] = max(event.sent_ns, deaths.get(who, 0))
    return deaths
