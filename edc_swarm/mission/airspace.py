"""The airspace of a mission: the places that its zones allow, and the ways between them.

A UAV of radius r is held off by grown barriers: all points nearer to a barrier (`zones.Barriers`) than the distance
that the UAV keeps from it. Each grown barrier is convex. Two places have no way between them if and only if some ring
of grown barriers, each of which overlaps the next, goes round one of the places and not round the other (the nerve
theorem: the ring structure of a union of convex sets is that of the graph of their overlaps). So the question has an
exact answer without a search in the plane:

1. The graph has one node per barrier, and an edge where two grown barriers overlap.
2. A spanning forest leaves one ring per further edge; all other rings are sums of these.
3. A ray from a place crosses each ring an even or an odd number of times. The list of these parities is the
   *signature* of the place. Two places are connected if and only if their signatures are equal.

Other UAVs play no part: they move.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edc_swarm.errors import MissionError
from edc_swarm.geometry import Floats, Indices, closest_points_of_segments, length_m, point_segment_distance_m
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.faults import GiveGoal, parse_fault
from edc_swarm.mission.field_types import Point
from edc_swarm.mission.zone import Zone
from edc_swarm.mission.zones import Barriers, barriers

Bools = NDArray[np.bool_]

KEPT_M = 1e-9
"""A distance that lacks no more than this is kept."""
LEAST_M = 1e-6
"""Least distance of starts and targets from a barrier, even for a UAV whose centre alone keeps to the zone."""
PLANNER_MARGIN_M = 0.02
"""Distance that the planner keeps beyond what zones ask (`solver.normals.DELTA_M`).

A passage with less room on either side is legal, but the planner may not enter it.
"""
MAX_OVERLAPS = 200_000
"""Most pairs of overlapping grown barriers for which ways are checked."""
MAX_WORK = 200_000_000
"""Most tests of a ray against an edge of a ring in one mission."""
GRAPH_WORK = 20
"""Such tests that take as long as one edge of the graph, which is made anew for every radius of a UAV."""
CHUNK = 4_000_000
"""Elements of the largest temporary array."""
MOST_NAMED = 4


@dataclass(frozen=True, slots=True)
class Airspace:
    """Zones with their barriers."""

    zones: Sequence[Zone]
    barriers: Barriers

    @classmethod
    def of(cls, zones: Sequence[Zone]) -> Airspace:
        """Return the airspace of zones that `zone_shapes.check_shapes` accepts."""
        return cls(zones, barriers(list(zones)))

    def keep_m(self, r_m: float) -> Floats:
        """Return (m,) the least distance of a UAV's centre from each barrier, for a UAV of radius `r_m`."""
        return self.barriers.radius_m + np.where(self.barriers.keeps_disc, r_m, 0.0)

    def clear_m(self, points_m: Floats) -> Floats:
        """Return (n, zones) how far points (n, 2) are on the allowed side of each zone's edge, below 0 if not."""
        if not self.zones:
            return np.empty((len(points_m), 0))
        first = np.searchsorted(self.barriers.zone, np.arange(len(self.zones)))
        is_circle = np.array([zone.kind == "exclusion" and not zone.polygon for zone in self.zones])
        is_exclusion = np.array([zone.kind == "exclusion" for zone in self.zones])
        a_m, b_m = self.barriers.a_m, self.barriers.b_m
        clear_m = np.empty((len(points_m), len(self.zones)))
        for rows in _chunks(len(points_m), len(a_m)):
            away_m = point_segment_distance_m(points_m[rows, None], a_m, b_m) - self.barriers.radius_m
            away_m = np.minimum.reduceat(away_m, first, axis=1)
            odd = np.logical_xor.reduceat(_ray_crosses(points_m[rows, None], a_m, b_m), first, axis=1)
            clear_m[rows] = np.where(is_circle | (odd != is_exclusion), away_m, -away_m)
        return clear_m

    def lack_m(self, points_m: Floats, r_m: Floats) -> Floats:
        """Return (n, zones) how much too near points (n, 2) of UAVs of radii `r_m` (n,) are; 0 or less is allowed."""
        keeps_disc = np.array([zone.keeps_disc for zone in self.zones], dtype=bool)
        keep_m = np.where(keeps_disc, r_m[:, None] - KEPT_M, 0.0)
        return np.maximum(keep_m, LEAST_M) - self.clear_m(points_m)

    def room_m(self, points_m: Floats, r_m: float) -> Floats:
        """Return (n,) by how much points are farther from all zones than a UAV must be, below 0 if it must not be."""
        return np.asarray(-self.lack_m(points_m, np.full(len(points_m), r_m)).max(axis=1, initial=-np.inf))


