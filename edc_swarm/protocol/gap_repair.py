"""Repair of sequence gaps in the recorder's input: a state machine that reads no clock.

The recorder finds a gap when the next message on its key arrives, or when the event `closed` names a later
last number. It gathers the gaps of one moment, then asks their publisher to retransmit. After an answer it asks at
once for the rest; without an answer it backs off (`WAITS_S`). After `MAX_TRIES` failed attempts it asks again only
when the publisher shows another gap; the missing messages stay a gap. The recorder trusts no number: an unknown
sender that invents numbers opens a bounded number of gaps, and the recorder ignores messages that it did not ask for.
"""

from __future__ import annotations

import re
from collections.abc import Container, Mapping
from dataclasses import dataclass, field
from itertools import islice

from edc_swarm.mission.roles import RECORDER
from edc_swarm.protocol.keys import PREFIX, source_of
from edc_swarm.protocol.retransmission import Answer, Ask, Kept, Span

GATHER_S = 0.05
"""Time from a publisher's first gap to the request, so that one request covers messages lost together."""
WAITS_S = (0.25, 0.5, 1.0, 2.0, 2.0, 2.0, 2.0, 2.0)
"""Time to wait for the answer to each request before the next request."""
MAX_TRIES = len(WAITS_S)
MAX_AT_ONCE = 32
"""Most publishers with a request under way, and most requests in each `GATHER_S`, however fast the answers are."""
MAX_SPANS = 100
"""Most spans in one request."""
MAX_GAP = 20_000
"""Longest gap to repair; of a longer one only the end, since no publisher keeps more."""
MAX_GAPS = 50_000
"""Most gaps under repair; any further ones stay gaps."""
MAX_STREAMS = 200_000

Publisher = tuple[str, str]
"""Id of a publisher, and the instance of its process."""
_is_instance = re.compile(r"[A-Za-z0-9_-]{1,64}").fullmatch


@dataclass(slots=True)
class _Stream:
    """Messages of one instance on one key: the next number, the gaps, the hashes of the fetched ones."""

    publisher: _Asked
    expected: int = 0
    gaps: list[tuple[int, int]] = field(default_factory=list)
    fetched: dict[int, int] = field(default_factory=dict)

    def fill(self, seq: int) -> bool:
        """Remove `seq` from the gaps; return True if it was in one."""
        for i, (first, last) in enumerate(self.gaps):
            if first <= seq <= last:
                self.gaps[i : i + 1] = [s for s in ((first, seq - 1), (seq + 1, last)) if s[0] <= s[1]]
                return True
        return False


@dataclass(slots=True)
class _Asked:
    """A publisher, and the state of the requests to it."""

    name: Publisher
    streams: dict[str, _Stream] = field(default_factory=dict)
    tries: int = 0
    due_s: float = 0.0
    closed: bool = False

    def spans(self) -> list[Span]:
        """Return the first gaps."""
        gaps = (Span(key, *gap) for key, stream in self.streams.items() for gap in stream.gaps)
        return list(islice(gaps, MAX_SPANS))


