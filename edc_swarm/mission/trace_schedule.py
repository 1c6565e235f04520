"""The way in which a link plays a trace: the place at each time, and the delay at each place.

A message has the delay of the newest row sent before it, so messages that are sent with the rows have exactly their
delays. A gap in the times of sending is a stall, which releases all messages when the row after it arrives, or a loss.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from random import Random

from edc_swarm.mission.link import Link
from edc_swarm.mission.trace import GAP_MEDIANS, Rows, median_step_us


@dataclass(frozen=True, slots=True)
class Schedule:
    """The rows of a trace, and where and how a link plays them.

    Attributes
    ----------
    first_us
        Place in the trace at which the mission begins.
    gap_us
        Time between two rows beyond which there is a gap.
    """

    rows: Rows
    link: Link
    first_us: int
    gap_us: int

    @classmethod
    def of(cls, rows: Rows, link: Link, seed: int, uav: str) -> Schedule:
        """Return the schedule of a UAV, whose place in the trace `seed` decides unless the link has no offset."""
        drawn = Random(f"{seed}/{uav}/trace").random() if link.trace_offset == "uav" else 0.0
        first_us = round(link.trace_start_ms * 1000) + int(drawn * rows.period_us)
        gap_us = round(link.trace_gap_ms * 1000) or GAP_MEDIANS * median_step_us(rows.at_us)
        return cls(rows, link, first_us, gap_us)

    def place_us(self, wall_us: int) -> tuple[int, int] | None:
        """Return round and place in the trace at a wall time since the mission's epoch; None after its end."""
        place_us = self.first_us + wall_us
        if self.link.trace_end == "stop" and place_us >= self.rows.period_us:
            return None
        return divmod(place_us, self.rows.period_us)

    def delay_us(self, place_us: int) -> int | None:
        """Return the delay of what is sent at a place in the trace; None if a gap loses it."""
        at_us, delay_us = self.rows.at_us, self.rows.delay_us
        row = bisect_right(at_us, place_us) - 1
        following_us = at_us[row + 1] if row + 1 < len(at_us) else self.rows.period_us
        if at_us[row] == place_us or following_us - at_us[row] <= self.gap_us:
            return delay_us[row]
        if self.link.trace_gap == "loss":
            return None
        return following_us - place_us + delay_us[(row + 1) % len(at_us)]

    def share_beyond(self, limit_us: float) -> float:
        """Return the share of time in which messages are lost or take longer than `limit_us`."""
        at_us, beyond_us = self.rows.at_us, 0.0
        for row, (from_us, delay_us) in enumerate(zip(at_us, self.rows.delay_us, strict=True)):
            until_us = at_us[row + 1] if row + 1 < len(at_us) else self.rows.period_us
            if until_us - from_us <= self.gap_us:
                beyond_us += (until_us - from_us) * (delay_us > limit_us)
            elif self.link.trace_gap == "loss":
                beyond_us += until_us - from_us
            else:
                after_us = until_us - from_us + self.rows.delay_us[(row + 1) % len(at_us)]
                beyond_us += min(max(after_us - limit_us, 0.0), until_us - from_us)
        return beyond_us / self.rows.period_us
