"""Voyages: the goals and the points of routes that each UAV flew to, as its fixes tell them.

A UAV's course (`mission.routes`) is part of every fix, so nothing here depends on who gave a goal, or on the record of
that. The length of a way through points counts from point to point, and from where the UAV was when a goal ended.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray

from edc_swarm.analysis.tracks import Tracks
from edc_swarm.mission.field_types import Point
from edc_swarm.mission.roster_entry import ARRIVED_M, RosterEntry
from edc_swarm.mission.routes import Course, headed, way_m
from edc_swarm.protocol.messages import Fix, roster_index
from edc_swarm.recording.model import Recording

Floats = NDArray[np.float64]


@dataclass(slots=True)
class Voyage:
    """One UAV's way, up to its newest fix.

    Attributes
    ----------
    course
        Its newest course.
    since_slot, from_m
        Slot and place in which it began its newest goal.
    passed_m, at_m
        Length of the way through the points reached and the places where goals ended, and the last of them.
    reached_slots
        Slots in which it had reached its target and begun another goal.
    """

    entry: RosterEntry
    course: Course
    since_slot: int
    from_m: Point
    passed_m: float
    at_m: Point
    reached_slots: list[int]

    @classmethod
    def of(cls, entry: RosterEntry) -> Voyage:
        """Return the voyage of a UAV that has not begun."""
        start_m = (entry.start_x_m, entry.start_y_m)
        return cls(entry, Course(), 0, start_m, 0.0, start_m, [])

    @property
    def left(self) -> list[Point]:
        """Points still to fly to, the present one first."""
        return self.course.left(self.entry)

    @property
    def straight_m(self) -> float:
        """Length of the way through all points, those still to fly to included."""
        return self.passed_m + way_m([self.at_m, *self.left])

    def ended_m(self, end_m: Point) -> float:
        """Return the length of the way through the points reached, up to `end_m`."""
        return self.passed_m + math.dist(self.at_m, end_m)

    @property
    def now(self) -> RosterEntry:
        """The UAV with its newest goal as its route, from where it began it."""
        if not self.course.goal:
            return self.entry
        begun = msgspec.structs.replace(headed(self.entry, self.left[-1]), start_x_m=self.from_m[0])
        return msgspec.structs.replace(begun, start_y_m=self.from_m[1], route=self.left)

    @property
    def present(self) -> RosterEntry:
        """The UAV with the point that it flies to as its target."""
        return headed(self.entry, self.left[0])

    def hear(self, fix: Fix) -> None:
        """Follow the course of a newer fix."""
        here_m, course = (fix.waypoint_x_m, fix.waypoint_y_m), fix.course
        if course.goal == self.course.goal:
            points = self.left[: max(0, course.leg - self.course.leg)]
        else:
            points = [here_m]
            if len(self.left) == 1 and math.dist(self.left[0], here_m) <= ARRIVED_M:
                self.reached_slots.append(fix.slot)
            self.since_slot, self.from_m = fix.slot, here_m
        self.passed_m += way_m([self.at_m, *points])
        self.at_m = points[-1] if points else self.at_m
        self.course = course


@dataclass(frozen=True, slots=True)
class Voyages:
    """The voyages of K UAVs in roster order, and (S + 1, K) flags: True where a UAV was not on its last leg."""

    each: list[Voyage]
    pending: NDArray[np.bool_]

    @property
    def target_m(self) -> Floats:
        """(K, 2) targets at the end."""
        return np.array([voyage.left[-1] for voyage in self.each]).reshape(-1, 2)


def voyages_of(recording: Recording, tracks: Tracks) -> Voyages:
    """Return the voyages of all UAVs."""
    roster = recording.mission.roster
    index, each = roster_index(roster), [Voyage.of(entry) for entry in roster]
    pending = np.zeros((tracks.slots + 1, len(roster)), bool)
    pending[:] = [len(entry.points) > 1 for entry in roster]
    for fix in recording.fixes:
        if not (fix.course.goal or fix.course.leg) or fix.uav not in index or fix.slot < 0:
            continue
        k = index[fix.uav]
        voyage = each[k]
        if fix.course != voyage.course and fix.course.fits(voyage.entry):
            if fix.course.goal != voyage.course.goal:
                pending[: fix.slot + 1, k] = True
            voyage.hear(fix)
            pending[fix.slot + 1 :, k] = len(voyage.left) > 1
    return Voyages(each, pending)


def forgotten(recording: Recording) -> list[tuple[Fix, Course]]:
    """Return the fixes whose course is behind that of an earlier slot, each with the earlier course; one of each UAV.

    A UAV persists its course before it tells it, so its goal and its place in it never go back.
    """
    newest: dict[str, tuple[int, Course]] = {}
    before: dict[str, Course] = {}
    found: dict[str, tuple[Fix, Course]] = {}
    for fix in recording.fixes:
        known_slot, known = newest.get(fix.uav, (-1, Course()))
        if not fix.voter or (fix.course == known and fix.slot == known_slot):
            continue
        if fix.slot > known_slot:
            before[fix.uav] = known
        earlier = before.get(fix.uav, Course())
        if _place(fix.course) < _place(earlier):
            found.setdefault(fix.uav, (fix, earlier))
        newest[fix.uav] = (fix.slot, max(fix.course, known, key=_place))
    return list(found.values())


def _place(course: Course) -> tuple[int, int]:
    return course.goal, course.leg
