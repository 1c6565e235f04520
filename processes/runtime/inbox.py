"""A bounded queue between the threads and callbacks that produce items and the one loop that works on them."""

from __future__ import annotations

import queue
import time
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
    """

    def __init__(self, limit: int = LIMIT, limit_bytes: int = LIMIT_BYTES) -> None:
        self._queue: queue.SimpleQueue[tuple[Item, int]] = queue.SimpleQueue()
        self._limit = limit
        self._limit_bytes = limit_bytes
        self._taken_in_bytes = self._handed_out_bytes = 0
        self.dropped = 0

    def put(self, item: Item, size_bytes: int = 0) -> None:
        """Add `item`; if the inbox is full, count and drop it."""
        held_bytes = self._taken_in_bytes - self._handed_out_bytes
        if self._queue.qsize() >= self._limit or held_bytes + size_bytes > self._limit_bytes:
            self.dropped += 1
        else:
            self._taken_in_bytes += size_bytes
            self._queue.put((item, size_bytes))

    def put_always(self, item: Item) -> None:
        """Add one of the few items that must not be lost, such as the order to stop."""
        self._queue.put((item, 0))

    def __len__(self) -> int:
        """Return the number of items that wait."""
        return self._queue.qsize()

    def wait(self, timeout_s: float | None, settle_s: float = 0.0) -> list[Item]:
        """Wait for the next items and return at most `BATCH` of them, none if the time is over.

        `settle_s`: time to wait for more items after the first one.
        """
        items: list[Item] = []
        try:
            items.append(self._next(block=True, timeout_s=timeout_s))
            if settle_s and self._queue.qsize() < BATCH:
                time.sleep(settle_s)
            while len(items) < BATCH:
                items.append(self._next(block=False))
        except queue.Empty:
            pass
        return items

    def _next(self, *, block: bool, timeout_s: float | None = None) -> Item:
        item, size_bytes = self._queue.get(block, None if timeout_s is None else max(0.0, timeout_s))
        self._handed_out_bytes += size_bytes
        return item
