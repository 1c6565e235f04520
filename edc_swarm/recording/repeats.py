"""Repeats: messages that a publisher said again within their slot, with a new number and nothing else that is new.

Who counts messages counts repeats too; who counts plans, or times them, takes each once.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TypeVar

import msgspec

from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.messages import PLANNED, Command, Report
from edc_swarm.recording.model import Recording

Said = TypeVar("Said", Command, Report)


def said_once(messages: Iterable[Said]) -> Iterator[Said]:
    """Yield the messages without those that equal an earlier one in all but sequence number and time of sending."""
    seen: dict[tuple[str, str, str, int, int], list[Said]] = {}
    for message in messages:
        uav = message.uav if isinstance(message, Command) else ""
        earlier = seen.setdefault((message.head, message.instance, uav, message.term, message.slot), [])
        if not any(_repeats(message, other) for other in earlier):
            earlier.append(message)
            yield message


def plans_of(recording: Recording) -> list[Report]:
    """Return the reports of all plans, each once; without `resends` a second equal one is a second plan."""
    reports = [report for report in recording.reports if report.status in PLANNED]
    return list(said_once(reports)) if recording.mission.resends else reports


def failed_plans(recording: Recording) -> str:
    """Return how often a user's planner failed, and its first error; empty if it never did."""
    problem = next((event for event in recording.events if event.kind == EventKind.PLANNER_FAILED), None)
    if problem is None:
        return ""
    failed = sum(report.status == "failed" for report in plans_of(recording))
    held = f"{failed} plans failed, and all held" if failed else "plans failed, and their UAVs held"  # control "local"
    return f"{held}; first in slot {problem.slot}: {problem.detail}"


def _repeats(message: Said, other: Said) -> bool:
    return msgspec.structs.replace(message, seq=other.seq, sent_ns=other.sent_ns) == other
