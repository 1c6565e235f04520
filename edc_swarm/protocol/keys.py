"""Keys of the bus, all below `swarm/{mission}`, with the message and the publisher of each."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, get_args

from msgspec import Struct

from edc_swarm.mission.field_types import MissionId
from edc_swarm.mission.roles import OPERATOR, RECORDER, VISUALISER
from edc_swarm.protocol.messages import Command, Event, Fix, Goal, Message, MissionMessage, Report, Truth

PREFIX = "swarm"


@dataclass(frozen=True, slots=True)
class KeyForm:
    """The key of one kind of message, below `swarm/{mission}/`.

    `form` has a pair of braces for each of the message's `fields`; `sender` is the field that names the publisher,
    or the role that alone publishes such messages.
    """

    form: str
    fields: tuple[str, ...]
    sender: str

    @property
    def stream(self) -> Callable[[Any], tuple[str, ...]]:
        """Function from a message to its publisher's instance, followed by the fields."""
        return attrgetter("instance", *self.fields)

    @property
    def names(self) -> Callable[[Any], tuple[str, ...]]:
        """Function from a message to the names in its key."""
        stream, end = self.stream, 1 + self.form.count("{}")
        return lambda message: stream(message)[1:end]


KEY_FORMS: dict[type[Struct], KeyForm] = {
    Fix: KeyForm("uav/{}/fix", ("uav",), sender="uav"),
    Truth: KeyForm("uav/{}/truth", ("uav",), sender="uav"),
    Command: KeyForm("head/{}/command/{}", ("head", "uav"), sender="head"),
    Report: KeyForm("head/{}/report", ("head",), sender="head"),
    Event: KeyForm("event/{}", ("source",), sender="source"),
    Goal: KeyForm("goal/{}/to/{}", ("source", "uav"), sender="source"),
    MissionMessage: KeyForm("mission", ("name",), sender=OPERATOR),
}
"""Forms of the keys of messages; all code that builds or parses a key derives from this table."""
SCENES = "viz"
"""First part of the keys of scenes: the visualiser publishes them, and they are no messages of the swarm."""
ALL_ALIVE = f"{PREFIX}/*/alive/**"
"""Liveliness tokens of every process of every mission at a router."""
SESSION_LEASE_MS = 4000
"""Time without a sign of life after which a router closes a session, whose liveliness tokens then vanish.

A killed process needs none: the kernel closes its sockets. Zenoh sends a sign of life in each quarter of the lease in
which a session says nothing else, so a UAV that flies slots of up to a second sends none; and an overloaded machine
does not lose its sessions when it stalls for a second.
"""


def _shape(parts: Sequence[str]) -> tuple[int, str, str]:
    """Return the signature of a kind's keys, unique to that kind: the number of parts, the first and the third."""
    return len(parts), parts[0], parts[2] if len(parts) > 2 else ""


_KINDS = {_shape(form.form.split("/")): kind for kind, form in KEY_FORMS.items()}
_SENDER_AT = {
    words[0]: words.index("{}") if form.sender in form.fields else 0
    for form in KEY_FORMS.values()
    for words in [form.form.split("/")]
}
"""Position of the publisher in a key, by the key's first part; 0 if only the operator publishes on it."""
_STREAMS = {kind: form.stream for kind, form in KEY_FORMS.items()}
_is_mission_id = re.compile(get_args(MissionId)[1].pattern).search


class Keys:
    """Key expressions of one mission, all below `swarm/{mission}`."""

    def __init__(self, mission_id: str) -> None:
        self.root = f"{PREFIX}/{mission_id}"
        self.mission = self._of(MissionMessage, mission_id)
        self.all_fixes = self.fix("*")
        self.all_truths = self.truth("*")
        self.all_reports = self.report("*")
        self.all_alive = f"{self.root}/alive/**"
        self.everything = f"{self.root}/**"

    def said_by(self, uavs: Sequence[str]) -> list[str]:
        """Return the key expressions of all that some UAVs publish, with the mission and the events of two roles."""
        said = [f"{self.root}/{form.format(uav)}" for uav in uavs for form in ("uav/{}/**", "head/{}/**", "event/{}")]
        return [self.mission, self.event(OPERATOR), self.event(RECORDER), *said]

    def _of(self, kind: type[Struct], *values: str) -> str:
        return f"{self.root}/{KEY_FORMS[kind].form.format(*values)}"

    def fix(self, uav: str) -> str:
        """Return the key of a UAV's fixes."""
        return self._of(Fix, uav)

    def truth(self, uav: str) -> str:
        """Return the key of the emulator's ground truth of a UAV."""
        return self._of(Truth, uav)

    def command(self, head: str, uav: str) -> str:
        """Return the key of `head`'s commands to `uav`."""
        return self._of(Command, head, uav)

    def commands_to(self, uav: str) -> str:
        """Return the key expression of every head's commands to `uav`."""
        return self._of(Command, "*", uav)

    def report(self, head: str) -> str:
        """Return the key of a head's slot reports."""
        return self._of(Report, head)

    def event(self, source: str) -> str:
        """Return the key of a publisher's events."""
        return self._of(Event, source)

    def goal(self, source: str, uav: str) -> str:
        """Return the key of the goals that `source` gives to a UAV; with "*" for either, that of all."""
        return self._of(Goal, source, uav)

    @property
    def claims(self) -> str:
        """Key on which the operator answers claims to fly a UAV."""
        return f"{self.root}/claims"

    def orders(self, name: str) -> str:
        """Return the key of the operator's orders to a service that it did not launch, such as a remote recorder."""
        return f"{self.root}/orders/{name}"

    def again(self, source: str, instance: str) -> str:
        """Return the key on which a publisher answers requests to retransmit."""
        return f"{self.root}/again/{source}/{instance}"

    def alive(self, uav: str, instance: str) -> str:
        """Return the key of a process's liveliness token."""
        return f"{self.root}/alive/{uav}/{instance}"

    def of(self, message: Message) -> str:
        """Return the key of `message`."""
        kind = type(message)
        return self._of(kind, *_STREAMS[kind](message)[1:])


def kind_of(key: str) -> type[Struct] | None:
    """Return the type of the messages on `key` (with or without the `swarm/{mission}` prefix), or None.

    A key expression for several missions, such as `swarm/*/mission`, has no type.
    """
    parts = key.split("/")
    if parts[0] == PREFIX:
        if not _is_mission_id(parts[1] if len(parts) > 1 else ""):
            return None
        parts = parts[2:]
    return _KINDS.get(_shape(parts)) if parts else None


def names_of(kind: type[Struct], parts: Sequence[str]) -> tuple[str, ...]:
    """Return the names in a key of this kind; `parts` are those below `swarm/{mission}`."""
    words = KEY_FORMS[kind].form.split("/")
    return tuple(part for word, part in zip(words, parts, strict=True) if word == "{}")


def source_of(key: str) -> str:
    """Return the publisher on a key of the bus, or on a key below it; "" if there is none."""
    first, *rest = key.split("/")[2:] or [""]
    if first == SCENES and rest:
        return VISUALISER
    position = _SENDER_AT.get(first, -1)
    if position == 0:
        return "" if rest else OPERATOR
    return rest[position - 1] if 0 < position <= len(rest) else ""
