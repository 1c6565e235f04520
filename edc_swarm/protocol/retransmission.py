"""What was published and has not arrived, asked for again: the words for it, and what a publisher keeps.

Whoever lacks messages sends their publisher an `Ask` and gets an `Answer`, both msgpack. What an answer
holds is bounded, so that a publisher with more urgent work gives a little at a time; who wants more asks
again. An ask for nothing says that nothing is wanted any more.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from itertools import islice

import msgspec
from msgspec import Struct

KEPT_BYTES = 5 << 20
"""What a publisher keeps, overhead included: a minute of a head of 50 UAVs that commands twice a second."""
OVERHEAD_BYTES = 300
"""What Python takes to keep a message, beside its bytes."""
TURN_NUMBERS = 256
TURN_BYTES = 1 << 16
"""At most so many messages are looked for in one answer, and so much is given, but for a single one."""

Number = tuple[str, int]
"""Key and sequence number: one message of a publisher's life."""


class Span(Struct, frozen=True, array_like=True):
    """The messages first..last on a key."""

    key: str
    first: int
    last: int


class Kept(Struct, frozen=True, array_like=True):
    """A message as it was published; `stamp` came with one that does not carry its number itself."""

    key: str
    seq: int
    payload: bytes
    stamp: bytes = b""


class Ask(Struct, frozen=True):
    """What is missing of one publisher."""

    wanted: list[Span]


class Answer(Struct, frozen=True):
    """What there was of it, and what cannot be had any more; the rest is to be asked for again."""

    found: list[Kept]
    gone: list[Number]


class Ring:
    """A publisher's last messages, as many as fit into `limit_bytes`."""

    def __init__(self, limit_bytes: int = KEPT_BYTES) -> None:
        self._limit_bytes = limit_bytes
        self._order: deque[Kept] = deque()
        self._kept: dict[Number, Kept] = {}
        self._held_bytes = 0

    def keep(self, kept: Kept) -> None:
        """Keep a message and forget the oldest that no longer fit; a publisher never uses a number twice."""
        self._order.append(kept)
        self._kept[kept.key, kept.seq] = kept
        self._held_bytes += _held_bytes(kept)
        while self._held_bytes > self._limit_bytes:
            oldest = self._order.popleft()
            del self._kept[oldest.key, oldest.seq]
            self._held_bytes -= _held_bytes(oldest)

    def answer(self, ask: Ask) -> Answer:
        """What there is of the first messages asked for: no more than one turn may give."""
        answer, size = Answer([], []), 0
        for number in islice(_numbers(ask.wanted), TURN_NUMBERS):
            kept = self._kept.get(number)
            if kept is None:
                answer.gone.append(number)
                continue
            size += len(kept.payload)
            if answer.found and size > TURN_BYTES:
                break
            answer.found.append(kept)
        return answer


def _held_bytes(kept: Kept) -> int:
    return len(kept.payload) + len(kept.stamp) + OVERHEAD_BYTES


def _numbers(spans: Iterable[Span]) -> Iterator[Number]:
    for span in spans:
        for seq in range(span.first, span.last + 1):
            yield span.key, seq


encode = msgspec.msgpack.encode
decode_ask = msgspec.msgpack.Decoder(Ask).decode
decode_answer = msgspec.msgpack.Decoder(Answer).decode
