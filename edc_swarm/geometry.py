"""Exact plane geometry of discs that move along straight lines, vectorised over numpy arrays.

Points are arrays whose last axis holds (x, y) in metres; leading axes broadcast.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

MAX_GRID_CELLS = 1 << 20
MAX_INDEX_CELLS = 256
"""Most cells along one side of an index of barriers."""
DISC_TOLERANCE_M = 1e-9
"""Discs overlap if they are closer than touching by more than this, which is rounding."""
BODY_TOLERANCE_M = 1e-6
"""Bodies touch if they are closer than touching by more than this; true positions are rounded more often."""


def length_m(vectors_m: ArrayLike) -> Floats:
    """Return the Euclidean lengths (...,) of vectors (..., 2)."""
    v = np.asarray(vectors_m, dtype=np.float64)
    return np.hypot(v[..., 0], v[..., 1])


def dot(a: Floats, b: Floats) -> Floats:
    """Return the inner products (...,) of vectors (..., 2)."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1]


def by_libm(function: Callable[..., float], *values: ArrayLike) -> Floats:
    """Return a function of `math`, element by element.

    The last bit of numpy's own sines, arcs and powers depends on the width of the processor's registers,
    so a seed would not give the same mission on every machine.
    """
    return np.asarray(np.frompyfunc(function, len(values), 1)(*values), dtype=np.float64)


def rotated(vectors: Floats, cos: Floats, sin: Floats) -> Floats:
    """Return vectors (..., 2) turned counter-clockwise by angles (...,) with these cosines and sines."""
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)


def nearest_on_segment(point_m: ArrayLike, a_m: ArrayLike, b_m: ArrayLike) -> Floats:
    """Return the point (..., 2) of the segment a-b nearest to `point_m`; a = b is allowed."""
    point, a, b = (np.asarray(v, dtype=np.float64) for v in (point_m, a_m, b_m))
    along = b - a
    squared = dot(along, along)
    share = np.clip(dot(point - a, along) / np.where(squared > 0, squared, 1.0), 0.0, 1.0)
    return np.where(share[..., None] == 1.0, b, a + share[..., None] * along)


def point_segment_distance_m(point_m: ArrayLike, a_m: ArrayLike, b_m: ArrayLike) -> Floats:
    """Return the distance (...,) from `point_m` to the segment a-b."""
    return length_m(np.asarray(point_m, dtype=np.float64) - nearest_on_segment(point_m, a_m, b_m))


def capsule_distance_m(point_m: ArrayLike, a_m: ArrayLike, b_m: ArrayLike, radius_m: ArrayLike) -> Floats:
    """Return the distance (...,) from `point_m` to a hull: all points within `radius_m` of the segment a-b.

    It is below 0 inside. A target is clear of a hull if this is at least the sum of the two UAVs' GPS radii.
    """
    return point_segment_distance_m(point_m, a_m, b_m) - np.asarray(radius_m, dtype=np.float64)


def closest_approach_m(from_a_m: ArrayLike, to_a_m: ArrayLike, from_b_m: ArrayLike, to_b_m: ArrayLike) -> Floats:
    """Return the least distance (...,) of two points that move linearly and simultaneously.

    a(s) = from_a + s (to_a - from_a) and b(s) likewise for s in [0, 1]: the relative motion is a
    straight line too, so the answer is the distance of the origin from a segment.
    """
    start = np.asarray(from_a_m, dtype=np.float64) - np.asarray(from_b_m, dtype=np.float64)
    end = np.asarray(to_a_m, dtype=np.float64) - np.asarray(to_b_m, dtype=np.float64)
    return point_segment_distance_m(np.zeros(2), start, end)