def zones_refusal(zones: Sequence[Zone], r_m: float, points: Sequence[Point]) -> str:
    """Return why a UAV of radius `r_m` cannot fly through `points` in their order, "" if it can.

    A question beyond the limits of this module counts as "it can": `check_zones` reports that as a warning.
    """
    airspace, points_m = Airspace.of(zones), np.array(points, dtype=np.float64).reshape(-1, 2)
    lack_m = airspace.lack_m(points_m, np.full(len(points_m), r_m))
    for index, said in _misplaced(airspace, points_m, lack_m, np.full(len(points_m), r_m)):
        return f"point {index} ({points_m[index, 0]:g}, {points_m[index, 1]:g}) must be {said}"
    overlaps = _overlaps(airspace, r_m)
    if overlaps is None:
        return ""
    rings = _rings(airspace, r_m, 0.0, overlaps)
    apart = rings.apart(points_m[:-1], points_m[1:])
    if not len(apart):
        return ""
    return f"no way from point {apart[0]} to point {apart[0] + 1}: {rings.closed_by(*points_m[apart[0] :][:2])}"


class FreePlaces:
    """The places to which a UAV of radius `r_m` can fly, with the planner's margin."""

    def __init__(self, zones: Sequence[Zone], r_m: float) -> None:
        self._airspace, self._r_m = Airspace.of(zones), r_m
        overlaps = _overlaps(self._airspace, r_m)
        self._rings = _rings(self._airspace, r_m, PLANNER_MARGIN_M, overlaps) if overlaps is not None else None

    def reachable(self, from_m: Point, points: Sequence[Point]) -> list[Point]:
        """Return those of `points` that zones allow and to which a way leads; a question beyond limits has none."""
        points_m = np.array(points, dtype=np.float64).reshape(-1, 2)
        lack_m = self._airspace.lack_m(points_m, np.full(len(points_m), self._r_m))
        allowed: Bools = np.all(lack_m <= -PLANNER_MARGIN_M, axis=1)
        if self._rings is None:
            return []
        allowed[self._rings.apart(np.broadcast_to(from_m, points_m.shape), points_m)] = False
        return [point for point, fits in zip(points, allowed.tolist(), strict=True) if fits]


def check_zones(mission: Mission, routes: Sequence[Sequence[Point]] | None = None) -> list[str]:
    """Check that every UAV of a mission can fly its route in the airspace; return warnings.

    Parameters
    ----------
    mission
        A mission with its roster, whose zones `zone_shapes.check_shapes` accepts.
    routes
        For every UAV the points that it flies through, in metres, the first one its start; by default its start and its
        route.

    Raises
    ------
    MissionError
        A point lies on the forbidden side of a zone or too near to it, or no way leads from a point to the next one.
    """
    if not mission.zone or not mission.roster:
        return []
    routes = routes or [[(entry.start_x_m, entry.start_y_m), *entry.points] for entry in mission.roster]
    airspace, legs = Airspace.of(mission.zone), _Legs.of(mission, routes)
    lack_m = airspace.lack_m(legs.points_m, legs.r_m)
    for index, said in _misplaced(airspace, legs.points_m, lack_m, legs.r_m):
        raise MissionError(legs.field(index), tuple(legs.points_m[index].tolist()), said)
    return _check_ways(airspace, legs)


def check_goals(mission: Mission) -> None:
    """Raise `MissionError` for a fault that gives a UAV a goal which the zones do not allow."""
    for index, text in enumerate(mission.fault if mission.zone else []):
        fault = parse_fault(text, mission.dt_s)
        if isinstance(fault, GiveGoal):
            # Who holds a role is not known before take-off, so any UAV must be able to fly its goal.
            named = [entry for entry in mission.roster if entry.uav == fault.target] or mission.roster
            for entry in named:
                points = [(entry.start_x_m, entry.start_y_m), *fault.route]
                if refusal := zones_refusal(mission.zone, entry.r_m, points):
                    raise MissionError(f"fault[{index}]", text, f"a goal that {entry.uav} can fly to ({refusal})")


