"""The messages heard for each slot, until the slot is told."""

from __future__ import annotations

from collections.abc import Set
from dataclasses import dataclass, field

from edc_swarm.protocol.messages import Command, Event, Fix, Message, Report

WINDOW = 64
"""Most slots between the slot that is told next and the newest that is kept."""
MAX_EVENTS = 1000
"""Most events of a slot that are told."""


@dataclass(slots=True)
class Heard:
    """The messages of one slot: for each UAV its newest fix and the command of the highest term."""

    fixes: dict[str, Fix] = field(default_factory=dict)
    commands: dict[str, Command] = field(default_factory=dict)
    plan: Report | None = None
    claims: list[Report] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    fix_seqs: dict[str, dict[str, set[int]]] = field(default_factory=dict)
    """Numbers of the fixes of each UAV, by its process."""
    command_holes: set[str] = field(default_factory=set)
    """UAVs whose command before this slot's is missing."""


class Inbox:
    """The messages of the slots that are still to be told; a message of another slot is left out."""

    def __init__(self, roster: Set[str], quorum: int, first_slot: int) -> None:
        self._roster = roster
        self._quorum = quorum
        self._next = first_slot
        self._slots: dict[int, Heard] = {}
        self._seqs: dict[tuple[str, str], int] = {}

    def hear(self, message: Message) -> None:
        """Keep a message for its slot."""
        match message:
            case Fix() if message.uav in self._roster and (heard := self._at(message.slot)) is not None:
                heard.fix_seqs.setdefault(message.uav, {}).setdefault(message.instance, set()).add(message.seq)
                known = heard.fixes.get(message.uav)
                if known is None or message.sent_ns >= known.sent_ns:
                    heard.fixes[message.uav] = message
            case Command() if message.uav in self._roster and (heard := self._at(message.slot)) is not None:
                self._count(message, heard)
                known_command = heard.commands.get(message.uav)
                if known_command is None or message.term > known_command.term:  # Not a repeat, which is later.
                    heard.commands[message.uav] = message
            case Report() if (heard := self._at(message.slot)) is not None:
                self._hear_report(message, heard)
            case Event() if (heard := self._at(max(message.slot, self._next))) is not None:
                if len(heard.events) < MAX_EVENTS:
                    heard.events.append(message)
            case _:
                pass

    @property
    def next_slot(self) -> int:
        """The slot that is taken next."""
        return self._next

    def take(self, slot: int) -> Heard:
        """Return what was heard of a slot, which is told now; nothing more is kept for it."""
        self._next = slot + 1
        return self._slots.pop(slot, Heard())

    def _at(self, slot: int) -> Heard | None:
        if not self._next <= slot < self._next + WINDOW:
            return None
        return self._slots.setdefault(slot, Heard())

    def _count(self, command: Command, heard: Heard) -> None:
        """Note the UAVs for which a command before this one is missing."""
        stream = command.instance, command.uav
        expected = self._seqs.get(stream, 0)
        if command.seq > expected:
            heard.command_holes.add(command.uav)
        self._seqs[stream] = max(expected, command.seq + 1)

    def _hear_report(self, report: Report, heard: Heard) -> None:
        if not report.is_backed(self._roster, self._quorum) and report.status != "claim":
            return
        if report.status == "claim":
            if all((claim.head, claim.term) != (report.head, report.term) for claim in heard.claims):
                heard.claims.append(report)
        elif report.has_quorum and (heard.plan is None or report.term >= heard.plan.term):
            heard.plan = report
