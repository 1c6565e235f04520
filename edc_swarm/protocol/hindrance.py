"""Reasons why a UAV cannot reach its target: UAVs that no longer fly, or the hulls where they can be, are in the way.

The end of a mission, G7 and the outcome share this rule. A UAV with radius r_m is hindered by places (`Place`):

- *covered*: its target is nearer than R, the sum of both GPS radii, to a place;
- *held*: it is nearer than R to places, and no step u != 0 leads away from them: u.(p - x) >= 0 for all their points x.
  Seen from p the places cover an interval of directions each. Such a step exists only if their union leaves a gap of
  180 degrees or more. Within a hull there is none;
- *closed in*: places that overlap once they are R wider separate it from its target.

The last is a question of topology: a closed curve separates two points if its winding numbers about them differ. All
places are convex, so it is enough to look at the polylines that connect the ones which overlap.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from edc_swarm.geometry import (
    Floats,
    capsule_distance_m,
    closest_points_of_segments,
    length_m,
    point_segment_distance_m,
)
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.protocol.messages import Report

Point = tuple[float, float]

BUFFER_M = 0.02
"""A planner keeps so much more than R: `DELTA_M` of the slot QP."""


@dataclass(frozen=True, slots=True)
class Place:
    """Place of the centre of a UAV's disc, now or possibly: all points within `radius_m` of the segment a-b.

    Attributes
    ----------
    what
        "disc" for the last known place, "hull" for where the newest plan says that it can be.
    r_m
        GPS radius of the UAV.
    """

    uav: str
    what: Literal["disc", "hull"]
    a_m: Point
    b_m: Point
    radius_m: float
    r_m: float

    def gap_m(self, point_m: Point, r_m: float) -> float:
        """Distance from a disc with radius `r_m` about `point_m` to this UAV's disc, negative where they overlap."""
        return float(capsule_distance_m(point_m, self.a_m, self.b_m, self.radius_m)) - self.r_m - r_m

    def __str__(self) -> str:
        """Return the UAV and what is meant, in words."""
        return f"{self.uav}'s {self.what}"


@dataclass(frozen=True, slots=True)
class Hindrance:
    """The reason for which a UAV cannot get to its target, and the places that are in the way."""

    kind: Literal["covered", "held", "closed in"]
    by: list[Place]

    @property
    def uavs(self) -> list[str]:
        """The UAVs that are in the way, each once."""
        return list(dict.fromkeys(place.uav for place in self.by))

    def __str__(self) -> str:
        """Return why, in words."""
        return f"{self.kind} by {' and '.join(str(place) for place in self.by)}"


def places_of(entry: RosterEntry, centre_m: Point, plan: Report | None) -> Iterator[Place]:
    """Yield the last known disc of a UAV that no longer flies, then its hull in the newest plan if it has one."""
    yield Place(entry.uav, "disc", centre_m, centre_m, 0.0, entry.r_m)
    if plan is not None and entry.uav in plan.hull_uav:
        k = plan.hull_uav.index(entry.uav)
        a_m, b_m = (plan.hull_ax_m[k], plan.hull_ay_m[k]), (plan.hull_bx_m[k], plan.hull_by_m[k])
        yield Place(entry.uav, "hull", a_m, b_m, plan.hull_r_m[k], entry.r_m)


def point(centre_m: Floats) -> Point:
    """Return a centre (2,) as a pair."""
    return float(centre_m[0]), float(centre_m[1])


def hindrance(position_m: Point, target_m: Point, r_m: float, places: Sequence[Place]) -> Hindrance | None:
    """Return why a UAV at `position_m` cannot get to its target, None if no place is in the way."""
    if covering := [place for place in places if place.gap_m(target_m, r_m) < 0]:
        return Hindrance("covered", covering)
    if holding := _holding(position_m, r_m, places):
        return Hindrance("held", holding)
    closing = _ring(position_m, target_m, r_m, places) if len(places) > 1 else []
    return Hindrance("closed in", closing) if closing else None


def hindrances(away: Sequence[tuple[RosterEntry, Point]], places: Sequence[Place]) -> dict[str, Hindrance]:
    """Return why UAVs that are at these points cannot get to their targets, by id; those that can are left out.

    A UAV that is held is in the way of the others as if it no longer flew.
    """
    fixed = {entry.uav: [place for place in places if place.uav != entry.uav] for entry, _ in away}
    free = list(away)
    while held := [(entry, at_m) for entry, at_m in free if _holding(at_m, entry.r_m, fixed[entry.uav])]:
        free = [other for other in free if other not in held]
        for entry, at_m in held:
            for uav in fixed.keys() - {entry.uav}:
                fixed[uav].extend(places_of(entry, at_m, None))
    found = {}
    for entry, at_m in away:
        target_m = (entry.target_x_m, entry.target_y_m)
        if (why := hindrance(at_m, target_m, entry.r_m, fixed[entry.uav])) is not None:
            found[entry.uav] = why
    return found


