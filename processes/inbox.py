"""A bounded queue between whoever hands over and the one loop that works."""

from __future__ import annotations

import queue
from typing import Generic, TypeVar

Item = TypeVar("Item")

LIMIT = 100_000
BATCH = 256


class Inbox(Generic[Item]):
    """Takes items from callbacks, threads and signal handlers; never blocks them.

    A `SimpleQueue` underneath: its `put` may interrupt itself, which a signal handler does. The
    bound is checked before the put, so it can be exceeded by as many items as there are threads.
    """

    def __init__(self, limit: int = LIMIT) -> None:
        self._queue: queue.SimpleQueue[Item] = queue.SimpleQueue()
        self._limit = limit
        self.dropped = 0

    def put(self, item: Item) -> None:
        """Hand over `item`; counted and dropped when full."""
        if self._queue.qsize() >= self._limit:
            self.dropped += 1
        else:
            self._queue.put(item)

    def put_always(self, item: Item) -> None:
        """Hand over one of the few items that must not be lost, such as the order to stop."""
        self._queue.put(item)

    def wait(self, timeout_s: float | None) -> list[Item]:
        """Wait for the next items, at most `BATCH`; none when the time is over."""
        items: list[Item] = []
        try:
            items.append(self._queue.get(timeout=None if timeout_s is None else max(0.0, timeout_s)))
            while len(items) < BATCH:
                items.append(self._queue.get_nowait())
        except queue.Empty:
            pass
        return items
