"""Retransmission: request and answer on the bus, and the ring of messages that a publisher keeps.

A receiver with sequence gaps sends the publisher an `Ask` and gets an `Answer`, both msgpack. An answer
is bounded, so that a publisher with more urgent work answers in small parts; the receiver sends a further request
for the rest. An empty request says that the receiver needs nothing more.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from itertools import islice

import msgspec
from msgspec import Struct

KEPT_BYTES = 5 << 20
"""Memory for kept messages, with overhead: a minute of a head of 50 UAVs that commands twice a second."""
OVERHEAD_BYTES = 300
"""Python's memory for a kept message, in addition to its payload."""
TURN_NUMBERS = 256
TURN_BYTES = 1 << 16
"""Limits of one answer: the numbers that it looks up, and the bytes that it holds (but for a single message)."""

Number = tuple[str, int]
"""Key and sequence number, which identify a message of one instance."""


class Span(Struct, frozen=True, array_like=True):
    """The messages first..last on a key."""

    key: str
    first: int
    last: int


class Kept(Struct, frozen=True, array_like=True):
    """A message as published; `stamp` is its attachment if the payload does not carry the number."""

    key: str
    seq: int
    payload: bytes
    stamp: bytes = b""


class Ask(Struct, frozen=True):
    """Request for the missing messages of one publisher."""

    wanted: list[Span]


class Answer(Struct, frozen=True):
    """Answer: the messages found, and the numbers no longer kept; a further request may ask for the rest."""

    found: list[Kept]
    gone: list[Number]


class Ring:
    """Ring of a publisher's last messages, as many as fit into `limit_bytes`."""

    def __init__(self, limit_bytes: int = KEPT_BYTES) -> None:
        self._limit_bytes = limit_bytes
        self._order: deque[Kept] = deque()
        self._kept: dict[Number, Kept] = {}
        self._held_bytes = 0

    def keep(self, kept: Kept) -> None:
        """Keep a message and drop the oldest ones that no longer fit; a publisher never uses a number twice."""
        self._order.append(kept)
        self._kept[kept.key, kept.seq] = kept
        self._held_bytes += _held_bytes(kept)
        while self._held_bytes > self._limit_bytes:
            oldest = self._order.popleft()
            del self._kept[oldest.key, oldest.seq]
            self._held_bytes -= _held_bytes(oldest)

    def answer(self, ask: Ask) -> Answer:
        """Return an answer to the first part of the request, within the limits of one answer."""
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
