"""A channel that the senders of a link rule share on their way to one receiver: a queue, first in, first out.

The queue drops a message that does not fit (drop tail). It is emptied at a constant rate, or whenever a trace of
delivery opportunities lets 1500 bytes pass: of the same message or of several, as in Mahimahi (`man mm-link`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from bisect import bisect_left
from collections import deque

from edc_swarm.mission.trace import MTU_BYTES
from edc_swarm.mission.trace_schedule import Schedule


class Channel(ABC):
    """A queue of `queue_bytes` and what empties it; times are wall nanoseconds since the mission's epoch."""

    def __init__(self, queue_bytes: int) -> None:
        self._queue_bytes = queue_bytes
        self._waiting: deque[tuple[int, int]] = deque()
        self._held_bytes = 0

    def wait_ns(self, now_ns: int, size_bytes: int) -> int | None:
        """Return how long a message that comes at `now_ns` takes until it has left; None if it is dropped."""
        while self._waiting and self._waiting[0][0] <= now_ns:
            self._held_bytes -= self._waiting.popleft()[1]
        if self._held_bytes + size_bytes > self._queue_bytes:
            return None
        left_ns = self._serve_ns(now_ns, size_bytes)
        if left_ns is None:
            return None
        self._waiting.append((left_ns, size_bytes))
        self._held_bytes += size_bytes
        return left_ns - now_ns

    @abstractmethod
    def _serve_ns(self, now_ns: int, size_bytes: int) -> int | None:
        """Serve a message after those before it; return when it has left, None if it never does."""


class RateChannel(Channel):
    """A channel of a constant rate."""

    def __init__(self, queue_bytes: int, rate_kbps: float) -> None:
        super().__init__(queue_bytes)
        self._rate_kbps = rate_kbps
        self._free_ns = 0

    def _serve_ns(self, now_ns: int, size_bytes: int) -> int:
        self._free_ns = max(self._free_ns, now_ns) + round(8e6 * size_bytes / self._rate_kbps)
        return self._free_ns


class OpportunityChannel(Channel):
    """A channel that a trace of delivery opportunities empties."""

    def __init__(self, queue_bytes: int, schedule: Schedule) -> None:
        super().__init__(queue_bytes)
        self._schedule = schedule
        self._round, self._row, self._left_bytes = 0, 0, MTU_BYTES

    def _serve_ns(self, now_ns: int, size_bytes: int) -> int | None:
        if not self._go_to(-(-now_ns // 1000)):
            return None if self._schedule.place_us(now_ns // 1000) is not None else now_ns
        while size_bytes > self._left_bytes:
            size_bytes -= self._left_bytes
            if not self._advance():
                return None
        self._left_bytes -= size_bytes
        return max(now_ns, 1000 * self._at_us)

    @property
    def _at_us(self) -> int:
        """Time of the present opportunity since the mission's epoch."""
        rows = self._schedule.rows
        return self._round * rows.period_us + rows.at_us[self._row] - self._schedule.first_us

    def _go_to(self, wall_us: int) -> bool:
        """Go to the first opportunity at `wall_us` or later, if the present one is earlier; False after the end."""
        if self._at_us >= wall_us:
            return True
        rows, place = self._schedule.rows, self._schedule.place_us(wall_us)
        if place is None:
            return False
        self._round, self._row = place[0], bisect_left(rows.at_us, place[1])
        self._left_bytes = MTU_BYTES
        return self._row < len(rows.at_us) or self._wrap()

    def _advance(self) -> bool:
        """Go to the next opportunity; return False after the last one of a trace that stops."""
        self._row, self._left_bytes = self._row + 1, MTU_BYTES
        return self._row < len(self._schedule.rows.at_us) or self._wrap()

    def _wrap(self) -> bool:
        if self._schedule.link.trace_end == "stop":
            return False
        self._round, self._row = self._round + 1, 0
        return True
