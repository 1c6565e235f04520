"""Routes: the points that a UAV still has to fly to, how a step advances in them, and where a plan aims.

A UAV flies to the points of its route one after another, and it alone decides that it has reached one. Its course is
part of its promise, so a restart keeps it, and of its fixes, so every head plans on from there. The UAV has reached a
point, but the last, as soon as a step that it flies comes within `accept_m` of it; if it is to hover there, after that
many slots within `accept_m`. A planner aims at the present point. Within one step of it, the aim lies beyond, towards
the next point, as far as the step still passes within `accept_m`: so a UAV does not stop at each point.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated

import msgspec
from msgspec import Meta, Struct

from edc_swarm.mission.field_types import MAX_GOAL_POINTS, MAX_ROUTE, Point
from edc_swarm.mission.roster_entry import ARRIVED_M, RosterEntry

GoalNumber = Annotated[int, Meta(ge=0, lt=1 << 40)]

PASS_SHARE = 0.9
"""Share of `accept_m` within which an aim beyond a point passes it: the slot QP may shift the step a little."""
AIM_HALVINGS = 20


class Course(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Number of the goal that a UAV flies (0: the route of the roster), and its place in it.

    `leg` is the number of points reached, `hovered` the slots spent at the present one. `route` has the points of a
    later goal that are still to fly to; it is empty for goal 0, whose points are the roster's.
    """

    goal: GoalNumber = 0
    leg: Annotated[int, Meta(ge=0, le=MAX_ROUTE)] = 0
    hovered: Annotated[int, Meta(ge=0, lt=1 << 53)] = 0
    route: Annotated[list[Point], Meta(max_length=MAX_GOAL_POINTS)] = []

    def fits(self, entry: RosterEntry) -> bool:
        """Return True if this is a place in a route of this UAV."""
        return bool(self.route) if self.goal else not self.route and self.leg < len(entry.points)

    def left(self, entry: RosterEntry) -> list[Point]:
        """Return the points still to fly to, the present one first."""
        return self.route if self.goal else entry.points[self.leg :]

    def hover_slots(self, entry: RosterEntry, dt_s: float) -> int:
        """Return the slots that the UAV still hovers at the present point once it is there; 0 at the last point."""
        hovers_s = entry.hover_s if self.goal == 0 else []
        return max(0, math.ceil(hovers_s[self.leg] / dt_s) - self.hovered) if self.leg < len(hovers_s) - 1 else 0

    def arrived(self, entry: RosterEntry, here_m: Point) -> bool:
        """Return True if the UAV at `here_m` is at the last point, and has reached all others."""
        left = self.left(entry)
        return len(left) == 1 and math.dist(left[0], here_m) <= ARRIVED_M

    def after_step(self, entry: RosterEntry, from_m: Point, to_m: Point, slots: int, dt_s: float) -> Course:
        """Return the course after a step, with every point that it reaches; `slots` have passed since the last one."""
        course, left = self, self.left(entry)
        while len(left) > 1 and _away_m(left[0], from_m, to_m) <= entry.accept_m:
            hover_slots = course.hover_slots(entry, dt_s)
            if hover_slots:
                stays = math.dist(left[0], from_m) <= entry.accept_m and math.dist(left[0], to_m) <= entry.accept_m
                hovered = course.hovered + stays * min(slots, hover_slots)
                course = msgspec.structs.replace(course, hovered=hovered)
                if not stays or slots < hover_slots:
                    return course
            from_m = _nearest_m(left[0], from_m, to_m)
            course = Course(goal=course.goal, leg=course.leg + 1, route=course.route[1:])
            left = course.left(entry)
        return course

    def aim(self, entry: RosterEntry, here_m: Point, u_max_m: float, dt_s: float) -> tuple[Point, float]:
        """Return the point that a plan for the UAV at `here_m` aims at, and the length of the way beyond it, in metres.

        A slot of hovering counts as long as a slot of flight: a UAV that hovers as it shall is not late.
        """
        left = self.left(entry)
        if len(left) == 1:
            return left[0], 0.0
        hover_slots = self.hover_slots(entry, dt_s)
        beyond_m = left[0] if hover_slots else aim_m(here_m, left, entry.accept_m, u_max_m)
        rest_m = way_m([beyond_m, *left[1:]])
        return beyond_m, rest_m + hover_slots * u_max_m


def way_m(points: Sequence[Point]) -> float:
    """Return the length, in metres, of the straight lines through `points`."""
    return sum(math.dist(a, b) for a, b in pairwise(points))


def hover_time_s(entry: RosterEntry) -> float:
    """Return the seconds that a UAV hovers on its way."""
    return sum(entry.hover_s[:-1])


def rectangle_m(roster: Sequence[RosterEntry]) -> tuple[Point, Point]:
    """Return the lower left and the upper right corner of the smallest rectangle with all starts and points."""
    points = [point for entry in roster for point in ((entry.start_x_m, entry.start_y_m), *entry.points)]
    xs_m, ys_m = ([point[axis] for point in points] for axis in (0, 1))
    return (min(xs_m), min(ys_m)), (max(xs_m), max(ys_m))


def headed(entry: RosterEntry, point_m: Point) -> RosterEntry:
    """Return the UAV with `point_m` as its target, and nothing else to fly to."""
    return msgspec.structs.replace(entry, route=[], hover_s=[], target_x_m=point_m[0], target_y_m=point_m[1])


def aim_m(here_m: Point, left: Sequence[Point], accept_m: float, u_max_m: float) -> Point:
    """Return the point that a UAV at `here_m` aims at: the present point, or one beyond it towards the next.

    Within one step `u_max_m` of the present point P, the aim is the farthest point q on the line to the next one such
    that the step from here to q is no longer than `u_max_m` and passes P within `PASS_SHARE` accept_m.
    """
    present_m = left[0]
    spare_m = u_max_m - math.dist(here_m, present_m)
    if len(left) == 1 or spare_m <= 0:
        return present_m
    leg_m = math.dist(present_m, left[1])
    if leg_m == 0:
        return present_m
    low, high = 0.0, min(spare_m / leg_m, 1.0)
    if _passes(here_m, _between(present_m, left[1], high), present_m, accept_m):
        return _between(present_m, left[1], high)
    for _ in range(AIM_HALVINGS):
        middle = 0.5 * (low + high)
        if _passes(here_m, _between(present_m, left[1], middle), present_m, accept_m):
            low = middle
        else:
            high = middle
    return _between(present_m, left[1], low)


def _passes(from_m: Point, to_m: Point, point_m: Point, accept_m: float) -> bool:
    return _away_m(point_m, from_m, to_m) <= PASS_SHARE * accept_m


def _away_m(point_m: Point, a_m: Point, b_m: Point) -> float:
    """Return the distance of a point from the segment a-b."""
    return math.dist(point_m, _nearest_m(point_m, a_m, b_m))


def _nearest_m(point_m: Point, a_m: Point, b_m: Point) -> Point:
    """Return the point of the segment a-b nearest to `point_m`."""
    dx_m, dy_m = b_m[0] - a_m[0], b_m[1] - a_m[1]
    squared = dx_m * dx_m + dy_m * dy_m
    share = ((point_m[0] - a_m[0]) * dx_m + (point_m[1] - a_m[1]) * dy_m) / squared if squared > 0 else 0.0
    return _between(a_m, b_m, min(1.0, max(0.0, share)))


def _between(a_m: Point, b_m: Point, share: float) -> Point:
    return (a_m[0] + share * (b_m[0] - a_m[0]), a_m[1] + share * (b_m[1] - a_m[1]))
