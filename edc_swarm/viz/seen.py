"""What a view knows of one UAV: its newest messages and its trail, and where these put it."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.protocol.messages import Command, Fix, Truth
from edc_swarm.viz.shapes import Point

MAX_TRAIL = 16


@dataclass(slots=True)
class Seen:
    """The newest state of one UAV, with its trail."""

    entry: RosterEntry
    index: int
    fix: Fix | None = None
    truth: Truth | None = None
    command: Command | None = None
    trail: deque[tuple[int, Point]] = field(default_factory=lambda: deque(maxlen=MAX_TRAIL))

    @property
    def left(self) -> list[Point]:
        """Points that it has still to fly to, the present one first."""
        fix = self.fix
        return fix.course.left(self.entry) if fix is not None and fix.course.fits(self.entry) else self.entry.points

    @property
    def battery_pct(self) -> float | None:
        """Its battery in per cent of the first charge, None if it is unknown."""
        return None if self.fix is None or not self.entry.energy_j else 100 * self.fix.energy_j / self.entry.energy_j

    def hear(self, message: Fix | Truth | Command) -> None:
        """Keep a message unless a newer one is known."""
        match message:
            case Fix() if message.voter and (self.fix is None or message.slot >= self.fix.slot):
                self.fix = message
            case Truth() if self.truth is None or message.slot >= self.truth.slot:
                self.truth = message
            case Command():
                known = self.command
                if known is None or (message.slot, message.term) >= (known.slot, known.term):
                    self.command = message

    def leave_trail(self, now_ns: int, centre: Point) -> None:
        """Add a point to the trail; a hold adds only one."""
        if self.trail and self.trail[-1][1] == centre:
            self.trail.pop()
        self.trail.append((now_ns, centre))


def heading_rad(truth: Truth) -> float:
    """Return the direction in which a vehicle flies, 0 (east) if it does not move."""
    return math.atan2(truth.to_y_m - truth.from_y_m, truth.to_x_m - truth.from_x_m)
