"""Playback of a measured network: the delays that a trace gives to what one UAV sends, one after another."""

from __future__ import annotations

from edc_swarm.mission.trace_schedule import Schedule


class Playback:
    """The messages of one sender on their way through a schedule, none of which overtakes another after a stall."""

    def __init__(self, schedule: Schedule) -> None:
        self._schedule = schedule
        self._last_us = 0

    def delay_us(self, wall_us: int) -> int | None:
        """Return the delay of a message sent at `wall_us` since the mission's epoch; None if it is lost."""
        place = self._schedule.place_us(wall_us)
        if place is None:
            return 0
        delay_us = self._schedule.delay_us(place[1])
        if delay_us is None:
            return None
        arrival_us = wall_us + delay_us
        if self._schedule.link.trace_gap == "stall":
            arrival_us = max(arrival_us, self._last_us)
        self._last_us = arrival_us
        return arrival_us - wall_us
