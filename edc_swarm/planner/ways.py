"""Ways round hulls and zones: the places that a UAV can reach, and the shortest way there without other UAVs.

A hull is all points within a radius of a segment. Guidance looks ahead for a limited time, and
assumes a straight way after that; alone it would never leave a pocket that is deeper.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edc_swarm.geometry import Floats, Indices, length_m, nearest_on_segment, point_segment_distance_m
from edc_swarm.planner import guidance_kernel as kernel
from edc_swarm.planner.charts import LEG_TESTS, Charts, along, clear_of
from edc_swarm.solver.barrier_rows import ON_EDGE_M, Airspace
from edc_swarm.solver.hull_rows import Obstacles
from edc_swarm.solver.normals import DELTA_M

SPARE_M = 1e-5
"""Distance added to a moved goal for rounding."""
CORNERS = 12
"""Corners of the polygon about each end of a hull's segment."""
TESTS = 200_000
"""Limit per slot on tests of a line of sight against a hull; the UAVs left fly towards their goals."""
RING_M = 0.5
RINGS, BEARINGS = 120, 24
RINGS_AT_ONCE = 8
"""Rings that are tried together; a divisor of `RINGS`."""
_BEARING = [(math.cos(math.tau * i / BEARINGS), math.sin(math.tau * i / BEARINGS)) for i in range(BEARINGS)]
_CORNER = [(math.cos(math.tau * (i + 0.5) / CORNERS), math.sin(math.tau * (i + 0.5) / CORNERS)) for i in range(CORNERS)]


def walls_of(position_m: Floats, r_m: Floats, obstacles: Obstacles, reach_m: Floats | float = np.inf) -> kernel.Walls:
    """Return the hulls with the distances that each UAV keeps from their segments; it flies `reach_m` (n,) at most."""
    keep_m = r_m[:, None] + obstacles.keep_m + obstacles.radius_m + DELTA_M
    away_m = point_segment_distance_m(position_m[:, None], obstacles.a_m[None], obstacles.b_m[None])
    bar_m = np.minimum(keep_m, 0.9995 * away_m) - kernel.ROUNDING_M
    return walls_near(obstacles.a_m, obstacles.b_m, keep_m, bar_m, away_m < keep_m + np.reshape(reach_m, (-1, 1)))


def walls_near(
    a_m: Floats, b_m: Floats, keep_m: Floats, bar_m: Floats, near: NDArray[np.bool_] | None = None
) -> kernel.Walls:
    """Return the hulls, of which each UAV can come near those of the mask `near` (n, m); None: near all of them.

    A flight past all others costs nothing, so to leave them out changes no price.
    """
    near = np.ones(keep_m.shape, dtype=bool) if near is None else near
    begin = np.concatenate([[0], np.cumsum(near.sum(axis=1))]).astype(np.int64)
    # One memory layout: numba compiles the kernel anew for any other.
    return kernel.Walls(
        np.ascontiguousarray(a_m), np.ascontiguousarray(b_m), keep_m, bar_m, begin, np.nonzero(near)[1].astype(np.int64)
    )


def free_goals(target_m: Floats, r_m: Floats, obstacles: Obstacles, airspace: Airspace | None = None) -> Floats:
    """Return the targets (n, 2), with those nearer than R + delta to a hull or barrier moved to a free place near by.

    The slot QP's buffer makes a target at R or a little more unreachable; it moves by less than the
    distance that counts as arrived. A covered target becomes a place to wait, clear of the targets of other UAVs, and
    in the airspace.
    """
    goal_m, airspace = target_m.copy(), airspace or Airspace.unbounded()
    keep_m = r_m[:, None] + obstacles.keep_m + obstacles.radius_m + DELTA_M
    away_m = point_segment_distance_m(target_m[:, None], obstacles.a_m[None], obstacles.b_m[None])
    covered: NDArray[np.bool_] = np.any(away_m < keep_m, axis=1) | ~clear_of(airspace, target_m, r_m)
    taken = [k for k in range(len(target_m)) if not covered[k]]
    for k in np.flatnonzero(covered).tolist():
        # Every disc at a goal acts as a hull too, about a point.
        a_m = np.concatenate([obstacles.a_m, goal_m[taken]])
        b_m = np.concatenate([obstacles.b_m, goal_m[taken]])
        apart_m = np.concatenate([keep_m[k], r_m[k] + r_m[taken] + DELTA_M])
        goal_m[k] = _free_point(target_m[k], float(r_m[k]), a_m, b_m, apart_m, airspace)
        taken.append(k)
    return goal_m


