"""The messages of one run in memory, in one list per type."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

from edc_swarm.protocol.messages import Command, Event, Fix, Goal, Message, MissionMessage, Report, Truth
from edc_swarm.recording.ordering import in_order

MAX_GARBAGE = 10_000
"""Most pairs of topic and reason that are counted separately; all further garbage is counted together."""
OTHERS = "(others)"
DROPPED = "dropped"
"""Fact of `run_end`: how many messages the recorder had no room for; a recorder that did not finish lacks it."""
FETCHED = "fetched"
"""Fact of `run_end`: how many messages were asked for again, and had."""
MAX_DIGITS = 18
"""Digits of a count in `run_end`."""


@dataclass(frozen=True, slots=True)
class Garbage:
    """A payload that is not a valid message of its topic, or comes from no process of this run."""

    topic: str
    log_time_ns: int
    reason: str
    count: int = 1
    """Number of payloads with this topic and reason; the other fields describe the earliest one."""


@dataclass(slots=True)
class Recording:
    """All messages of one run, with the facts that the recorder wrote about it.

    Attributes
    ----------
    run, run_end
        Facts about the run; `run_end` is None if the recorder did not finish.
    missions
        Every mission message; the first one is the mission of the run.
    garbage
        Payloads on swarm topics that could not be decoded, one entry per topic and reason.
    duplicates
        Number of messages that were dropped because the file holds an equal one, over all topics.
    unknown
        Number of messages on other topics, by topic (for example the topics of viewers).
    problems
        One line for each part of a torn file that could not be read.
    """

    run: dict[str, str] = field(default_factory=dict)
    run_end: dict[str, str] | None = None
    missions: list[MissionMessage] = field(default_factory=list)
    fixes: list[Fix] = field(default_factory=list)
    truths: list[Truth] = field(default_factory=list)
    commands: list[Command] = field(default_factory=list)
    reports: list[Report] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    goals: list[Goal] = field(default_factory=list)
    garbage: list[Garbage] = field(default_factory=list)
    unknown: dict[str, int] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    duplicates: int = 0

    @property
    def mission(self) -> MissionMessage:
        """The mission of this run."""
        return self.missions[0]

    @property
    def message_count(self) -> int:
        """Number of messages of the swarm."""
        return sum(map(len, self.lists().values()))

    @property
    def garbage_count(self) -> int:
        """Number of payloads on the swarm's topics that are not messages, or come from no process of this run."""
        return sum(garbage.count for garbage in self.garbage)

    @property
    def fetched_count(self) -> int | None:
        """Number of messages that came late, since they had to be asked for again; None where `run_end` lacks it."""
        told = (self.run_end or {}).get(FETCHED, "")
        return int(told) if told.isdecimal() and len(told) <= MAX_DIGITS else None

    def put_in_order(self) -> None:
        """Sort every kind of message by content; drop exact duplicates and count them in `duplicates`."""
        for kind, messages in self.lists().items():
            count = len(messages)
            messages[:] = in_order(messages, kind)
            self.duplicates += count - len(messages)

    def lists(self) -> dict[type, list[Any]]:
        """Return, by message type, the list that holds its messages."""
        return {
            Fix: self.fixes,
            Truth: self.truths,
            Command: self.commands,
            Report: self.reports,
            Event: self.events,
            Goal: self.goals,
            MissionMessage: self.missions,
        }

    @classmethod
    def from_messages(cls, messages: Iterable[Message]) -> Recording:
        """Return a recording of `messages`, in the order in which the reader of a file with them returns them."""
        recording = cls()
        lists = recording.lists()
        for message in messages:
            lists[type(message)].append(message)
        recording.put_in_order()
        return recording


class Bin:
    """A counter of garbage in bounded memory: the number and the earliest payload of each topic and reason."""

    def __init__(self, garbage: Iterable[Garbage] = ()) -> None:
        self._kinds: dict[tuple[str, str], Garbage] = {}
        for each in garbage:
            self.add(each)

    def add(self, garbage: Garbage) -> None:
        """Add `garbage` to the counts."""
        kind = garbage.topic, garbage.reason
        if kind not in self._kinds and len(self._kinds) >= MAX_GARBAGE:
            kind = OTHERS, "more topics and reasons than are counted separately"
            garbage = replace(garbage, topic=kind[0], reason=kind[1])
        known = self._kinds.get(kind)
        if known is not None:
            first_ns = min(known.log_time_ns, garbage.log_time_ns)
            garbage = replace(known, log_time_ns=first_ns, count=known.count + garbage.count)
        self._kinds[kind] = garbage

    def contents(self) -> list[Garbage]:
        """Return one entry per topic and reason, sorted by both."""
        return [self._kinds[kind] for kind in sorted(self._kinds)]
