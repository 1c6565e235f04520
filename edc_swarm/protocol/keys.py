"""The keys of the bus, all below `swarm/{mission}`: which message is published on which key."""

from __future__ import annotations

import re
from typing import get_args

from msgspec import Struct

from edc_swarm.mission.configuration import MissionId
from edc_swarm.protocol.messages import Command, Event, Fix, Message, MissionMessage, Report, Truth

PREFIX = "swarm"
_KINDS: dict[tuple[str, int], type[Struct]] = {
    ("fix", 3): Fix,
    ("truth", 3): Truth,
    ("command", 4): Command,
    ("report", 3): Report,
    ("event", 2): Event,
    ("mission", 1): MissionMessage,
}
_is_mission_id = re.compile(get_args(MissionId)[1].pattern).search


class Keys:
    """Key expressions of one mission, all below `swarm/{mission}`."""

    def __init__(self, mission_id: str) -> None:
        self.root = f"{PREFIX}/{mission_id}"
        self.mission = f"{self.root}/mission"
        self.all_fixes = f"{self.root}/uav/*/fix"
        self.all_truths = f"{self.root}/uav/*/truth"
        self.all_reports = f"{self.root}/head/*/report"
        self.all_alive = f"{self.root}/alive/**"
        self.everything = f"{self.root}/**"

    def fix(self, uav: str) -> str:
        """Key of a UAV's fixes."""
        return f"{self.root}/uav/{uav}/fix"

    def truth(self, uav: str) -> str:
        """Key of the emulator's ground truth of a UAV."""
        return f"{self.root}/uav/{uav}/truth"

    def command(self, head: str, uav: str) -> str:
        """Key of `head`'s commands to `uav`."""
        return f"{self.root}/head/{head}/command/{uav}"

    def commands_to(self, uav: str) -> str:
        """Key expression of every head's commands to `uav`."""
        return f"{self.root}/head/*/command/{uav}"

    def report(self, head: str) -> str:
        """Key of a head's slot reports."""
        return f"{self.root}/head/{head}/report"

    def event(self, source: str) -> str:
        """Key of a publisher's events."""
        return f"{self.root}/event/{source}"

    @property
    def claims(self) -> str:
        """Key on which the operator answers claims to fly a UAV."""
        return f"{self.root}/claims"

    def orders(self, name: str) -> str:
        """Key on which a part that nobody launched, such as the recorder, is told what to do."""
        return f"{self.root}/orders/{name}"

    def again(self, source: str, instance: str) -> str:
        """Key on which a publisher is asked for messages that have not arrived."""
        return f"{self.root}/again/{source}/{instance}"

    def alive(self, uav: str, instance: str) -> str:
        """Key of a process's liveliness token."""
        return f"{self.root}/alive/{uav}/{instance}"

    def of(self, message: Message) -> str:
        """Key on which `message` is published."""
        match message:
            case Fix():
                return self.fix(message.uav)
            case Truth():
                return self.truth(message.uav)
            case Command():
                return self.command(message.head, message.uav)
            case Report():
                return self.report(message.head)
            case Event():
                return self.event(message.source)
            case MissionMessage():
                return self.mission


def kind_of(key: str) -> type[Struct] | None:
    """Type of the messages on `key` (with or without the `swarm/{mission}` prefix), or None.

    A key that stands for many, such as `swarm/*/mission`, is no mission's.
    """
    parts = key.split("/")
    if parts[0] == PREFIX:
        if not _is_mission_id(parts[1] if len(parts) > 1 else ""):
            return None
        parts = parts[2:]
    if not parts:
        return None
    name = parts[0]
    if (name == "uav" and len(parts) == 3) or (name == "head" and len(parts) in {3, 4}):
        name = parts[2]
    return _KINDS.get((name, len(parts)))