@dataclass(frozen=True, slots=True)
class _Legs:
    """The points of all routes in one array: `points_m` (n, 2), and per point the UAV, its radius and its place."""

    mission: Mission
    points_m: Floats
    uav: Indices
    place: Indices
    r_m: Floats

    @classmethod
    def of(cls, mission: Mission, routes: Sequence[Sequence[Point]]) -> _Legs:
        uav = np.repeat(np.arange(len(routes)), [len(route) for route in routes])
        place = np.concatenate([np.arange(len(route)) for route in routes])
        points_m = np.array([point for route in routes for point in route], dtype=np.float64)
        return cls(mission, points_m, uav, place, np.array([e.r_m for e in mission.roster])[uav])

    def field(self, index: int) -> str:
        """Return the field of the mission file that states a point."""
        uav = self.uav[index]
        if self.place[index] == 0:
            return f"roster[{uav}].start_x_m, start_y_m"
        if index + 1 < len(self.uav) and self.uav[index + 1] == uav:
            return f"roster[{uav}].route[{self.place[index] - 1}]"
        return f"roster[{uav}].target_x_m, target_y_m"


def _misplaced(airspace: Airspace, points_m: Floats, lack_m: Floats, r_m: Floats) -> Iterator[tuple[int, str]]:
    """Yield each point that a zone forbids, and what is allowed instead."""
    for index, which in np.argwhere(lack_m > 0).tolist():
        zone = airspace.zones[which]
        clear_m = float(airspace.clear_m(points_m[index : index + 1])[0, which])
        side = "inside" if zone.kind == "inclusion" else "outside"
        wrong = f"{-clear_m:.3f} m {'outside' if side == 'inside' else 'inside'} it"
        where = wrong if clear_m < 0 else f"{abs(clear_m):.3f} m from its edge"
        kept = f"with its whole disc of {r_m[index]:g} m" if zone.keeps_disc else "with its centre"
        yield index, f"{side} {zone.kind} zone '{zone.name}' {kept}, not {where}"


# --- ways ----------------------------------------------------------------------------------------


def _check_ways(airspace: Airspace, legs: _Legs) -> list[str]:
    """Raise `MissionError` for a leg without a way; return warnings about tight ways and open questions."""
    overlaps = _overlaps(airspace, float(legs.r_m.max()))
    from_leg = np.flatnonzero(legs.uav[:-1] == legs.uav[1:])
    # A place that lies itself within the margin says nothing about the passages on the way.
    roomy: Bools = np.all(airspace.lack_m(legs.points_m, legs.r_m) <= -PLANNER_MARGIN_M, axis=1)
    open_uavs, tight, left = set[int](), dict[int, str](), MAX_WORK
    for r_m in np.unique(legs.r_m).tolist():
        mine = from_leg[legs.r_m[from_leg] == r_m]
        for margin_m in (0.0, PLANNER_MARGIN_M):
            if margin_m:
                mine = mine[roomy[mine] & roomy[mine + 1]]
            left -= 0 if overlaps is None else len(overlaps.first) * (2 * len(mine) + GRAPH_WORK)
            if overlaps is None or left < 0:
                open_uavs |= set(legs.uav[mine].tolist())
                continue
            rings = _rings(airspace, r_m, margin_m, overlaps)
            for leg in mine[rings.apart(legs.points_m[mine], legs.points_m[mine + 1])].tolist():
                said = rings.closed_by(legs.points_m[leg], legs.points_m[leg + 1])
                if margin_m == 0:
                    before = "its start" if legs.place[leg] == 0 else f"point {legs.place[leg]} of its route"
                    reachable = f"reachable from {before} for a disc of {r_m:g} m: {said}"
                    raise MissionError(legs.field(leg + 1), tuple(legs.points_m[leg + 1].tolist()), reachable)
                tight.setdefault(int(legs.uav[leg]), said)
    return [*_warnings(legs, tight, open_uavs)]


