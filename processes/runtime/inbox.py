"""A bounded queue between the threads and callbacks that produce items and the one loop that works on them."""

from __future__ import annotations

import queue
import time
from collections import deque
from typing import Generic, TypeVar

Item = TypeVar("Item")

LIMIT = 100_000
LIMIT_BYTES = 256 << 20
BATCH = 256
SETTLE_S = 0.01
"""Time in which an observer lets a burst gather: each wake-up at a slot's start takes processor time from a UAV."""


class Inbox(Generic[Item]):
    """Queue of items from callbacks, threads and signal handlers; it never blocks them.

    It uses a `SimpleQueue`, whose `put` is reentrant: a signal handler may interrupt it. `put` checks
    the bounds first, so each thread can exceed them by one item.

    Attributes
    ----------
    dropped
        Number of items that found the inbox full.
    quiet_until_s
        Monotonic time until which the items of `put_quietly` wake nobody.
    """

    def __init__(self, limit: int = LIMIT, limit_bytes: int = LIMIT_BYTES) -> None:
        self._queue: queue.SimpleQueue[tuple[Item, int]] = queue.SimpleQueue()
        self._quiet: deque[tuple[Item, int]] = deque()
        self.quiet_until_s = 0.0
        self._limit = limit
        self._limit_bytes = limit_bytes
        self._taken_in_bytes = self._handed_out_bytes = 0
        self.dropped = 0

    def put(self, item: Item, size_bytes: int = 0) -> None:
        """Add `item`; if the inbox is full, count and drop it."""
        if self._has_room(size_bytes):
            self._queue.put((item, size_bytes))

    def put_quietly(self, item: Item, size_bytes: int = 0) -> None:
        """Add `item`, and wake the loop only after `quiet_until_s`: until then the item waits for the next wake-up."""
        if time.monotonic() >= self.quiet_until_s:
            self.put(item, size_bytes)
        elif self._has_room(size_bytes):
            self._quiet.append((item, size_bytes))

    def _has_room(self, size_bytes: int) -> bool:
        held_bytes = self._taken_in_bytes - self._handed_out_bytes
        if len(self) >= self._limit or held_bytes + size_bytes > self._limit_bytes:
            self.dropped += 1
            return False
        self._taken_in_bytes += size_bytes
        return True

    def put_always(self, item: Item) -> None:
        """Add one of the few items that must not be lost, such as the order to stop."""
        self._queue.put((item, 0))

    def __len__(self) -> int:
        """Return the number of items that wait."""
        return self._queue.qsize() + len(self._quiet)

    def wait(self, timeout_s: float | None, settle_s: float = 0.0) -> list[Item]:
        """Wait for the next items and return at most `BATCH` of them, none if the time is over.

        `settle_s`: time to wait for more items after the first one.
        """
        items: list[Item] = []
        try:
            first = self._queue.get(timeout=None if timeout_s is None else max(0.0, timeout_s))
            self._hand_quiet(items)
            self._hand(first, items)
            if settle_s and self._queue.qsize() < BATCH:
                time.sleep(settle_s)
            while len(items) < BATCH:
                self._hand(self._queue.get(block=False), items)
        except queue.Empty:
            self._hand_quiet(items)
        return items

    def _hand_quiet(self, items: list[Item]) -> None:
        """Hand out what came quietly, before what came after it; from now on such items wake the loop."""
        self.quiet_until_s = 0.0
        while self._quiet and len(items) < BATCH:
            self._hand(self._quiet.popleft(), items)

    def _hand(self, sized: tuple[Item, int], items: list[Item]) -> None:
        item, size_bytes = sized
        self._handed_out_bytes += size_bytes
        items.append(item)