def _free_point(point_m: Floats, r_m: float, a_m: Floats, b_m: Floats, apart_m: Floats, airspace: Airspace) -> Floats:
    """Return a point near `point_m` that keeps `apart_m` (m,) from the segments a-b (m, 2), else the point itself.

    It is in the airspace, and keeps the distance from barriers too.
    """
    barriers = airspace.barriers
    if len(near := airspace.index.near(point_m[None])[1]):
        near_a_m, near_b_m = np.concatenate([a_m, barriers.a_m[near]]), np.concatenate([b_m, barriers.b_m[near]])
        near_m = np.concatenate([apart_m, (barriers.radius_m + barriers.keeps_disc * r_m + DELTA_M)[near]])
        side = np.concatenate([np.zeros_like(a_m), barriers.side[near]])
    else:
        near_a_m, near_b_m, near_m, side = a_m, b_m, apart_m, np.zeros_like(a_m)
    moved_m = point_m
    for _ in range(8):
        nearest_m = nearest_on_segment(moved_m, near_a_m, near_b_m)
        lack_m = near_m - length_m(moved_m - nearest_m)
        worst = int(np.argmax(lack_m))
        if lack_m[worst] <= 0:
            if _usable(moved_m[None], r_m, a_m, b_m, apart_m, airspace)[0]:
                return moved_m
            break
        away_m = moved_m - nearest_m[worst]
        far_m = float(length_m(away_m))
        away = away_m / far_m if far_m > ON_EDGE_M else side[worst] if side[worst].any() else np.array([1.0, 0.0])
        moved_m = nearest_m[worst] + (near_m[worst] + SPARE_M) * away
    # Most places are found within a few metres, so far rings are not tried before the near ones have failed.
    spare_m = point_segment_distance_m(point_m, a_m, b_m) - apart_m
    for first in range(1, RINGS + 1, RINGS_AT_ONCE):
        ring_m = RING_M * np.arange(first, first + RINGS_AT_ONCE)
        trial_m = point_m + (ring_m[:, None, None] * np.array(_BEARING)).reshape(-1, 2)
        near = spare_m <= ring_m[-1] + SPARE_M
        free = _usable(trial_m, r_m, a_m[near], b_m[near], apart_m[near], airspace)
        if free.any():
            found_m: Floats = trial_m[int(np.argmax(free))]
            return found_m
    return point_m


def _usable(
    point_m: Floats, r_m: float, a_m: Floats, b_m: Floats, apart_m: Floats, airspace: Airspace
) -> NDArray[np.bool_]:
    """Return a mask (p,) of the points in the airspace that keep all distances, those from barriers included."""
    free: NDArray[np.bool_] = np.all(
        point_segment_distance_m(point_m[:, None], a_m[None], b_m[None]) >= apart_m, axis=1
    )
    free &= clear_of(airspace, point_m, np.full(len(point_m), r_m))
    return free & airspace.contains(point_m)


def routed(
    position_m: Floats, goal_m: Floats, walls: kernel.Walls, slot: int, uav: Indices, r_m: Floats, charts: Charts
) -> tuple[Floats, Floats]:
    """Return the first point (n, 2) of each UAV's shortest way round hulls and zones, and that way's length (n,).

    The first point is the goal if the straight way is free, or if no way is known.
    """
    way_m = length_m(goal_m - position_m)
    if not walls.keep_m.size and not len(charts.barred.edge):
        return goal_m, way_m
    first_m, budget, count = goal_m.copy(), _Budget(), len(goal_m)
    clear = np.empty(count, dtype=bool)
    kernel.clear_ways(walls, charts.barred, DELTA_M, position_m, np.ascontiguousarray(goal_m), r_m, clear)
    corners: dict[bytes, Floats] = {}
    # Another UAV comes first in each slot, so that the limit on tests does not always affect the same UAVs.
    for k in ((slot + i) % count for i in range(count)):
        if clear[k]:
            continue
        known, node, length, spent = charts.way(int(uav[k]), float(r_m[k]), position_m[k], goal_m[k], budget.legs)
        budget.legs -= spent
        if node >= 0 and known is not None and _open(walls, k, along(known, node, position_m[k])):
            first_m[k], way_m[k] = known.chart.node_m[node], length
        elif walls.keep_m.size and budget.tests > 0:
            found = _round_hulls(walls, k, position_m[k], goal_m[k], float(r_m[k]), charts, corners, budget)
            if found is not None:
                first_m[k], way_m[k] = found
    return first_m, way_m


