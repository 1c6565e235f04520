"""Wall time that neither jumps nor runs back, unless a fault says so."""

from __future__ import annotations

import time


class WallClock:
    """Wall nanoseconds, read from the monotonic clock and anchored once at the start.

    An administrator or NTP may set the system's clock during a mission; slots do not jump.
    """

    def __init__(self) -> None:
        self._base_ns = time.monotonic_ns()
        self._wall_ns = time.time_ns()
        self._rate = 1.0
        self._true_ahead_ns = self._wall_ns - self._base_ns

    def now_ns(self) -> int:
        """What this clock shows."""
        return self._wall_ns + round((time.monotonic_ns() - self._base_ns) * self._rate)

    def set_off(self, offset_ns: int, drift_ppm: float) -> None:
        """From now on be `offset_ns` ahead of the true time and gain `drift_ppm` (a fault)."""
        self._base_ns = time.monotonic_ns()
        self._wall_ns = self._base_ns + self._true_ahead_ns + offset_ns
        self._rate = 1.0 + drift_ppm * 1e-6