def closest_points_of_segments(a_m: ArrayLike, b_m: ArrayLike, c_m: ArrayLike, d_m: ArrayLike) -> tuple[Floats, Floats]:
    """Return the nearest points, one on the segment a-b and one on c-d, each (..., 2).

    Two segments that do not cross are nearest at an end point of one of them. If they cross,
    both points are the crossing point.
    """
    a, b, c, d = np.broadcast_arrays(*(np.asarray(v, dtype=np.float64) for v in (a_m, b_m, c_m, d_m)))
    on_ab = np.stack([a, b, nearest_on_segment(c, a, b), nearest_on_segment(d, a, b)])
    on_cd = np.stack([nearest_on_segment(a, c, d), nearest_on_segment(b, c, d), c, d])
    best = np.argmin(length_m(on_ab - on_cd), axis=0)[None, ..., None]
    first = np.take_along_axis(on_ab, best, axis=0)[0]
    second = np.take_along_axis(on_cd, best, axis=0)[0]
    crossing, point = _crossing(a, b, c, d)
    return (
        np.where(crossing[..., None], point, first),
        np.where(crossing[..., None], point, second),
    )


def segment_distance_m(a_m: ArrayLike, b_m: ArrayLike, c_m: ArrayLike, d_m: ArrayLike) -> Floats:
    """Return the distance (...,) of the segments a-b and c-d, taken as sets of points."""
    first, second = closest_points_of_segments(a_m, b_m, c_m, d_m)
    return length_m(first - second)


def ray_crosses(point_m: Floats, a_m: Floats, b_m: Floats) -> NDArray[np.bool_]:
    """Return a mask (n, m): True where the ray from a point (n, 2) to the east crosses the segment a-b (m, 2)."""
    y_m = point_m[:, 1:]
    spans = (a_m[:, 1] > y_m) != (b_m[:, 1] > y_m)
    rise_m = np.where(a_m[:, 1] == b_m[:, 1], 1.0, b_m[:, 1] - a_m[:, 1])
    east_m = a_m[:, 0] + (y_m - a_m[:, 1]) / rise_m * (b_m[:, 0] - a_m[:, 0])
    return np.asarray(spans & (point_m[:, :1] < east_m))


def inside_polygon(point_m: Floats, a_m: Floats, b_m: Floats) -> NDArray[np.bool_]:
    """Return a mask (n,) of the points inside the polygon with the edges a-b: a ray crosses an odd number of them.

    A point on the boundary counts as either.
    """
    return np.asarray(ray_crosses(point_m, a_m, b_m).sum(axis=1) % 2 == 1)


def near_pairs(points_m: ArrayLike, reach_m: float) -> tuple[Indices, Indices]:
    """Return index pairs i < j with |p_i - p_j| <= reach, in lexicographic order.

    The search sorts points into square cells of side `reach`; a pair within reach lies in the same or in
    adjoining cells. Needs finite points; works in O(K + pairs).
    """
    points = np.asarray(points_m, dtype=np.float64).reshape(-1, 2)
    if len(points) < 2:
        return np.empty(0, np.int64), np.empty(0, np.int64)
    i, j = _candidates(points, reach_m) if len(points) > 120 else np.triu_indices(len(points), 1)
    near = length_m(points[i] - points[j]) <= reach_m
    return i[near], j[near]


