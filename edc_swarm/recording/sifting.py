"""What is in a record though nobody in the mission said it: strangers' messages, and replays of older runs.

They are recorded like everything else, and kept out of what is computed from the record. What a UAV
of the mission said stays, however wrong it is: to judge that is what the guarantees are for.
"""

from __future__ import annotations

from operator import attrgetter
from typing import Any

from edc_swarm.config import ROLES
from edc_swarm.messages import Event, MissionMessage
from edc_swarm.recording.model import Garbage, Recording
from edc_swarm.recording.sequences import KEY_FORMS


def sift(recording: Recording) -> None:
    """Move what is not of this run from the lists of `recording` to its garbage."""
    running = _running(recording)
    roster = {entry.uav for entry in recording.mission.roster}
    for kind, (form, names) in KEY_FORMS.items():
        messages = recording.lists()[kind]
        known = roster | ROLES if kind is Event else roster
        source = attrgetter("instance", *names)
        foreign = {
            said: "of nobody in the mission" if known.isdisjoint(said[1:]) else "of an older run"
            for said in set(map(source, messages))
            if kind is not MissionMessage and not (said[0] in running and known.issuperset(said[1:]))
        }
        if foreign:
            refused = [message for message in messages if source(message) in foreign]
            recording.garbage += [
                Garbage(form.format(*source(message)[1:]), message.sent_ns, foreign[source(message)])
                for message in refused
            ]
            messages[:] = [message for message in messages if source(message) not in foreign]


def _running(recording: Recording) -> set[str]:
    """Instances that said anything since the mission's epoch (a clock may be set back now and then)."""
    lists: dict[type, list[Any]] = recording.lists()
    epoch_ns = recording.mission.epoch_ns
    return {message.instance for messages in lists.values() for message in messages if message.sent_ns >= epoch_ns}
