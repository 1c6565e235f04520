"""The clock of a mission: wall time that neither jumps nor runs back, unless a fault says so."""

from __future__ import annotations

import time

from edc_swarm.errors import SwarmError
from edc_swarm.mission.configuration import NS_PER_S
from edc_swarm.protocol.admission import SLACK_SLOTS
from edc_swarm.protocol.messages import MissionMessage

JUMP_NS = NS_PER_S // 2
"""A wall clock that moves by more between two looks has jumped; NTP otherwise slews it, by 0.5 ms in a second."""
MOST_JUMPS_TOLD = 20
"""One process tells of so many jumps."""
UNSURE_NS = 50_000_000
"""Two clocks that were read so far apart cannot be compared: the process was frozen in between."""
FUTURE_NS = 10 * NS_PER_S
"""A mission whose slot 0 is further in the future was begun by a host whose clock is ahead of this one's."""


class MissionClock:
    """Epoch nanoseconds, read from the monotonic clock and anchored to the wall clock once.

    An administrator or NTP may set the wall clock during a mission: slots, waits and the times of
    messages do not follow. The monotonic clock is the same in all processes of a host since it
    started, so those that a command starts take over its anchor, `ahead_ns`, and agree whenever they
    start. It is CLOCK_MONOTONIC, by which all waits go too: while a host is suspended it stands still,
    and to the rest of the swarm that host's UAVs are then behind.
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
        """Return what this clock shows."""
        return self._shown_ns + round((time.monotonic_ns() - self._base_ns) * self._rate)

    def set_off(self, offset_ns: int, drift_ppm: float) -> None:
        """From now on be `offset_ns` ahead of the true time and gain `drift_ppm` (a fault)."""
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
        if abs(by_ns) <= JUMP_NS or self._jumps >= MOST_JUMPS_TOLD:
            return None
        self._jumps += 1
        return f"the wall clock was set {'ahead' if by_ns > 0 else 'back'} by {abs(by_ns) / NS_PER_S:.3f} s"

    def check_epoch(self, mission: MissionMessage) -> None:
        """Raise `SwarmError` where this clock and the one by which `mission` began must differ."""
        since_ns = self.now_ns() - mission.epoch_ns
        late_ns = since_ns - (mission.max_slots + SLACK_SLOTS) * mission.slot_ns
        if since_ns < -FUTURE_NS:
            raise SwarmError(
                f"cannot take part in mission {mission.name}: it begins in {-since_ns / NS_PER_S:.0f} s, "
                f"so the clock of this host is behind that of the operator's by about as much"
            )
        if late_ns > 0:
            raise SwarmError(
                f"cannot take part in mission {mission.name}: it began {since_ns / NS_PER_S:.0f} s ago, longer than "
                f"it can last, so the clock of this host is ahead of that of the operator's by "
                f"{late_ns / NS_PER_S:.0f} s or more"
            )


def _wall_ahead_ns() -> int | None:
    """Wall time minus monotonic time, or None when both could not be read at once."""
    before_ns = time.monotonic_ns()
    wall_ns = time.time_ns()
    after_ns = time.monotonic_ns()
    return wall_ns - (before_ns + after_ns) // 2 if after_ns - before_ns < UNSURE_NS else None