def _warnings(legs: _Legs, tight: dict[int, str], open_uavs: set[int]) -> Iterator[str]:
    roster = legs.mission.roster
    if tight:
        uav, said = next(iter(tight.items()))
        more = f" and {len(tight) - 1} more" if len(tight) > 1 else ""
        yield (
            f"{roster[uav].uav}{more} may not arrive: the only way leaves less than {PLANNER_MARGIN_M:g} m beside"
            f" the disc, which is the planner's margin ({said})"
        )
    if open_uavs:
        yield f"the zones are too many or too dense to check that {len(open_uavs)} UAVs have a way to their targets"


@dataclass(frozen=True, slots=True)
class _Overlaps:
    """Pairs of barriers that may overlap: indices, nearest points (p, 2) on either, and the distance between them."""

    first: Indices
    second: Indices
    on_first_m: Floats
    on_second_m: Floats
    apart_m: Floats


@dataclass(frozen=True, slots=True)
class _Rings:
    """The graph of overlapping grown barriers, with a spanning forest.

    Edge e joins the barriers `first` and `second` (e,) through the point `meeting_m` (e, 2), which lies in both.
    `forest` has, in an order in which a barrier follows its parent, (barrier, parent, edge).
    """

    airspace: Airspace
    first: Indices
    second: Indices
    meeting_m: Floats
    forest: list[tuple[int, int, int]]

    def signatures(self, points_m: Floats) -> Bools:
        """Return (e, n) the parity of each edge's ring about each of the points (n, 2); False for the forest's edges.

        A ring runs through its barriers from their start a by straight lines to the meeting points.
        """
        a_m = self.airspace.barriers.a_m
        meeting_m, points_m = self.meeting_m[:, None], points_m[None]
        crosses = _ray_crosses(points_m, a_m[self.first][:, None], meeting_m)
        crosses = crosses ^ _ray_crosses(points_m, meeting_m, a_m[self.second][:, None])
        to_root = np.zeros((len(a_m), points_m.shape[1]), dtype=bool)
        for barrier, parent, edge in self.forest:
            to_root[barrier] = to_root[parent] ^ crosses[edge]
        return np.asarray(crosses ^ to_root[self.first] ^ to_root[self.second])

    def apart(self, from_m: Floats, to_m: Floats) -> Indices:
        """Return the indices of the pairs of places (n, 2) between which there is no way."""
        found = [np.empty(0, np.int64)]
        for rows in _chunks(len(from_m), 2 * len(self.first) + len(self.airspace.barriers.zone)):
            differ = (self.signatures(from_m[rows]) != self.signatures(to_m[rows])).any(axis=0)
            found.append(rows.start + np.flatnonzero(differ))
        return np.concatenate(found)

    def closed_by(self, from_m: Floats, to_m: Floats) -> str:
        """Return the names of the zones that close every way between two places which are apart."""
        parity = self.signatures(np.stack([from_m, to_m]))
        parent = {barrier: above for barrier, above, _ in self.forest}
        rings = [self._zones_of(edge, parent) for edge in np.flatnonzero(parity[:, 0] != parity[:, 1])[:100].tolist()]
        names = [self.airspace.zones[zone].name for zone in min(rings, key=len)]
        more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
        return f"closed by {'zone' if len(names) == 1 else 'zones'} {', '.join(names[:MOST_NAMED])}{more}"

    def _zones_of(self, edge: int, parent: dict[int, int]) -> list[int]:
        """Return the zones of the ring that an edge closes, in their order along the ring."""
        sides = [_path_up(int(end), parent) for end in (self.first[edge], self.second[edge])]
        while len(sides[0]) > 1 and len(sides[1]) > 1 and sides[0][-2] == sides[1][-2]:
            del sides[0][-1], sides[1][-1]
        zone = self.airspace.barriers.zone
        return list(dict.fromkeys(zone[barrier].item() for barrier in [*sides[0], *sides[1][-2::-1]]))


