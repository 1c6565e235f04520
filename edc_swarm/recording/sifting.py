"""Removal of foreign messages from a recording: those of unknown publishers, and replays of older runs.

The recorder writes foreign messages too; readers keep them out of every computation. A message of a UAV of the
mission stays, even if it is wrong: the guarantees judge it.
"""

from __future__ import annotations

from collections.abc import Callable
from operator import attrgetter
from typing import Any

from edc_swarm.mission.roles import ROLES
from edc_swarm.protocol.keys import KEY_FORMS
from edc_swarm.protocol.messages import Event, Goal, MissionMessage
from edc_swarm.recording.model import Bin, Garbage, Recording

OLDER, FOREIGN = "from an older run", "from no process of the mission"


def sift(recording: Recording) -> None:
    """Move the messages that are not of this run from the lists of `recording` to its garbage."""
    running = _running(recording)
    roster = {entry.uav for entry in recording.mission.roster}
    known: dict[type, set[str]] = dict.fromkeys(KEY_FORMS, roster)
    known |= {Event: roster | ROLES, Goal: roster | ROLES, MissionMessage: {recording.mission.name}}
    refused = Bin(recording.garbage)
    for kind, form in KEY_FORMS.items():
        messages = recording.lists()[kind]
        source = form.stream
        foreign = {
            said: OLDER if known[kind].issuperset(said[1:]) else FOREIGN
            for said in set(map(source, messages))
            if said[:2] not in running or not known[kind].issuperset(said[1:])
        }
        if foreign:
            for message in messages:
                if (of := source(message)) in foreign:
                    refused.add(Garbage(form.form.format(*of[1:]), message.sent_ns, foreign[of]))
            messages[:] = [message for message in messages if source(message) not in foreign]
    recording.garbage = refused.contents()


def _running(recording: Recording) -> set[tuple[str, str]]:
    """Return (instance, id) of every publisher with a message since the mission was published, or since its epoch.

    A mission with autopilots is published long before its epoch, and may end before it. One such message is enough,
    because a clock may be set back later in the run. The id is part of the pair, so that a foreign message under
    another id does not make an old instance count.
    """
    mission = recording.mission
    since_ns = min(mission.sent_ns, mission.epoch_ns) or mission.epoch_ns
    running = {(mission.instance, mission.name)}
    for kind, form in KEY_FORMS.items():
        speaker: Callable[[Any], tuple[str, str]] = attrgetter("instance", form.fields[0])
        messages = recording.lists()[kind]
        running |= {speaker(message) for message in messages if message.sent_ns >= since_ns}
    return running
