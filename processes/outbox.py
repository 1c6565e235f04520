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
"""For this long nothing is said after a freeze, until a dead session has been noticed, and after a
router has come back, until the recorder, which is quicker to try again, is back too."""


class Outbox:
    """Puts messages on the bus in order; without a router they wait, so none is missing from the record.

    That they come late harms nobody: every receiver judges a message by its slot and term. What was
    handed to Zenoh just before the router died is lost all the same, and shows as a gap.
    """

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._waiting: deque[tuple[str, bytes]] = deque(maxlen=LIMIT)
        self._doubt_until_s = 0.0
        self._connected = True

    @property
    def holds_back(self) -> bool:
        """Whether messages are waiting."""
        return bool(self._waiting)

    def put(self, key: str, payload: bytes) -> None:
        """Say this after all that waits."""
        self._waiting.append((key, payload))

    def flush(self) -> None:
        """Send what waits if there is a router."""
        if self._waiting and self._may_speak():
            while self._waiting:
                put(self._session, *self._waiting.popleft())

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
