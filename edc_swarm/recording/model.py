"""A recording in memory: what was said in one run, by kind and in the order of the record."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from edc_swarm.protocol.messages import Command, Event, Fix, Message, MissionMessage, Report, Truth
from edc_swarm.recording.ordering import put_in_order

MAX_GARBAGE = 10_000
"""Kinds of garbage (topic and reason) that are told apart; all others count as of one kind."""
OTHERS = "(others)"


@dataclass(frozen=True, slots=True)
class Garbage:
    """A payload on a swarm topic that is no message of its kind."""

    topic: str
    log_time_ns: int
    reason: str
    count: int = 1
    """How many there are on the topic, for the same reason; the first by time is the one described."""


@dataclass(slots=True)
class Recording:
    """One run.

    Attributes
    ----------
    run, run_end
        Facts about the run; `run_end` is None when the recorder did not finish.
    missions
        Every mission message; the first one is the mission.
    garbage
        Payloads on swarm topics that could not be decoded, one entry per topic and reason.
    duplicates
        How many messages, of any topic, were dropped because the file holds equal ones.
    unknown
        Number of messages on other topics, by topic (viewers' topics among them).
    problems
        What could not be read of a torn file, one line each.
    """

    run: dict[str, str] = field(default_factory=dict)
    run_end: dict[str, str] | None = None
    missions: list[MissionMessage] = field(default_factory=list)
    fixes: list[Fix] = field(default_factory=list)
    truths: list[Truth] = field(default_factory=list)
    commands: list[Command] = field(default_factory=list)
    reports: list[Report] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    garbage: list[Garbage] = field(default_factory=list)
    unknown: dict[str, int] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    duplicates: int = 0

    @property
    def mission(self) -> MissionMessage:
        """The mission as run."""
        return self.missions[0]

    @property
    def message_count(self) -> int:
        """Number of swarm messages."""
        return sum(map(len, self.lists().values()))

    @property
    def garbage_count(self) -> int:
        """Number of payloads on swarm topics that are no messages, or nobody's in the mission."""
        return sum(garbage.count for garbage in self.garbage)

    def lists(self) -> dict[type, list[Any]]:
        """The list that holds the messages of each type."""
        return {
            Fix: self.fixes,
            Truth: self.truths,
            Command: self.commands,
            Report: self.reports,
            Event: self.events,
            MissionMessage: self.missions,
        }

    @classmethod
    def from_messages(
        cls,
        messages: Iterable[Message],
        mission: MissionMessage | None = None,
        run: Mapping[str, str] | None = None,
        run_end: Mapping[str, str] | None = None,
    ) -> Recording:
        """Make a recording of messages, in the order in which the reader of a file with them would have them.

        `mission` is needed only where none of the messages is the mission.
        """
        recording = cls(run=dict(run or {}), run_end=dict(run_end or {}))
        lists = recording.lists()
        for message in messages:
            lists[type(message)].append(message)
        if mission is not None and not recording.missions:
            recording.missions.append(mission)
        put_in_order(recording)
        return recording


class Bin:
    """Gathers garbage in bounded memory: how many of each kind, and the first of each."""

    def __init__(self, garbage: Iterable[Garbage] = ()) -> None:
        self._kinds: dict[tuple[str, str], Garbage] = {}
        for each in garbage:
            self.add(each)

    def add(self, garbage: Garbage) -> None:
        """Count `garbage`."""
        kind = garbage.topic, garbage.reason
        if kind not in self._kinds and len(self._kinds) >= MAX_GARBAGE:
            kind = OTHERS, "more kinds of garbage than are told apart"
            garbage = replace(garbage, topic=kind[0], reason=kind[1])
        known = self._kinds.get(kind)
        if known is not None:
            first_ns = min(known.log_time_ns, garbage.log_time_ns)
            garbage = replace(known, log_time_ns=first_ns, count=known.count + garbage.count)
        self._kinds[kind] = garbage

    def contents(self) -> list[Garbage]:
        """Return one entry per kind, by topic and reason."""
        return [self._kinds[kind] for kind in sorted(self._kinds)]
