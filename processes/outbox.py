"""What a process has to say, kept while it has no router."""

from __future__ import annotations

import time
from collections import deque

import zenoh

from processes.bus import is_connected, put

LIMIT = 20_000
FROZEN_S = 0.3
"""A loop that comes this much too late was frozen: its session may be dead without knowing it."""
DOUBT_S = 0.1
"""For this long after a freeze nothing is said: by then a dead session has been noticed."""


class Outbox:
    """Puts messages on the bus in order; without a router they wait, so none is missing from the record.

    That they come late harms nobody: every receiver judges a message by its slot and term. What was
    handed to Zenoh just before the router died is lost all the same, and shows as a gap.
    """

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._waiting: deque[tuple[str, bytes]] = deque(maxlen=LIMIT)
        self._doubt_until_s = 0.0

    @property
    def holds_back(self) -> bool:
        """Whether messages are waiting."""
        return bool(self._waiting)

    def put(self, key: str, payload: bytes) -> None:
        """Say this after all that waits."""
        self._waiting.append((key, payload))

    def flush(self) -> None:
        """Send what waits if there is a router."""
        if self._waiting and time.monotonic() >= self._doubt_until_s and is_connected(self._session):
            while self._waiting:
                put(self._session, *self._waiting.popleft())

    def doubt(self, late_s: float) -> None:
        """Take into account that the loop came `late_s` too late."""
        if late_s > FROZEN_S:
            self._doubt_until_s = time.monotonic() + DOUBT_S
