"""What a process has to say, kept while it has no router."""

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
"""A loop that comes this much too late was frozen: its session may be dead without knowing it."""
DOUBT_S = 0.1
"""For this long nothing is said after a freeze, until a dead session has been noticed, and after a
router has come back, until the recorder, which is quicker to try again, is back too."""
MAX_ASKS = 8
"""Asks that wait to be answered."""
STAY_S = 1.0
"""After its last word a publisher stays for at most so long, to be asked for what has not arrived."""
STAY_RETRY_S = 0.02


class Outbox:
    """Puts messages on the bus in order; without a router they wait, so none is missing from the record.

    That they come late harms nobody: every receiver judges a message by its slot and term. What was
    handed to Zenoh and never arrived is asked for on `key`: queries come to `inbox`, from where its loop
    hands them to `hear`, and calls `answer` when it has the time.
    """

    def __init__(self, session: zenoh.Session, key: str, inbox: Inbox[Any], kept_bytes: int = KEPT_BYTES) -> None:
        self._session = session
        self._waiting: deque[Kept] = deque(maxlen=MAX_WAITING)
        self._ring = Ring(kept_bytes)
        self._key = key
        self._asks: deque[tuple[zenoh.Query, Ask]] = deque(maxlen=MAX_ASKS)
        self._said_any = self._released = False
        session.declare_queryable(key, hand_over(inbox.put))
        self._doubt_until_s = 0.0
        self._connected = True

    @property
    def holds_back(self) -> bool:
        """Whether messages are waiting."""
        return bool(self._waiting)

    def put(self, key: str, payload: bytes, seq: int, stamp: bytes = b"") -> None:
        """Say this after all that waits; what does not carry its number goes with a `stamp` that does."""
        self._said_any = True
        kept = Kept(key, seq, payload, stamp)
        self._ring.keep(kept)
        self._waiting.append(kept)

    def flush(self) -> None:
        """Send what waits if there is a router."""
        if self._waiting and self._may_speak():
            while self._waiting:
                said = self._waiting.popleft()
                put(self._session, said.key, said.payload, said.stamp)

    @property
    def is_asked(self) -> bool:
        """Whether an ask waits to be answered."""
        return bool(self._asks)

    def hear(self, query: zenoh.Query) -> bool:
        """Take in a query; whether it is about what was said here."""
        if str(query.key_expr) != self._key:
            return False
        with contextlib.suppress(msgspec.DecodeError):
            ask = decode_ask(query.payload.to_bytes() if query.payload is not None else b"")
            self._released |= not ask.wanted
            if ask.wanted:
                self._asks.append((query, ask))
        return True

    def answer(self) -> None:
        """Give one turn's worth of what was asked for."""
        if self._asks:
            query, ask = self._asks.popleft()
            query.reply(self._key, encode(self._ring.answer(ask)))
            query.drop()

    def stay(self, inbox: Inbox[Any]) -> None:
        """After the last word: answer until nothing more is wanted, or the time is over."""
        end_s = time.monotonic() + STAY_S
        while self._said_any and not self._released and (left_s := end_s - time.monotonic()) > 0:
            for item in inbox.wait(min(left_s, STAY_RETRY_S) if self._waiting else left_s):
                if isinstance(item, zenoh.Query) and self.hear(item):
                    self.answer()
            self.flush()

    def _may_speak(self) -> bool:
        connected = is_connected(self._session)
        if connected and not self._connected:
            self._doubt()
        self._connected = connected
        return connected and time.monotonic() >= self._doubt_until_s

    def note_delay(self, late_s: float) -> None:
        """Take into account that the loop came `late_s` too late."""
        if late_s > FROZEN_S:
            self._doubt()

    def _doubt(self) -> None:
        self._doubt_until_s = time.monotonic() + DOUBT_S
