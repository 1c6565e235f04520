"""What stands late in a record, because it was fetched again, is put where it belongs.

Readers take the messages of a publisher in the order of the record for the order in which they were said.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from operator import attrgetter
from typing import Any

from edc_swarm.recording.model import Recording
from edc_swarm.recording.sequences import KEY_FORMS

FETCHED = "fetched"
"""Fact of `run_end`: how many messages were asked for again, and had."""


def fetched_count(recording: Recording) -> int:
    """How many messages came late, since they had to be asked for again."""
    told = (recording.run_end or {}).get(FETCHED, "")
    return int(told) if told.isdecimal() else 0


def restore_order(recording: Recording) -> None:
    """Order each publisher's messages by their numbers, unless the record says that nothing had to be fetched."""
    if (recording.run_end or {}).get(FETCHED) == "0" or recording.run.get("clock") == "virtual":
        return
    for kind, messages in recording.lists().items():
        messages[:] = _ordered(messages, KEY_FORMS[kind][1])


def _ordered(messages: Sequence[Any], names: tuple[str, ...]) -> Iterator[Any]:
    """Each late message right before the first of its stream that has a greater number."""
    stream = attrgetter("instance", *names)
    newest: dict[Any, int] = {}
    late: defaultdict[Any, list[Any]] = defaultdict(list)
    in_time = []
    for message in messages:
        source = stream(message)
        if message.seq < newest.get(source, 0):
            late[source].append(message)
        else:
            newest[source] = message.seq
            in_time.append((source, message))
    for waiting in late.values():
        waiting.sort(key=attrgetter("seq"), reverse=True)
    for source, message in in_time:
        waiting = late.get(source, [])
        while waiting and waiting[-1].seq < message.seq:
            yield waiting.pop()
        yield message
