"""The story of one UAV: its states from slot to slot, and the happenings that begin and end with them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Set
from dataclasses import dataclass, field
from typing import NamedTuple

from msgspec import UNSET

from edc_swarm.mission.field_types import Point
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.protocol.messages import Command, Fix, Report
from edc_swarm.story.happening import Happening, Kind, State
from edc_swarm.story.places import Why

UNHEARD_SLOTS = 2
"""Slots in a row without a fix after which a UAV counts as silent."""
NEVER_SLOTS = 6
"""The same for a UAV of which no fix has come yet."""
CUT_OFF_SLOTS = 3
"""Plans in a row that lack a fix which was sent, after which its UAV counts as cut off."""
HOLD_SLOTS = 4
"""Slots in a row away from the target without a step after which a UAV is told to hold."""
LONG_HOLD_SLOTS = 20
"""Slots after which a hold is news and no longer a detail."""
STEP_M = 1e-6
"""A shorter step is none."""


class Ended(NamedTuple):
    """What is known to have stopped a UAV, a fault or the end of its process.

    Attributes
    ----------
    kind, how
        The happening that it leads to, and its words.
    at_s, slot
        Mission time and slot, where they are known.
    mid_step
        True if it strikes in the next step after that.
    """

    kind: Kind
    how: str
    at_s: float = 0.0
    slot: int = -1
    mid_step: bool = False

    def begun(self, since: int) -> int:
        """Return the slot in which it stopped a UAV without a fix since slot `since`: it may have been just after one.

        What is further back stopped it for a time only, or without being the cause.
        """
        return self.slot if self.slot >= max(0, since if self.mid_step else since - 1) else since


@dataclass(slots=True)
class Uav:
    """The knowledge of one UAV as a slot is told.

    Attributes
    ----------
    ended
        What is known to have stopped it.
    other_slots
        Slots in a row in which it holds for another reason than the one that was told.
    span
        What it is in: silence, a hold and the like.
    """

    entry: RosterEntry
    fix: Fix | None = None
    state: State = "unknown"
    ended: Ended | None = None
    silent_slots: int = 0
    unheard_slots: int = 0
    held_slots: int = 0
    other_slots: int = 0
    span: Happening | None = None
    is_low: bool = False
    landed: bool = False
    expected: dict[str, int] = field(default_factory=dict)

    @property
    def uav(self) -> str:
        """The id."""
        return self.entry.uav

    @property
    def here_m(self) -> Point:
        """The newest known centre of its disc."""
        if self.fix is None:
            return self.entry.start_x_m, self.entry.start_y_m
        return self.fix.waypoint_x_m, self.fix.waypoint_y_m

    @property
    def aim_m(self) -> Point:
        """The point that it flies to."""
        if self.fix is not None and self.fix.course.fits(self.entry):
            return self.fix.course.left(self.entry)[0]
        return self.entry.points[0]

    @property
    def is_gone(self) -> bool:
        """True if nothing shows that it still flies."""
        return self.state in {"silent", "dead", "frozen"}

    def lacked(self, seqs: Mapping[str, Set[int]], *, from_first: bool) -> int:
        """Return how many fixes are missing before those of a slot with these numbers, by process; they are counted.

        `from_first`: a process is known from its first fix on, which has the number 0.
        """
        lacking = 0
        for instance, numbers in seqs.items():
            expected = self.expected.get(instance, 0 if from_first else min(numbers))
            newer = {number for number in numbers if number >= expected}
            if newer:
                lacking += max(newer) + 1 - expected - len(newer)
                self.expected[instance] = max(newer) + 1
        return lacking

    def is_silent(self) -> bool:
        """Count a slot without a fix; return True in the slot in which it is silent for long enough to say so."""
        self.silent_slots += 1
        return self.silent_slots == (UNHEARD_SLOTS if self.fix is not None else NEVER_SLOTS)

    def is_cut_off(self, plan: Report | None) -> bool:
        """Count a plan without the fix that it sent; return True while that goes on for long enough to say so."""
        if plan is not None:
            self.unheard_slots = self.unheard_slots + 1 if self.uav in plan.unheard else 0
        return self.unheard_slots >= CUT_OFF_SLOTS

    def is_held(self, fix: Fix, dt_s: float) -> bool:
        """Count a slot in which it stays away from its target; return True while it does so for long enough."""
        step_m = math.dist((fix.from_x_m, fix.from_y_m), (fix.waypoint_x_m, fix.waypoint_y_m))
        stays = not fix.arrived and not (fix.executing and step_m > STEP_M) and not self._hovers(fix, dt_s)
        self.held_slots = self.held_slots + 1 if stays else 0
        return self.held_slots >= HOLD_SLOTS

    def _hovers(self, fix: Fix, dt_s: float) -> bool:
        """Return True if it hovers at a point of its route, as that says."""
        if not fix.course.fits(self.entry) or not fix.course.hover_slots(self.entry, dt_s):
            return False
        return math.dist(fix.course.left(self.entry)[0], self.here_m) <= self.entry.accept_m


def why_not_flown(fix: Fix, command: Command | None, plan: Report | None) -> Why:
    """Return why a UAV flies nothing, from the command for its slot and the plan of the slot before."""
    if command is not None:
        return Why("not-flown", f"commands of {command.head} come too late, or are refused")
    if plan is None:
        return Why("no-command", "no command: no head plans")
    return Why("no-command", f"no command of head {plan.head}" + _lost(fix))


def _lost(fix: Fix) -> str:
    """Return why a UAV is commanded no more, to follow other words; "" for one that is."""
    if fix.voter:
        return ""
    return ": its memory was lost" if fix.stray_m is UNSET else ": it strays"
