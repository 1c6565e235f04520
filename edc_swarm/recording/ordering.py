"""The order of a recording: by what messages say, never by where they stand in the file.

Tools for MCAP files merge, sort and cut recordings, and the recorder itself writes late what it had to
fetch. So each kind of message is put into one total order, which any permutation of the file gives again:

1. by time: the slot (of fixes, truths, commands and reports), then `sent_ns`;
2. at one time, by the ids in the key, then the publisher's instance, then its `seq`;
3. with all of that equal, by the rest of the content.

A publisher's own messages never leave the order of `seq`. Where its slots or its clock go back, each of its
messages counts at the latest time that the publisher had told up to there. An exact duplicate (two equal
messages of one publisher) is dropped and counted; messages that share a `seq` and differ both stay.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import groupby, islice, pairwise
from operator import attrgetter, lt
from typing import TYPE_CHECKING, Any

import msgspec

from edc_swarm.protocol.keys import KEY_FORMS
from edc_swarm.protocol.messages import Event, MissionMessage

if TYPE_CHECKING:
    from edc_swarm.recording.model import Recording

FETCHED = "fetched"
"""Fact of `run_end`: how many messages were asked for again, and had."""
MAX_DIGITS = 18
"""Digits of a count in `run_end`."""


def fetched_count(recording: Recording) -> int | None:
    """Return how many messages came late, since they had to be asked for again; None where `run_end` does not say."""
    told = (recording.run_end or {}).get(FETCHED, "")
    return int(told) if told.isdecimal() and len(told) <= MAX_DIGITS else None


def put_in_order(recording: Recording) -> None:
    """Order every kind of message by content; drop exact duplicates and count them in `recording.duplicates`."""
    for kind, messages in recording.lists().items():
        count = len(messages)
        messages[:] = _ordered(messages, kind, KEY_FORMS[kind].fields)
        recording.duplicates += count - len(messages)


def _ordered(messages: Sequence[Any], kind: type, names: tuple[str, ...]) -> list[Any]:
    time_names = ("sent_ns",) if kind in {Event, MissionMessage} else ("slot", "sent_ns")
    stream = attrgetter(*names, "instance")
    place = attrgetter(*time_names, *names, "instance", "seq")
    places = list(map(place, messages))
    if all(map(lt, places, islice(places, 1, None))):
        ordered = list(messages)  # the common case: a file in order, with nothing twice
    else:
        ordered = _without_duplicates(sorted(messages, key=place), place)
    if _follows_numbers(ordered, stream):
        return ordered
    return _by_latest_time(ordered, attrgetter("seq", *time_names), stream)


def _without_duplicates(ordered: list[Any], place: Callable[[Any], Any]) -> list[Any]:
    """Each of several equal messages once; those of one place that differ, in the order of their bytes."""
    if all(one.seq != other.seq or place(one) != place(other) for one, other in pairwise(ordered)):
        return ordered
    distinct: list[Any] = []
    for _, equals in groupby(ordered, key=place):
        first, *rest = equals
        if not rest:
            distinct.append(first)
        else:
            said = {msgspec.json.encode(message): message for message in (first, *rest)}
            distinct += [said[payload] for payload in sorted(said)]
    return distinct


def _follows_numbers(messages: Sequence[Any], stream: Callable[[Any], Any]) -> bool:
    """Whether the numbers of no stream go back."""
    newest: dict[Any, int] = {}
    for source, seq in zip(map(stream, messages), map(attrgetter("seq"), messages), strict=True):
        if newest.get(source, -1) > seq:
            return False
        newest[source] = seq
    return True


def _by_latest_time(ordered: Sequence[Any], number: Callable[[Any], Any], stream: Callable[[Any], Any]) -> list[Any]:
    """All messages by the latest time that their publisher had told, each publisher's by their numbers."""
    streams: dict[Any, list[Any]] = {}
    for message in ordered:
        streams.setdefault(stream(message), []).append(message)
    placed = [entry for source in sorted(streams) for entry in _placed(source, streams[source], number)]
    placed.sort(key=lambda entry: entry[:3])
    return [message for *_, message in placed]


def _placed(source: Any, messages: list[Any], number: Callable[[Any], Any]) -> Iterator[tuple[Any, Any, int, Any]]:
    """Latest time so far, stream, place in the stream, message."""
    latest: tuple[Any, ...] = ()
    for place, message in enumerate(sorted(messages, key=number)):
        latest = tuple(map(max, latest, number(message)[1:])) if latest else number(message)[1:]
        yield latest, source, place, message