def _holding(position_m: Point, r_m: float, places: Sequence[Place]) -> list[Place]:
    """Return the places that leave a UAV no step, [] if it has one."""
    near = [place for place in places if place.gap_m(position_m, r_m) < 0]
    return near if near and not _has_way_out(position_m, near) else []


def _has_way_out(position_m: Point, near: Sequence[Place]) -> bool:
    """True if the directions in which the places are seen leave a gap of 180 degrees."""
    seen = []
    for place in near:
        if capsule_distance_m(position_m, place.a_m, place.b_m, place.radius_m) <= 0:
            return False
        low, high = _directions(position_m, place)
        seen.append((low % math.tau, low % math.tau + high - low))
    seen.sort()
    first, reach = seen[0][0], seen[0][1]
    widest = 0.0
    for low, high in seen[1:]:
        widest, reach = max(widest, low - reach), max(reach, high)
    return max(widest, first + math.tau - reach) >= math.pi


def _directions(position_m: Point, place: Place) -> tuple[float, float]:
    """Return the interval of directions in which a place is seen from outside: of the balls about its two ends."""
    bearings, halves = [], []
    for x_m, y_m in (place.a_m, place.b_m):
        bearings.append(math.atan2(y_m - position_m[1], x_m - position_m[0]))
        halves.append(math.asin(min(place.radius_m / math.dist((x_m, y_m), position_m), 1.0)))
    turn = math.remainder(bearings[1] - bearings[0], math.tau)
    low, high = min(-halves[0], turn - halves[1]), max(halves[0], turn + halves[1])
    return bearings[0] + low, bearings[0] + high


def _ring(position_m: Point, target_m: Point, r_m: float, places: Sequence[Place]) -> list[Place]:
    """Return the places of which some form a closed ring about either point but not about the other, [] if none do.

    A place that is nearer than R to either point counts with what is left of R.
    """
    a_m, b_m = np.array([place.a_m for place in places]), np.array([place.b_m for place in places])
    ends_m = np.array([position_m, target_m])
    keep_m = np.array([place.radius_m + place.r_m + r_m + BUFFER_M for place in places])
    keep_m = np.minimum(keep_m, 0.9995 * point_segment_distance_m(ends_m[:, None], a_m, b_m).min(axis=0))
    i, j = np.triu_indices(len(places), 1)
    on_first, on_second = closest_points_of_segments(a_m[i], b_m[i], a_m[j], b_m[j])
    overlap = length_m(on_first - on_second) < keep_m[i] + keep_m[j]
    i, j = i[overlap], j[overlap]
    curve_m = np.stack([a_m[i], on_first[overlap], on_second[overlap], a_m[j]], axis=1)
    turns = _winding(curve_m, ends_m[0]) - _winding(curve_m, ends_m[1])
    links: dict[int, list[tuple[int, float]]] = {k: [] for k in range(len(places))}
    for first, second, turn in zip(i.tolist(), j.tolist(), turns.tolist(), strict=True):
        links[first].append((second, turn))
        links[second].append((first, -turn))
    turned: dict[int, float] = {}
    for start in links:
        if start in turned:
            continue
        turned[start], group = 0.0, [start]
        for k in group:
            for other, turn in links[k]:
                if other not in turned:
                    turned[other] = turned[k] + turn
                    group.append(other)
        if any(abs(turned[k] + turn - turned[other]) > 0.5 for k in group for other, turn in links[k]):
            return [places[k] for k in sorted(group)]
    return []


def _winding(curve_m: Floats, point_m: Floats) -> Floats:
    """Return by how many turns each polyline (..., v, 2) winds about a point that is on none of them, (...,)."""
    ray_m = curve_m - point_m
    cross = ray_m[..., :-1, 0] * ray_m[..., 1:, 1] - ray_m[..., :-1, 1] * ray_m[..., 1:, 0]
    inner = (ray_m[..., :-1, :] * ray_m[..., 1:, :]).sum(axis=-1)
    return np.asarray(np.arctan2(cross, inner).sum(axis=-1) / math.tau)