def _overlaps(airspace: Airspace, r_m: float) -> _Overlaps | None:
    """Return the pairs of barriers that overlap when grown for `r_m` and the margin; None if they are too many."""
    known, keep_m = airspace.barriers, airspace.keep_m(r_m) + PLANNER_MARGIN_M
    low_m = np.minimum(known.a_m, known.b_m) - keep_m[:, None]
    high_m = np.maximum(known.a_m, known.b_m) + keep_m[:, None]
    order = np.argsort(low_m[:, 0], kind="stable")
    ends = np.searchsorted(low_m[order, 0], high_m[order, 0], side="right").tolist()
    pairs, total = list[Indices](), 0
    for place, i in enumerate(order.tolist()):
        others = order[place + 1 : ends[place]]
        others = others[(low_m[others, 1] <= high_m[i, 1]) & (high_m[others, 1] >= low_m[i, 1])]
        pairs.append(np.stack([np.full(len(others), i), others]))
        total += len(others)
        if total > MAX_OVERLAPS:
            return None
    first, second = np.concatenate([np.empty((2, 0), np.int64), *pairs], axis=1)
    on_first_m, on_second_m = closest_points_of_segments(
        known.a_m[first], known.b_m[first], known.a_m[second], known.b_m[second]
    )
    return _Overlaps(first, second, on_first_m, on_second_m, length_m(on_first_m - on_second_m))


def _rings(airspace: Airspace, r_m: float, margin_m: float, overlaps: _Overlaps) -> _Rings:
    """Return the rings of barriers grown for `r_m` and a margin."""
    keep_m = airspace.keep_m(r_m) + margin_m
    first_m, second_m = keep_m[overlaps.first], keep_m[overlaps.second]
    chosen = overlaps.apart_m < np.maximum(first_m + second_m - KEPT_M, KEPT_M)
    share = first_m / np.where(first_m + second_m > 0, first_m + second_m, 1.0)
    meeting_m = overlaps.on_first_m + share[:, None] * (overlaps.on_second_m - overlaps.on_first_m)
    first, second = overlaps.first[chosen], overlaps.second[chosen]
    return _Rings(airspace, first, second, meeting_m[chosen], _forest(airspace.barriers.zone, first, second))


def _forest(owner: Indices, first: Indices, second: Indices) -> list[tuple[int, int, int]]:
    """Return a spanning forest that prefers edges within a zone, so that its rings touch few zones."""
    near: list[list[tuple[int, int]]] = [[] for _ in owner]
    for edge, (i, j) in enumerate(zip(first.tolist(), second.tolist(), strict=True)):
        near[i].append((j, edge))
        near[j].append((i, edge))
    of, reached, forest = owner.tolist(), [False] * len(owner), list[tuple[int, int, int]]()
    for root in range(len(of)):
        waiting = deque([(root, -1, -1)])
        while waiting:
            barrier, parent, edge = waiting.popleft()
            if reached[barrier]:
                continue
            reached[barrier] = True
            if edge >= 0:
                forest.append((barrier, parent, edge))
            for other, through in near[barrier]:
                if not reached[other]:
                    add = waiting.appendleft if of[other] == of[barrier] else waiting.append
                    add((other, barrier, through))
    return forest


def _path_up(barrier: int, parent: dict[int, int]) -> list[int]:
    path = [barrier]
    while path[-1] in parent:
        path.append(parent[path[-1]])
    return path


def _ray_crosses(point_m: Floats, a_m: Floats, b_m: Floats) -> Bools:
    """Return (...,) True where the ray from a point to the east crosses the segment a-b."""
    x_m, y_m = point_m[..., 0], point_m[..., 1]
    above_a, above_b = a_m[..., 1] > y_m, b_m[..., 1] > y_m
    # The sense of the segment decides on rounding, so it is always the same one: upwards.
    low_m, high_m = np.where(above_a[..., None], b_m, a_m), np.where(above_a[..., None], a_m, b_m)
    left = (high_m[..., 0] - low_m[..., 0]) * (y_m - low_m[..., 1])
    return np.asarray((above_a != above_b) & ((x_m - low_m[..., 0]) * (high_m[..., 1] - low_m[..., 1]) < left))


def _chunks(rows: int, width: int) -> Iterator[slice]:
    """Yield slices of rows of which each makes an array (rows, width) of moderate size."""
    size = max(1, CHUNK // max(1, width))
    for begin in range(0, rows, size):
        yield slice(begin, min(begin + size, rows))