@dataclass
class _Budget:
    """The rest, in a slot, of the limits on tests of a line of sight."""

    tests: int = TESTS
    legs: int = LEG_TESTS


def _open(walls: kernel.Walls, k: int, point_m: Floats) -> bool:
    """Return True if no hull blocks UAV `k` on the way over these points (p, 2)."""
    return all(kernel.open_way(walls, k, *start, *end) for start, end in itertools.pairwise(point_m.tolist()))


def _round_hulls(
    walls: kernel.Walls,
    k: int,
    position_m: Floats,
    goal_m: Floats,
    r_m: float,
    charts: Charts,
    corners: dict[bytes, Floats],
    budget: _Budget,
) -> tuple[Floats, float] | None:
    """Return the first point and the length of UAV `k`'s shortest way round hulls and zones, None if none is known."""
    key = walls.keep_m[k].tobytes() + np.float64(r_m).tobytes()
    if key not in corners:
        corner_m = _corners(walls, k)
        corners[key] = corner_m[clear_of(charts.airspace, corner_m, np.full(len(corner_m), r_m))]
    chart = charts.chart(r_m)
    node_m = np.concatenate([position_m[None], goal_m[None], corners[key], chart.node_m])
    size = len(node_m)
    first, length, spent = kernel.way_round(
        walls, charts.barred, chart.r_m, DELTA_M, k, node_m, chart.leg_m, chart.known,
        np.empty(size), np.empty(size, np.int64), np.empty(size, np.bool_), budget.tests,
    )  # fmt: skip
    budget.tests -= spent
    return (node_m[first], length) if first >= 0 else None


def clearest(normal: Floats) -> Floats:
    """Return the direction (2,) with the greatest least product with unit vectors (h, 2), zero if that is not above 0.

    It is one of the vectors, or the bisector of two.
    """
    i, j = np.triu_indices(len(normal))
    middle = normal[i] + normal[j]
    length = length_m(middle)
    middle = middle[length > 1e-9] / length[length > 1e-9, None]
    least = (middle @ normal.T).min(axis=1, initial=np.inf)
    return middle[int(np.argmax(least))] if len(least) and least.max() > 0 else np.zeros(2)


def _corners(walls: kernel.Walls, k: int) -> Floats:
    """Return the corners (c, 2) of polygons about all hulls, those that UAV `k` may fly to."""
    along_m = walls.b_m - walls.a_m
    length = length_m(along_m)
    axis = np.where(length[:, None] > 0, along_m / np.where(length > 0, length, 1.0)[:, None], [1.0, 0.0])
    across = np.stack([-axis[:, 1], axis[:, 0]], axis=-1)
    out_m = (walls.keep_m[k] + SPARE_M) / math.cos(math.pi / CORNERS)
    turned = np.array(_CORNER)
    ring_m = out_m[:, None, None] * (turned[:, :1] * axis[:, None] + turned[:, 1:] * across[:, None])
    ends_m = (walls.a_m[:, None] + ring_m, (walls.b_m[:, None] + ring_m)[length > 0])
    corner_m = np.concatenate([end_m.reshape(-1, 2) for end_m in ends_m])
    away_m = point_segment_distance_m(corner_m[:, None], walls.a_m[None], walls.b_m[None])
    free: NDArray[np.bool_] = np.all(away_m >= walls.keep_m[k], axis=1)
    return corner_m[free]
