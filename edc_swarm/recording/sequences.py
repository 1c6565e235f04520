"""Sequence gaps: the messages that are missing from a recording, or that it holds twice."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from operator import attrgetter

import msgspec

from edc_swarm.mission.roles import RECORDER
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.keys import KEY_FORMS, PREFIX, SCENES
from edc_swarm.protocol.messages import Event
from edc_swarm.recording.model import DROPPED, Recording

Stream = tuple[str, str]
"""Key without its prefix `swarm/{mission}/`, and instance of the publisher."""

_decode_tails = msgspec.json.Decoder(dict[str, int]).decode


@dataclass(frozen=True, slots=True)
class Gap:
    """Sequence numbers first..last of a stream that the recording lacks, or holds twice."""

    key: str
    instance: str
    first: int
    last: int
    duplicate: bool = False

    @property
    def count(self) -> int:
        """Number of messages."""
        return self.last - self.first + 1


def find_gaps(recording: Recording) -> list[Gap]:
    """Return every gap and every duplicate in the sequence numbers, sorted by stream."""
    tails = _tails(recording)
    silent = {stream: _counted(recording, stream[0]) for stream in tails}
    seen: dict[Stream, list[int]] = silent | sequence_numbers(recording)
    gaps: list[Gap] = []
    for (key, instance), numbers in sorted(seen.items()):
        end = tails.get((key, instance), -1) + 1
        gaps += (Gap(key, instance, *span) for span in _holes(numbers, end))
        gaps += (Gap(key, instance, n, n, duplicate=True) for n in _repeated(numbers))
    return gaps


def unknown_tails(recording: Recording) -> list[Stream]:
    """Return the streams whose last sequence number is unknown, because no `closed` event states it.

    The recorder publishes none: it writes `run_end` after all of its own events. A recording that was torn and
    recovered has a `run_end` without the recorder's own counts.
    """
    unknown = sequence_numbers(recording).keys() - _tails(recording).keys() - _closing(recording)
    if DROPPED in (recording.run_end or {}):
        unknown = {stream for stream in unknown if stream[0] != f"event/{RECORDER}"}
    return sorted(unknown)


def sequence_numbers(recording: Recording) -> dict[Stream, list[int]]:
    """Return the sequence numbers of every stream in the order of the recording."""
    numbers: dict[Stream, list[int]] = {}
    for kind, messages in recording.lists().items():
        form = KEY_FORMS[kind]
        groups: defaultdict[tuple[str, ...], list[int]] = defaultdict(list)
        for source, seq in zip(map(form.stream, messages), map(attrgetter("seq"), messages), strict=True):
            groups[source].append(seq)
        numbers.update({(form.form.format(*ends), instance): seqs for (instance, *ends), seqs in groups.items()})
    return numbers


def _counted(recording: Recording, key: str) -> list[int]:
    """Return 0..n-1 for the n scenes recorded on `key`, since scenes carry no sequence number; else nothing."""
    return list(range(recording.unknown.get(f"/{key}", 0))) if key.startswith(f"{SCENES}/") else []


def _tails(recording: Recording) -> dict[Stream, int]:
    """Return the last sequence number of every stream that a `closed` event lists."""
    tails: dict[Stream, int] = {}
    for event in recording.events:
        if event.kind == EventKind.CLOSED:
            tails.update({(_relative(k), event.instance): last for k, last in tails_in(event).items()})
    return tails


def _closing(recording: Recording) -> set[Stream]:
    """Return the event streams that end with a `closed` event of their own."""
    return {(f"event/{event.source}", event.instance) for event in recording.events if event.kind == EventKind.CLOSED}


def tails_in(event: Event) -> dict[str, int]:
    """Return the last sequence number of each key that a `closed` event lists; empty if its detail is invalid."""
    try:
        return _decode_tails(event.detail)
    except msgspec.DecodeError:
        return {}


def _relative(key: str) -> str:
    return key.split("/", 2)[2] if key.startswith(f"{PREFIX}/") and key.count("/") >= 2 else key


def _holes(numbers: list[int], end: int) -> Iterator[tuple[int, int]]:
    """Yield the missing spans (first, last) of 0..max(numbers, end - 1)."""
    expected = 0
    for number in sorted(set(numbers)):
        if number > expected:
            yield expected, number - 1
        expected = number + 1
    if end > expected:
        yield expected, end - 1


def _repeated(numbers: list[int]) -> list[int]:
    if len(set(numbers)) == len(numbers):
        return []
    return sorted({n for n in numbers if numbers.count(n) > 1})
