"""Reasons why a UAV that is commanded to stay does not fly: who is where its way leads."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from edc_swarm.mission.field_types import Point
from edc_swarm.protocol.messages import Report
from edc_swarm.story.happening import Reason

TOUCH_M = 0.1
"""A planner keeps a little more than the sum of two radii."""


@dataclass(frozen=True, slots=True)
class Place:
    """The place where the disc of a UAV is or can be: all points within `radius_m` of the segment a-b.

    `reach_m` is the most that the UAV itself flies in a slot, 0 for one that flies no more.
    """

    uav: str
    what: str
    a_m: Point
    b_m: Point
    radius_m: float
    r_m: float
    reach_m: float

    def gap_m(self, point_m: Point, r_m: float) -> float:
        """Return the distance from a disc with radius `r_m` about a point, negative where they overlap."""
        return _to_segment_m(point_m, self.a_m, self.b_m) - self.radius_m - self.r_m - r_m

    def is_ahead(self, here_m: Point, aim_m: Point) -> bool:
        """Return True if the nearest point of the place is less than a right angle off the way to `aim_m`."""
        near_m = _nearest_m(here_m, self.a_m, self.b_m)
        return (near_m[0] - here_m[0]) * (aim_m[0] - here_m[0]) + (near_m[1] - here_m[1]) * (aim_m[1] - here_m[1]) > 0


@dataclass(frozen=True, slots=True)
class Why:
    """The reason for which a UAV holds, in words, and the UAV that is in its way."""

    reason: Reason
    detail: str
    by: str = ""
    is_near: bool = False
    """True if the obstacle is within the UAV's own disc's width: it waits beside it."""


def hulls_of(report: Report | None, r_m: dict[str, float]) -> dict[str, Place]:
    """Return the hulls of a plan, by UAV."""
    if report is None:
        return {}
    rows = zip(report.hull_uav, *report.hull_columns, strict=False)
    return {
        uav: Place(uav, "hull", (ax, ay), (bx, by), radius, r_m[uav], 0.0)
        for uav, ax, ay, bx, by, radius in rows
        if uav in r_m and uav != report.head
    }


def why_no_step(here_m: Point, aim_m: Point, r_m: float, reach_m: float, places: Iterable[Place]) -> Why:
    """Return why a plan leaves a UAV at `here_m`, with a way to `aim_m`, where it is."""
    near = sorted(((place.gap_m(here_m, r_m), place) for place in places), key=lambda pair: (pair[0], pair[1].uav))
    for gap_m, place in near:
        if not place.reach_m and place.gap_m(aim_m, r_m) < 0:
            return Why("covered", f"its target is covered by {place.uav}'s {place.what}", place.uav, gap_m <= 2 * r_m)
    close = [place for gap_m, place in near if gap_m <= reach_m + place.reach_m + TOUCH_M]
    for place in close:
        if not place.reach_m and place.is_ahead(here_m, aim_m):
            return Why("blocked", f"blocked by {place.uav}'s {place.what}", place.uav)
    for place in close:
        if place.reach_m and place.is_ahead(here_m, aim_m):
            return Why("waiting", f"waiting for {place.uav}", place.uav)
    return Why("no-step", "the plan has no step for it")


def _nearest_m(point_m: Point, a_m: Point, b_m: Point) -> Point:
    dx_m, dy_m = b_m[0] - a_m[0], b_m[1] - a_m[1]
    square = dx_m * dx_m + dy_m * dy_m
    share = 0.0
    if square > 0:
        share = min(1.0, max(0.0, ((point_m[0] - a_m[0]) * dx_m + (point_m[1] - a_m[1]) * dy_m) / square))
    return a_m[0] + share * dx_m, a_m[1] + share * dy_m


def _to_segment_m(point_m: Point, a_m: Point, b_m: Point) -> float:
    return math.dist(point_m, _nearest_m(point_m, a_m, b_m))
