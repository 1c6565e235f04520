"""The clock of a mission: wall time that neither jumps nor runs back, unless a fault sets it."""

from __future__ import annotations

import time

from edc_swarm.errors import SwarmError
from edc_swarm.mission.autopilots import takeoff_s
from edc_swarm.mission.configuration import NS_PER_S
from edc_swarm.protocol.admission import SLACK_SLOTS
from edc_swarm.protocol.messages import MissionMessage

JUMP_NS = NS_PER_S // 2
"""Largest change of the wall clock between two checks that is no jump. NTP slews it by 0.5 ms in a second."""
MAX_REPORTED_JUMPS = 20
"""Most jumps that one process reports."""
UNSURE_NS = 50_000_000
"""Longest time between the readings of two clocks that can be compared; after more the process was frozen."""
FUTURE_NS = 10 * NS_PER_S
"""Longest time until slot 0. If it is longer, the clock of the host that began the mission is ahead of this one."""


class MissionClock:
    """Clock of epoch nanoseconds: the monotonic clock plus an offset to the wall clock that is read once.

        now_ns = monotonic_ns + ahead_ns

    An administrator or NTP may set the wall clock during a mission: slots, waits and the times of
    messages do not follow. All processes of a host share the monotonic clock, so the processes that a
    command starts take over its `ahead_ns` and agree whenever they start. The monotonic clock is
    CLOCK_MONOTONIC, which also times all waits. It stands still while a host is suspended; that host's
    UAVs are then behind the rest of the swarm.
    """

    def __init__(self, ahead_ns: int | None = None) -> None:
        while ahead_ns is None:
            ahead_ns = _wall_ahead_ns()
        self.ahead_ns = ahead_ns
        self._base_ns = time.monotonic_ns()
        self._shown_ns = self._base_ns + ahead_ns
        self._rate = 1.0
        self._wall_ahead_ns = ahead_ns
        self._jumps = 0

    def now_ns(self) -> int:
        """Return the epoch nanoseconds that this clock shows."""
        return self._shown_ns + round((time.monotonic_ns() - self._base_ns) * self._rate)

    def set_off(self, offset_ns: int, drift_ppm: float) -> None:
        """Set the clock `offset_ns` ahead of the true time and let it gain `drift_ppm` from now on (a fault)."""
        self._base_ns = time.monotonic_ns()
        self._shown_ns = self._base_ns + self.ahead_ns + offset_ns
        self._rate = 1.0 + drift_ppm * 1e-6

    def jump(self) -> str | None:
        """Return the detail of an event if the wall clock has jumped since the last call, or None."""
        ahead_ns = _wall_ahead_ns()
        if ahead_ns is None:
            return None
        by_ns = ahead_ns - self._wall_ahead_ns
        self._wall_ahead_ns = ahead_ns
        if abs(by_ns) <= JUMP_NS or self._jumps >= MAX_REPORTED_JUMPS:
            return None
        self._jumps += 1
        return f"the wall clock was set {'ahead' if by_ns > 0 else 'back'} by {abs(by_ns) / NS_PER_S:.3f} s"

    def check_epoch(self, mission: MissionMessage) -> None:
        """Raise `SwarmError` if this clock and the clock that began `mission` must differ."""
        since_ns = self.now_ns() - mission.epoch_ns
        late_ns = since_ns - (mission.max_slots + SLACK_SLOTS) * mission.slot_ns
        if since_ns < -FUTURE_NS - round(takeoff_s(mission) * NS_PER_S):
            raise SwarmError(
                f"cannot take part in mission {mission.name}: it begins in {-since_ns / NS_PER_S:.0f} s, "
                f"so the clock of this host is behind the operator's by about as much"
            )
        if late_ns > 0:
            raise SwarmError(
                f"cannot take part in mission {mission.name}: it began {since_ns / NS_PER_S:.0f} s ago, longer than "
                f"it can last, so the clock of this host is ahead of the operator's by "
                f"{late_ns / NS_PER_S:.0f} s or more"
            )


def _wall_ahead_ns() -> int | None:
    """Return wall time minus monotonic time, or None if the two readings are too far apart."""
    before_ns = time.monotonic_ns()
    wall_ns = time.time_ns()
    after_ns = time.monotonic_ns()
    return wall_ns - (before_ns + after_ns) // 2 if after_ns - before_ns < UNSURE_NS else None