class Gaps:
    """Gaps in the streams of one mission. Times are seconds of one clock; requests go to `known` publishers only."""

    def __init__(self, mission: str, known: Container[str]) -> None:
        self._root = f"{PREFIX}/{mission}/"
        self._known = known
        self._streams: dict[tuple[str, str], _Stream] = {}
        self._publishers: dict[Publisher, _Asked] = {}
        self._wanting: dict[Publisher, _Asked] = {}
        self._count = 0
        self._asked, self._asked_since_s = 0, 0.0

    def heard(self, key: str, instance: str, seq: int, payload: bytes, now_s: float) -> bool:
        """Process a message that came without a request; return False if it is a copy of one fetched before."""
        stream = self._stream(key, instance)
        if stream is None:
            return True
        if seq == stream.expected:
            stream.expected = seq + 1
        elif seq > stream.expected:
            self._open(stream, seq - 1, now_s)
            stream.expected = seq + 1
        elif not self._fill(stream, seq):
            return stream.fetched.get(seq) != hash(payload)
        return True

    def closed(self, source: str, instance: str, tails: Mapping[str, int], now_s: float) -> None:
        """Process the event `closed` of a publisher: the last number on each of its keys."""
        for tail, last in tails.items():
            key = tail if tail.startswith(self._root) else self._root + tail
            stream = self._stream(key, instance) if source_of(key) == source else None
            if stream is not None and last >= stream.expected:
                self._open(stream, last, now_s)
                stream.expected = last + 1
        publisher = self._publishers.get((source, instance))
        if publisher is not None:
            publisher.closed = True
            self._want(publisher, now_s)

    def due(self, now_s: float) -> list[tuple[Publisher, Ask]]:
        """Return the requests to send now; a closed publisher without gaps gets an empty one, so that it may end."""
        asks = []
        if now_s >= self._asked_since_s + GATHER_S:
            self._asked, self._asked_since_s = 0, now_s
        waited_for = sum(each.tries > 0 and each.due_s > now_s for each in self._wanting.values())
        for publisher in [each for each in self._wanting.values() if each.due_s <= now_s]:
            spans = publisher.spans()
            if not spans or publisher.tries == MAX_TRIES:
                del self._wanting[publisher.name]
                if spans or not publisher.closed:
                    continue
            elif publisher.name[0] not in self._known:
                continue
            elif max(waited_for, self._asked) >= MAX_AT_ONCE:
                publisher.due_s = now_s + GATHER_S
                continue
            else:
                publisher.due_s = now_s + WAITS_S[publisher.tries]
                publisher.tries += 1
                waited_for += 1
                self._asked += 1
            asks.append((publisher.name, Ask(spans)))
        return asks

    def answered(self, name: Publisher, answer: Answer, now_s: float) -> list[Kept]:
        """Process an answer; return its messages that were missing, to be recorded now."""
        publisher = self._publishers.get(name)
        if publisher is None:
            return []
        streams = publisher.streams
        taken = [kept for kept in answer.found if kept.key in streams and self._fill(streams[kept.key], kept.seq)]
        for kept in taken:
            streams[kept.key].fetched[kept.seq] = hash(kept.payload)
        given_up = [seq for key, seq in answer.gone if key in streams and self._fill(streams[key], seq)]
        if taken or given_up:
            publisher.tries, publisher.due_s = 0, now_s
        return taken

    @property
    def next_s(self) -> float | None:
        """Time at which the next request is due, or None."""
        return min((each.due_s for each in self._wanting.values() if each.name[0] in self._known), default=None)

    @property
    def outstanding(self) -> bool:
        """True if a known publisher may still fill a gap."""
        return any(each.name[0] in self._known and each.spans() for each in self._wanting.values())

    def _fill(self, stream: _Stream, seq: int) -> bool:
        before = len(stream.gaps)
        was_missing = stream.fill(seq)
        self._count += len(stream.gaps) - before
        return was_missing

    def _open(self, stream: _Stream, last: int, now_s: float) -> None:
        """Open the gap stream.expected..last."""
        if self._count < MAX_GAPS:
            self._count += 1
            stream.gaps.append((max(stream.expected, last - MAX_GAP + 1), last))
            self._want(stream.publisher, now_s)

    def _want(self, publisher: _Asked, now_s: float) -> None:
        """Schedule a request to the publisher: after the answer to one under way, at once if it is empty."""
        waiting = publisher.name in self._wanting and publisher.due_s > now_s
        publisher.tries = min(publisher.tries, 1) if waiting else 0
        if not waiting or not publisher.spans():
            publisher.due_s = now_s + (GATHER_S if publisher.spans() else 0.0)
        self._wanting[publisher.name] = publisher

    def _stream(self, key: str, instance: str) -> _Stream | None:
        """Return the stream, or None for a key or an instance that no publisher of a mission counts."""
        stream = self._streams.get((key, instance))
        if stream is None and len(self._streams) < MAX_STREAMS and _is_instance(instance):
            source = source_of(key)
            if source not in {"", RECORDER}:
                publisher = self._publishers.setdefault((source, instance), _Asked((source, instance)))
                stream = publisher.streams[key] = self._streams[key, instance] = _Stream(publisher)
        return stream
