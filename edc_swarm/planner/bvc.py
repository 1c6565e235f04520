"""Planner "bvc": buffered Voronoi cells, with detours.

Source: D. Zhou, Z. Wang, S. Bandyopadhyay, M. Schwager, "Fast, on-line collision avoidance for dynamic vehicles using
buffered Voronoi cells", IEEE Robotics and Automation Letters 2(2), 2017.

The cell of a UAV is the part of the plane that is nearer to it than to any other UAV, less a buffer: of the gap between
two discs each may use half. A UAV flies towards the point of its cell that is nearest to its target. Cells are disjoint
and convex, so discs stay apart however unevenly the UAVs fly, if all know where all are. Positions alone count: a
neighbour whose fixes are missing is taken to be where it was last heard. A hull stands, so a UAV may use the whole gap.

*Detour*: a UAV at the point of its cell that is nearest to its target stands still; it then flies for a while towards
the point that is nearest to a place on its right, as in the paper's right-hand heuristic.

For discs of different radii the plane of a pair lies in the middle of the gap, not of the centres.
"""

from __future__ import annotations

import math

import numpy as np

from edc_swarm.geometry import Floats, length_m
from edc_swarm.mission.configuration import Mission
from edc_swarm.planner.detours import Detours
from edc_swarm.planner.discs import CLEARANCE_M, Discs, Sight, plan_of
from edc_swarm.planner.interface import Plan, PlanRequest, Stopwatch

CELL_STEPS = 20.0
"""Half the width, in longest steps, of the square to which a cell without neighbours is cut."""

Point = tuple[float, float]


class Bvc:
    """Planner of steps within buffered Voronoi cells, for all UAVs or for one among its neighbours."""

    def __init__(self, mission: Mission, stopwatch: Stopwatch) -> None:
        self._stopwatch = stopwatch
        self._sight = Sight(mission, horizon_slots=0)
        self._detours = Detours()

    def plan(self, request: PlanRequest) -> Plan:
        """Return the next waypoints of the UAVs of `request`."""
        started_ns = self._stopwatch()
        discs = self._sight.discs(request)
        way_m = discs.target_m - discs.position_m
        turned_m = self._detours.turned(discs, way_m)
        aim_m = np.where(turned_m == way_m, way_m, _far_m(discs, turned_m))
        steps_m = [_step_m(discs, k, aim_m[k]) for k in range(len(discs.uav))]
        step_m = np.array(steps_m, dtype=np.float64).reshape(-1, 2)
        return plan_of(discs, step_m, "planned", (self._stopwatch() - started_ns) / 1e6)


def _far_m(discs: Discs, way_m: Floats) -> Floats:
    """Return the ways (n, 2) as long as half the square of a cell: a detour leads along the cell's edge, not to it."""
    length = np.maximum(length_m(way_m), CLEARANCE_M)
    return way_m * (CELL_STEPS * discs.u_max_m / length)[:, None]


def _step_m(discs: Discs, k: int, aim_m: Floats) -> Point:
    """Return the step of UAV `k` towards the point of its cell that is nearest to its aim."""
    planes = _planes(discs, k)
    x_m, y_m = float(aim_m[0]), float(aim_m[1])
    u_max_m = float(discs.u_max_m[k])
    if any(nx * x_m + ny * y_m > room_m for nx, ny, room_m in planes):
        half_m = CELL_STEPS * u_max_m
        cell = [(-half_m, -half_m), (half_m, -half_m), (half_m, half_m), (-half_m, half_m)]
        for plane in planes:
            cell = clipped(cell, *plane)
            if not cell:
                return 0.0, 0.0
        x_m, y_m = nearest_in(cell, x_m, y_m)
    length = math.hypot(x_m, y_m)
    share = min(1.0, u_max_m / length) if length > 0 else 0.0
    return share * x_m, share * y_m


def _planes(discs: Discs, k: int) -> list[tuple[float, float, float]]:
    """Return the bounds (nx, ny, room_m) of a cell: n.u <= room_m for every step u within it."""
    moving_m, _, r_m = discs.moving
    others = np.arange(len(r_m)) != k
    place_m = np.concatenate([moving_m[others], discs.still_m])
    radius_m = np.concatenate([r_m[others], discs.still_r_m]) + discs.r_m[k] + CLEARANCE_M
    share = np.where(np.arange(len(place_m)) < others.sum(), 0.5, 1.0)
    away_m = place_m - discs.position_m[k]
    distance_m = np.maximum(length_m(away_m), CLEARANCE_M)
    normal = away_m / distance_m[:, None]
    room_m = share * (distance_m - radius_m)
    near = room_m < math.sqrt(2) * CELL_STEPS * discs.u_max_m[k]
    return list(zip(normal[near, 0].tolist(), normal[near, 1].tolist(), room_m[near].tolist(), strict=True))


def clipped(cell: list[Point], nx: float, ny: float, room_m: float) -> list[Point]:
    """Return the part of a convex polygon with n.p <= room_m; an empty list if there is none."""
    over_m = [nx * x_m + ny * y_m - room_m for x_m, y_m in cell]
    if max(over_m) <= 0:
        return cell
    found = []
    for i, (x_m, y_m) in enumerate(cell):
        (x0_m, y0_m), before_m, now_m = cell[i - 1], over_m[i - 1], over_m[i]
        if (before_m > 0) != (now_m > 0):
            share = before_m / (before_m - now_m)
            found.append((x0_m + share * (x_m - x0_m), y0_m + share * (y_m - y0_m)))
        if now_m <= 0:
            found.append((x_m, y_m))
    return found


def nearest_in(cell: list[Point], x_m: float, y_m: float) -> Point:
    """Return the point of a convex polygon, counter-clockwise, that is nearest to a point outside it."""
    best, least_m = (0.0, 0.0), math.inf
    for i, (bx_m, by_m) in enumerate(cell):
        ax_m, ay_m = cell[i - 1]
        dx_m, dy_m = bx_m - ax_m, by_m - ay_m
        square = dx_m * dx_m + dy_m * dy_m
        along = ((x_m - ax_m) * dx_m + (y_m - ay_m) * dy_m) / square if square > 0 else 0.0
        along = min(1.0, max(0.0, along))
        point = (ax_m + along * dx_m, ay_m + along * dy_m)
        away_m = math.hypot(point[0] - x_m, point[1] - y_m)
        if away_m < least_m:
            best, least_m = point, away_m
    return best
