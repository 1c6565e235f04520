"""Outgoing messages of a process: buffered while it has no router, and retransmitted on request."""

from __future__ import annotations

import contextlib
import time
from collections import deque
from typing import Any

import msgspec
import zenoh

from edc_swarm.protocol.retransmission import KEPT_BYTES, Ask, Kept, Ring, decode_ask, encode
from processes.bus.session import hand_over, is_connected, put
from processes.runtime.inbox import Inbox

MAX_WAITING = 20_000
FROZEN_S = 0.3
"""Smallest delay of the loop that means a freeze: the session may then be dead before Zenoh notices it."""
DOUBT_S = 0.1
"""Pause of sending after a freeze, until Zenoh notices a dead session, and after the router's return,
until the recorder, which retries faster, is connected again."""
MAX_ASKS = 8
"""Most retransmission requests that wait for an answer."""
STAY_S = 1.0
"""Longest stay of a publisher after its last message, for retransmission requests."""
STAY_RETRY_S = 0.02


class Outbox:
    """Sends messages in order; without a router they wait, so that the recording lacks none.

    Late messages do no harm: every receiver judges a message by its slot and term. The recorder requests
    messages that got lost on `key`. Its queries go to `inbox`; the loop passes them to `hear` and calls
    `answer` when it has time.
    """

    def __init__(self, session: zenoh.Session, key: str, inbox: Inbox[Any], kept_bytes: int = KEPT_BYTES) -> None:
        self._session = session
        self._waiting: deque[Kept] = deque(maxlen=MAX_WAITING)
        self._ring = Ring(kept_bytes)
        self._key = key
        self._asks: deque[tuple[zenoh.Query, Ask]] = deque(maxlen=MAX_ASKS)
        self._sent_any = self._released = False
        session.declare_queryable(key, hand_over(inbox.put))
        self._doubt_until_s = 0.0
        self._connected = True

    @property
    def holds_back(self) -> bool:
        """True if messages are waiting for a router."""
        return bool(self._waiting)

    def put(self, key: str, payload: bytes, seq: int, stamp: bytes = b"") -> None:
        """Queue a message; a `stamp` carries the sequence number of a payload that has none."""
        self._sent_any = True
        kept = Kept(key, seq, payload, stamp)
        self._ring.keep(kept)
        self._waiting.append(kept)

    def flush(self) -> None:
        """Send the waiting messages if there is a router."""
        if self._waiting and self._may_send():
            while self._waiting:
                kept = self._waiting.popleft()
                put(self._session, kept.key, kept.payload, kept.stamp)

    @property
    def is_asked(self) -> bool:
        """True if a retransmission request waits for an answer."""
        return bool(self._asks)

    def hear(self, query: zenoh.Query) -> bool:
        """Take in a query; return True if it is for this outbox."""
        if str(query.key_expr) != self._key:
            return False
        with contextlib.suppress(msgspec.DecodeError):
            ask = decode_ask(query.payload.to_bytes() if query.payload is not None else b"")
            self._released |= not ask.wanted
            if ask.wanted:
                self._asks.append((query, ask))
        return True

    def answer(self) -> None:
        """Answer the oldest retransmission request with one message."""
        if self._asks:
            query, ask = self._asks.popleft()
            query.reply(self._key, encode(self._ring.answer(ask)))
            query.drop()

    def stay(self, inbox: Inbox[Any]) -> bool:
        """Answer requests after the last message for at most `STAY_S`; return True once the recorder wants no more."""
        end_s = time.monotonic() + STAY_S
        while self._sent_any and not self._released and (left_s := end_s - time.monotonic()) > 0:
            for item in inbox.wait(min(left_s, STAY_RETRY_S) if self._waiting else left_s):
                if isinstance(item, zenoh.Query) and self.hear(item):
                    self.answer()
            self.flush()
        return self._released

    def _may_send(self) -> bool:
        connected = is_connected(self._session)
        if connected and not self._connected:
            self._doubt()
        self._connected = connected
        return connected and time.monotonic() >= self._doubt_until_s

    def note_delay(self, late_s: float) -> None:
        """Pause sending if the loop came `late_s` too late, as after a freeze."""
        if late_s > FROZEN_S:
            self._doubt()

    def _doubt(self) -> None:
        self._doubt_until_s = time.monotonic() + DOUBT_S
