"""The order of a recording: by the content of the messages, never by their place in the file.

Tools for MCAP files merge, sort and cut recordings, and the recorder writes retransmitted messages late. So this
module puts each kind of message into one total order, which is the same for every permutation of the file:

====  ==============================================================================
Rank  Key of the order
====  ==============================================================================
1     time: the slot (of fixes, truths, commands and reports), then `sent_ns`
2     the ids in the message's key, then the publisher's instance, then its `seq`
3     the rest of the content
====  ==============================================================================

The messages of one publisher stay in the order of `seq`. If its slots or its clock go back, each of its messages
counts with the greatest time among its messages up to that one. An exact duplicate (two equal messages of one
publisher) is dropped and counted; two different messages with the same `seq` both stay.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import groupby, islice, pairwise
from operator import attrgetter, lt
from typing import Any

import msgspec

from edc_swarm.protocol.keys import KEY_FORMS
from edc_swarm.protocol.messages import Event, Goal, MissionMessage


def in_order(messages: Sequence[Any], kind: type) -> list[Any]:
    """Return the messages of one kind, sorted by content and without exact duplicates."""
    names = KEY_FORMS[kind].fields
    time_names = ("sent_ns",) if kind in {Event, Goal, MissionMessage} else ("slot", "sent_ns")
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
    """Return `ordered` with each of several equal messages once, and different ones of one place by their bytes."""
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
    """Return True if the sequence numbers of every stream only grow."""
    newest: dict[Any, int] = {}
    for source, seq in zip(map(stream, messages), map(attrgetter("seq"), messages), strict=True):
        if newest.get(source, -1) > seq:
            return False
        newest[source] = seq
    return True


def _by_latest_time(ordered: Sequence[Any], number: Callable[[Any], Any], stream: Callable[[Any], Any]) -> list[Any]:
    """Sort messages by the greatest time of their stream so far; one stream's messages stay in the order of `seq`."""
    streams: dict[Any, list[Any]] = {}
    for message in ordered:
        streams.setdefault(stream(message), []).append(message)
    placed = [entry for source in sorted(streams) for entry in _placed(source, streams[source], number)]
    placed.sort(key=lambda entry: entry[:3])
    return [message for *_, message in placed]


def _placed(source: Any, messages: list[Any], number: Callable[[Any], Any]) -> Iterator[tuple[Any, Any, int, Any]]:
    """Yield (greatest time so far, stream, place in the stream, message) for each message of one stream."""
    latest: tuple[Any, ...] = ()
    for place, message in enumerate(sorted(messages, key=number)):
        latest = tuple(map(max, latest, number(message)[1:])) if latest else number(message)[1:]
        yield latest, source, place, message
