"""Reasons why a UAV cannot reach its target: UAVs that no longer fly, or hulls, are in the way, alone or with zones.

The end of a mission, G7 and the outcome share this rule. A UAV with radius r_m is hindered by places (`Place`):

- *covered*: its target is nearer than R, the sum of both GPS radii, to a place;
- *held*: it is nearer than R to places, and no step u != 0 leads away from them: u.(p - x) >= 0 for all their points x.
  Seen from p the places cover an interval of directions each. Such a step exists only if their union leaves a gap of
  180 degrees or more. Within a hull there is none. A barrier that it touches is seen too: no step comes nearer to it;
- *closed in*: places that overlap once they are R wider, alone or with barriers, separate it from its target.

The last is a question of topology: a closed curve separates two points if its winding numbers about them differ. All
places are convex, so it is enough to look at the polylines that connect the ones which overlap.

The heads of other clusters know less of a UAV that no longer flies: its own head may move it in the next slot, so they
keep clear of its place and a step around it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from edc_swarm.geometry import (
    Barriers,
    Floats,
    capsule_distance_m,
    closest_points_of_segments,
    length_m,
    nearest_on_segment,
    point_segment_distance_m,
)
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.mission.zone import Zone
from edc_swarm.mission.zones import barriers as barriers_of
from edc_swarm.protocol.messages import Report

Point = tuple[float, float]

BUFFER_M = 0.02
"""A planner keeps so much more than R, and than D from a barrier: `DELTA_M` of the slot QP."""
TOUCH_M = 1.5 * BUFFER_M
"""Distance beyond D up to which a UAV touches a barrier."""
BESIDE_EDGE_M = 1e-6
"""Distance from a barrier up to which it is not known on which side of a ring a point is."""
ROUNDING = 1e-9
"""Rounding, in radians, of a gap of 180 degrees: between a place and a barrier opposite it a UAV may fly."""
MOST_RING_BARRIERS = 400
"""Most barriers that are looked at as parts of a ring. With more, only rings of places alone are found."""


@dataclass(frozen=True, slots=True)
class Place:
    """Place of the centre of a UAV's disc, now or possibly: all points within `radius_m` of the segment a-b.

    Attributes
    ----------
    what
        "disc" for the last known place, "hull" for where the newest plan says that it can be.
    r_m
        GPS radius of the UAV.
    cluster
        Its cluster.
    wider_m
        Distance by which the place is wider for the heads of other clusters.
    """

    uav: str
    what: Literal["disc", "hull"]
    a_m: Point
    b_m: Point
    radius_m: float
    r_m: float
    cluster: str = ""
    wider_m: float = 0.0

    def seen_by(self, entry: RosterEntry) -> Place:
        """Return the place as the head of another UAV knows it."""
        if entry.cluster == self.cluster or not self.wider_m:
            return self
        return replace(self, what="hull", radius_m=self.radius_m + self.wider_m, wider_m=0.0)

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
    with_zones: bool = False

    @property
    def uavs(self) -> list[str]:
        """The UAVs that are in the way, each once."""
        return list(dict.fromkeys(place.uav for place in self.by))

    def __str__(self) -> str:
        """Return why, in words."""
        return f"{self.kind} by {' and '.join([*map(str, self.by), *['zones'] * self.with_zones])}"


def places_of(entry: RosterEntry, centre_m: Point, plan: Report | None, *, step_m: float = 0.0) -> Iterator[Place]:
    """Yield the last known disc of a UAV that no longer flies, then its hull in the newest plan if it has one.

    `plan` is one of its own cluster's head. `step_m`: its longest step, 0 for a UAV whose fixes all heads hear.
    """
    yield Place(entry.uav, "disc", centre_m, centre_m, 0.0, entry.r_m, entry.cluster, step_m)
    if plan is not None and entry.uav in plan.hull_uav:
        k = plan.hull_uav.index(entry.uav)
        a_m, b_m = (plan.hull_ax_m[k], plan.hull_ay_m[k]), (plan.hull_bx_m[k], plan.hull_by_m[k])
        yield Place(entry.uav, "hull", a_m, b_m, plan.hull_r_m[k], entry.r_m, entry.cluster, step_m)


def point(centre_m: Floats) -> Point:
    """Return a centre (2,) as a pair."""
    return float(centre_m[0]), float(centre_m[1])


def hindrance(
    position_m: Point, target_m: Point, r_m: float, places: Sequence[Place], barriers: Barriers | None = None
) -> Hindrance | None:
    """Return why a UAV at `position_m` cannot get to its target, None if no place is in the way."""
    if covering := [place for place in places if place.gap_m(target_m, r_m) < 0]:
        return Hindrance("covered", covering)
    barriers = Barriers.none() if barriers is None else barriers
    if held := _holding(position_m, r_m, places, barriers):
        return held
    return _closing(position_m, target_m, r_m, places, barriers)


def hindrances(
    away: Sequence[tuple[RosterEntry, Point]], places: Sequence[Place], zones: Sequence[Zone] = ()
) -> dict[str, Hindrance]:
    """Return why UAVs that are at these points cannot get to their targets, by id; those that can are left out.

    A UAV that is held is in the way of the others as if it no longer flew.
    """
    barriers = barriers_of(list(zones)) if places else Barriers.none()
    fixed = {entry.uav: [place.seen_by(entry) for place in places if place.uav != entry.uav] for entry, _ in away}
    free = list(away)
    while held := [(entry, at_m) for entry, at_m in free if _holding(at_m, entry.r_m, fixed[entry.uav], barriers)]:
        free = [other for other in free if other not in held]
        for entry, at_m in held:
            for uav in fixed.keys() - {entry.uav}:
                fixed[uav].extend(places_of(entry, at_m, None))
    found = {}
    for entry, at_m in away:
        target_m = (entry.target_x_m, entry.target_y_m)
        if (why := hindrance(at_m, target_m, entry.r_m, fixed[entry.uav], barriers)) is not None:
            found[entry.uav] = why
    return found


def _holding(position_m: Point, r_m: float, places: Sequence[Place], barriers: Barriers) -> Hindrance | None:
    """Return the places that leave a UAV no step, alone or with barriers; None if it has one."""
    near = [place for place in places if place.gap_m(position_m, r_m) < 0]
    if not near:
        return None
    seen = [_directions(position_m, place) for place in near if place.gap_m(position_m, -place.r_m) > 0]
    if len(seen) < len(near) or not _have_gap(seen):
        return Hindrance("held", near)
    walls = _touched(position_m, r_m, barriers)
    return Hindrance("held", near, with_zones=True) if walls and not _have_gap([*seen, *walls]) else None


def _touched(position_m: Point, r_m: float, barriers: Barriers) -> list[tuple[float, float]]:
    """Return the directions, as intervals, in which a UAV sees the barriers that it touches."""
    if not len(barriers.a_m):
        return []
    here_m = np.array(position_m)
    towards_m = nearest_on_segment(here_m, barriers.a_m, barriers.b_m) - here_m
    away_m = length_m(towards_m)
    on_edge = (away_m < BESIDE_EDGE_M)[:, None]
    touched = away_m < barriers.least_m(np.array([r_m]))[0] + TOUCH_M
    bearing = np.arctan2(*np.where(on_edge, -barriers.side, towards_m)[touched].T[::-1])
    return [(turn, turn) for turn in bearing.tolist()]


def _have_gap(directions: Sequence[tuple[float, float]]) -> bool:
    """True if the intervals of directions leave a gap of 180 degrees."""
    seen = sorted((low % math.tau, low % math.tau + high - low) for low, high in directions)
    first, reach = seen[0][0], seen[0][1]
    widest = 0.0
    for low, high in seen[1:]:
        widest, reach = max(widest, low - reach), max(reach, high)
    return max(widest, first + math.tau - reach) >= math.pi - ROUNDING


def _directions(position_m: Point, place: Place) -> tuple[float, float]:
    """Return the interval of directions in which a place is seen from outside: of the balls about its two ends."""
    bearings, halves = [], []
    for x_m, y_m in (place.a_m, place.b_m):
        bearings.append(math.atan2(y_m - position_m[1], x_m - position_m[0]))
        halves.append(math.asin(min(place.radius_m / math.dist((x_m, y_m), position_m), 1.0)))
    turn = math.remainder(bearings[1] - bearings[0], math.tau)
    low, high = min(-halves[0], turn - halves[1]), max(halves[0], turn + halves[1])
    return bearings[0] + low, bearings[0] + high


def _closing(
    position_m: Point, target_m: Point, r_m: float, places: Sequence[Place], barriers: Barriers
) -> Hindrance | None:
    """Return the places that separate a UAV from its target, alone or with barriers; None if they do not.

    A place that is nearer than R to either point counts with what is left of R.
    """
    if not places:
        return None
    a_m, b_m = np.array([place.a_m for place in places]), np.array([place.b_m for place in places])
    keep_m = np.array([place.radius_m + place.r_m + r_m + BUFFER_M for place in places])
    ends_m, count = np.array([position_m, target_m]), len(places)
    keep_m = np.minimum(keep_m, 0.9995 * _nearest_m(ends_m, a_m, b_m))
    if ring := _ring(ends_m, a_m, b_m, keep_m):
        return Hindrance("closed in", [places[k] for k in ring])
    away_m = _nearest_m(ends_m, barriers.a_m, barriers.b_m)
    if not 0 < len(away_m) <= MOST_RING_BARRIERS or away_m.min() < BESIDE_EDGE_M:
        return None
    wall_m = np.minimum(barriers.least_m(np.array([r_m]))[0] + BUFFER_M, 0.9995 * away_m)
    ring = _ring(
        ends_m,
        np.concatenate([a_m, barriers.a_m]),
        np.concatenate([b_m, barriers.b_m]),
        np.concatenate([keep_m, wall_m]),
    )
    by = [places[k] for k in ring if k < count]
    return Hindrance("closed in", by, with_zones=True) if by else None


def _nearest_m(ends_m: Floats, a_m: Floats, b_m: Floats) -> Floats:
    """Return the least distances (n,) of the segments from two points (2, 2)."""
    nearest_m: Floats = point_segment_distance_m(ends_m[:, None], a_m, b_m).min(axis=0)
    return nearest_m


def _ring(ends_m: Floats, a_m: Floats, b_m: Floats, keep_m: Floats) -> list[int]:
    """Return the segments (n, 2), wider by `keep_m`, of which some form a closed ring about only one of two points.

    [] if none do.
    """
    i, j = np.triu_indices(len(a_m), 1)
    on_first, on_second = closest_points_of_segments(a_m[i], b_m[i], a_m[j], b_m[j])
    overlap = length_m(on_first - on_second) < keep_m[i] + keep_m[j]
    i, j = i[overlap], j[overlap]
    curve_m = np.stack([a_m[i], on_first[overlap], on_second[overlap], a_m[j]], axis=1)
    turns = _winding(curve_m, ends_m[0]) - _winding(curve_m, ends_m[1])
    links: dict[int, list[tuple[int, float]]] = {k: [] for k in range(len(a_m))}
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
            return sorted(group)
    return []


def _winding(curve_m: Floats, point_m: Floats) -> Floats:
    """Return by how many turns each polyline (..., v, 2) winds about a point that is on none of them, (...,)."""
    ray_m = curve_m - point_m
    cross = ray_m[..., :-1, 0] * ray_m[..., 1:, 1] - ray_m[..., :-1, 1] * ray_m[..., 1:, 0]
    inner = (ray_m[..., :-1, :] * ray_m[..., 1:, :]).sum(axis=-1)
    return np.asarray(np.arctan2(cross, inner).sum(axis=-1) / math.tau)
