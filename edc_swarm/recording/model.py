"""A recording in memory: what was said in one run, by kind and in the order of the record."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from edc_swarm.messages import Command, Event, Fix, Message, MissionMessage, Report, Truth


@dataclass(frozen=True, slots=True)
class Garbage:
    """A payload on a swarm topic that is no message of its kind."""

    topic: str
    log_time_ns: int
    reason: str


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
        Payloads on swarm topics that could not be decoded.
    unknown
        Number of messages on other topics, by topic (viewers' topics among them).
    problems
        What could not be read of a torn file, one line each.
    duplicates
        Number of messages that were left out since the same one had been read.
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
        """Make a recording of messages in the order of their publication.

        `mission` is needed only where none of the messages is the mission.
        """
        recording = cls(run=dict(run or {}), run_end=dict(run_end or {}))
        lists = recording.lists()
        for message in messages:
            lists[type(message)].append(message)
        if mission is not None and not recording.missions:
            recording.missions.append(mission)
        return recording
