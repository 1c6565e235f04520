"""Goals of a lifelong mission: a new target whenever a UAV has arrived, drawn from seed, UAV and number.

No UAV knows the goals of the others. So each has sites of its own, and flies to one of them after another: the sites of
all UAVs are as far apart as random targets are, where there is room. The first site of a UAV is its target in the
roster; the others are drawn, round by round, in the smallest rectangle that has all starts and points of routes: inside
all inclusion zones, outside all exclusion zones, and where a way leads from the UAV's start.

Every UAV process imports this module, so it imports numpy only where zones restrict that rectangle.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from random import Random
from typing import TYPE_CHECKING

import msgspec

from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.field_types import Point
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.mission.routes import rectangle_m
from edc_swarm.mission.zone import Zone

if TYPE_CHECKING:
    from edc_swarm.mission.airspace import FreePlaces

SITES = 6
"""Most sites of one UAV."""
SITE_TRIES = 60
"""Draws after which a round leaves a UAV without a site."""
SPACING = 1.05
"""Least distance of two sites, in units of the sum of the two largest radii."""
Spot = tuple[str, Point, tuple[Point, ...], float]


def next_goal(mission: Mission, uav: str, number: int, here_m: Point) -> Point:
    """Return the target of goal `number` of a UAV that has arrived at `here_m`: another of its sites.

    A UAV for which there was room for no other site flies to a place that may be another UAV's too; where zones leave
    none either, it flies to and fro between its start and its target.
    """
    index = [entry.uav for entry in mission.roster].index(uav)
    spots, zones, sites = drawn_sites(mission)
    own = sites[index]
    rng = Random(f"{mission.seed}/goal/{uav}/{number}")
    others = [site for site in own if math.dist(site, here_m) > 1.0]
    if others:
        return rng.choice(others)
    start_m, low_high = spots[index][1], rectangle_m(mission.roster)
    drawn = _allowed(zones, spots[index], [_drawn(rng, *low_high) for _ in range(SITE_TRIES if zones else 1)])
    return drawn[0] if drawn else start_m


def drawn_sites(mission: Mission) -> tuple[tuple[Spot, ...], list[Zone], list[list[Point]]]:
    """Return the spots of the roster, the zones that restrict sites, and the sites of every UAV; the last are kept.

    A process that has called it once, or that was forked by one that has, draws no site in flight: that of 200 UAVs
    takes longer than a tick may be late.
    """
    spots = tuple(map(_spot, mission.roster))
    zones = _restricting(mission.zone, *rectangle_m(mission.roster))
    return spots, zones, sites_of(mission.seed, spots, msgspec.json.encode(zones))


@lru_cache(maxsize=4)
def sites_of(seed: int, spots: tuple[Spot, ...], zones: bytes = b"[]") -> list[list[Point]]:
    """Return the sites of every UAV, in roster order.

    Each UAV is (id, start, points of its route, radius). `zones` are those that restrict the sites, as JSON.
    """
    entries = [RosterEntry(uav=uav, start_x_m=x, start_y_m=y, route=list(points)) for uav, (x, y), points, _ in spots]
    low_m, high_m = rectangle_m(entries)
    least_m = SPACING * 2 * max(spot[3] for spot in spots)
    taken, limits = _Grid(least_m), msgspec.json.decode(zones, type=list[Zone])
    sites = [[points[-1]] for _, _, points, _ in spots]
    for own in sites:
        taken.add(own[0])
    for number in range(1, SITES):
        for spot, own in zip(spots, sites, strict=True):
            rng = Random(f"{seed}/site/{spot[0]}/{number}")
            draws = (_drawn(rng, low_m, high_m) for _ in range(SITE_TRIES))
            tries = _allowed(limits, spot, list(draws)) if limits else draws
            site = next((site for site in tries if taken.has_room(site)), None)
            if site is not None:
                own.append(site)
                taken.add(site)
    return sites


def _restricting(zones: Sequence[Zone], low_m: Point, high_m: Point) -> list[Zone]:
    """Return the zones without the rectangular fences that have the whole rectangle within them."""
    return [zone for zone in zones if not _has_within(zone, low_m, high_m)]


def _has_within(zone: Zone, low_m: Point, high_m: Point) -> bool:
    if zone.kind != "inclusion" or zone.keeps_disc or len(zone.polygon) != 4:
        return False
    (west_m, south_m), (east_m, north_m) = (
        (pick(x for x, _ in zone.polygon), pick(y for _, y in zone.polygon)) for pick in (min, max)
    )
    corners = {(west_m, south_m), (east_m, south_m), (east_m, north_m), (west_m, north_m)}
    fits = west_m <= low_m[0] and south_m <= low_m[1] and high_m[0] <= east_m and high_m[1] <= north_m
    return fits and {(x, y) for x, y in zone.polygon} == corners


def _allowed(zones: list[Zone], spot: Spot, points: list[Point]) -> list[Point]:
    """Return those of `points` to which the zones let the UAV fly from its start."""
    if not zones:
        return points
    _, start_m, _, r_m = spot
    return _free_places(msgspec.json.encode(zones), r_m).reachable(start_m, points)


@lru_cache(maxsize=64)
def _free_places(zones: bytes, r_m: float) -> FreePlaces:
    from edc_swarm.mission.airspace import FreePlaces  # noqa: PLC0415  (imports numpy)

    return FreePlaces(msgspec.json.decode(zones, type=list[Zone]), r_m)


def _spot(entry: RosterEntry) -> Spot:
    return entry.uav, (entry.start_x_m, entry.start_y_m), tuple(entry.points), entry.r_m


def _drawn(rng: Random, low_m: Point, high_m: Point) -> Point:
    return rng.uniform(low_m[0], high_m[0]), rng.uniform(low_m[1], high_m[1])


class _Grid:
    """Points in square cells, to find those nearer than one side."""

    def __init__(self, side_m: float) -> None:
        self._side_m = side_m
        self._cells: dict[tuple[int, int], list[Point]] = {}

    def _cell(self, point_m: Point) -> tuple[int, int]:
        return math.floor(point_m[0] / self._side_m), math.floor(point_m[1] / self._side_m)

    def add(self, point_m: Point) -> None:
        """Add a point."""
        self._cells.setdefault(self._cell(point_m), []).append(point_m)

    def has_room(self, point_m: Point) -> bool:
        """Return True if no point is nearer than one side."""
        i, j = self._cell(point_m)
        around = ((i + a, j + b) for a in (-1, 0, 1) for b in (-1, 0, 1))
        near = (other for cell in around for other in self._cells.get(cell, ()))
        return all(math.dist(point_m, other) >= self._side_m for other in near)