def _candidates(points: Floats, reach_m: float) -> tuple[Indices, Indices]:
    """Return pairs i < j of the same or adjoining cells, in lexicographic order."""
    low = points.min(axis=0)
    extent_m = float((points.max(axis=0) - low).max())
    side_m = max(reach_m, extent_m / math.isqrt(MAX_GRID_CELLS), np.finfo(np.float64).tiny)
    cell = np.floor((points - low) / side_m).astype(np.int64)
    width = int(cell[:, 1].max()) + 3
    key = cell[:, 0] * width + cell[:, 1]
    order = np.argsort(key, kind="stable")
    sorted_key = key[order]
    pairs = [_expand(order, sorted_key, key, shift) for shift in (0, 1, width - 1, width, width + 1)]
    first, second = (np.concatenate(side) for side in zip(*pairs, strict=True))
    count = len(points)
    chosen = np.unique(np.minimum(first, second) * count + np.maximum(first, second))
    chosen = chosen[chosen // count != chosen % count]
    return chosen // count, chosen % count


def _expand(order: Indices, sorted_key: Indices, key: Indices, shift: int) -> tuple[Indices, Indices]:
    """Return every (i, j) such that the cell of j is the cell of i moved by `shift`."""
    begin = np.searchsorted(sorted_key, key + shift, side="left")
    count = np.searchsorted(sorted_key, key + shift, side="right") - begin
    first = np.repeat(np.arange(len(key)), count)
    offset = np.arange(len(first)) - np.repeat(np.cumsum(count) - count, count)
    return first, order[np.repeat(begin, count) + offset]


@dataclass(frozen=True, slots=True)
class Barriers:
    """The m barriers of a mission as arrays: all points within `radius_m` (m,) of the segments a-b (m, 2), in metres.

    A step of a UAV with radius r stays at least `radius_m`, and where `keeps_disc` (m,) `radius_m` + r, from each
    segment. `side` (m, 2) is the unit normal of an edge that points into the airspace, zero for a circle. `zone` (m,)
    is the number of the barrier's zone, in increasing order, and `kept_in` (m,) is True at a zone that UAVs do not
    leave.
    """

    a_m: Floats
    b_m: Floats
    radius_m: Floats
    keeps_disc: NDArray[np.bool_]
    side: Floats
    zone: Indices
    kept_in: NDArray[np.bool_]

    @staticmethod
    def none() -> Barriers:
        """Return no barrier."""
        points_m, flags = np.empty((0, 2)), np.empty(0, dtype=bool)
        return Barriers(points_m, points_m, np.empty(0), flags, points_m, np.empty(0, np.int64), flags)

    def least_m(self, r_m: Floats) -> Floats:
        """Return the least distances (n, m) that UAVs with these radii (n,) keep from the segments."""
        return np.asarray(self.radius_m + self.keeps_disc * r_m[:, None])

    def airspace_contains(self, point_m: Floats) -> NDArray[np.bool_]:
        """Return a mask (n,) of the points inside all zones that keep UAVs in, and outside all others."""
        inside = np.ones(len(point_m), dtype=bool)
        starts = np.flatnonzero(np.diff(self.zone, prepend=-1))
        if not len(starts):
            return inside
        crosses = ray_crosses(point_m, self.a_m, self.b_m)
        odd = np.add.reduceat(crosses, starts, axis=1, dtype=np.int64) % 2 == 1
        circle = self.radius_m[starts] > 0
        in_circle = length_m(point_m[:, None] - self.a_m[starts][None]) < self.radius_m[starts]
        within = np.where(circle, in_circle, odd)
        return np.asarray((within == self.kept_in[starts]).all(axis=1))


@dataclass(frozen=True, slots=True)
class BarrierIndex:
    """Square cells of `side_m` from the corner `low_m`, with the barriers near each.

    The barriers near cell (i, j) are `which[begin[c]:begin[c + 1]]` with c = i * `columns` + j. The cells at the
    border have none, and no barrier is near a point outside.
    """

    low_m: tuple[float, float]
    side_m: float
    rows: int
    columns: int
    begin: Indices
    which: Indices

    def near(self, points_m: Floats) -> tuple[Indices, Indices]:
        """Return the pairs (point, barrier) that are near each other, for points (n, 2)."""
        cell = np.floor((points_m - self.low_m) / self.side_m)
        within: NDArray[np.bool_] = np.all((cell >= 0) & (cell < (self.rows, self.columns)), axis=1)
        cell = np.where(within[:, None], cell, 0).astype(np.int64)
        key = cell[:, 0] * self.columns + cell[:, 1]
        count = np.where(within, self.begin[key + 1] - self.begin[key], 0)
        return np.repeat(np.arange(len(key)), count), self.which[_runs(self.begin[key], count)]


def indexed(barriers: Barriers, reach_m: Floats) -> BarrierIndex:
    """Return the index in which a barrier is near all cells that have a point within `reach_m` (m,) of its segment.

    It takes O(m (rows + columns)) time and space, and has at most `MAX_INDEX_CELLS` rows and columns.
    """
    a_m, b_m = barriers.a_m, barriers.b_m
    if not len(a_m):
        return BarrierIndex((0.0, 0.0), 1.0, 1, 1, np.zeros(2, np.int64), np.empty(0, np.int64))
    reach_m = reach_m * (1 + 1e-9) + 1e-6
    least_m, most_m = np.minimum(a_m, b_m) - reach_m[:, None], np.maximum(a_m, b_m) + reach_m[:, None]
    extent_m = float((most_m.max(axis=0) - least_m.min(axis=0)).max())
    side_m = max(float(reach_m.max()) / 2, extent_m / MAX_INDEX_CELLS)
    low_m = least_m.min(axis=0) - side_m
    rows, columns = (np.floor((most_m.max(axis=0) - low_m) / side_m).astype(np.int64) + 2).tolist()
    first, last = (np.floor((x_m - low_m[0]) / side_m).astype(np.int64) for x_m in (least_m[:, 0], most_m[:, 0]))
    # One entry for each barrier and row that it is near, then one for each cell of that row.
    which = np.repeat(np.arange(len(a_m)), last - first + 1)
    row = _runs(first, last - first + 1)
    west_m = low_m[0] + row * side_m - reach_m[which]
    y_m = _clipped(a_m[which], b_m[which], west_m, west_m + side_m + 2 * reach_m[which])
    bounds = np.floor((y_m + np.stack([-reach_m[which], reach_m[which]]) - low_m[1]) / side_m).astype(np.int64)
    begin, count = bounds[0], bounds[1] - bounds[0] + 1
    cell = np.repeat(row * columns, count) + _runs(begin, count)
    order = np.argsort(cell, kind="stable")
    start = np.searchsorted(cell[order], np.arange(rows * columns + 1))
    return BarrierIndex(
        (float(low_m[0]), float(low_m[1])), side_m, rows, columns, start, np.repeat(which, count)[order]
    )


def _clipped(a_m: Floats, b_m: Floats, west_m: Floats, east_m: Floats) -> Floats:
    """Return the least and greatest y (2, p) of the segments' parts between two x."""
    along_m = b_m - a_m
    flat = along_m[:, 0] == 0
    pace = np.where(flat, 1.0, along_m[:, 0])
    share = np.clip(np.stack([west_m - a_m[:, 0], east_m - a_m[:, 0]]) / pace, 0.0, 1.0)
    y_m = a_m[:, 1] + np.where(flat, [[0.0], [1.0]], share) * along_m[:, 1]
    return np.asarray(np.sort(y_m, axis=0))


def _runs(begin: Indices, count: Indices) -> Indices:
    """Return begin[0], begin[0] + 1, ... (count[0] numbers), then those from begin[1], and so on."""
    return np.arange(count.sum()) + np.repeat(begin - np.cumsum(count) + count, count)


def _crossing(a: Floats, b: Floats, c: Floats, d: Floats) -> tuple[NDArray[np.bool_], Floats]:
    """Return a mask of the segments that cross properly, and their crossing points (undefined elsewhere)."""
    ab, cd, ac = b - a, d - c, c - a
    det = ab[..., 0] * cd[..., 1] - ab[..., 1] * cd[..., 0]
    safe = np.where(det != 0, det, 1.0)
    s = (ac[..., 0] * cd[..., 1] - ac[..., 1] * cd[..., 0]) / safe
    t = (ac[..., 0] * ab[..., 1] - ac[..., 1] * ab[..., 0]) / safe
    inside = (det != 0) & (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1)
    return inside, a + s[..., None] * ab
