"""Exact plane geometry of discs that move along straight lines, vectorised over numpy arrays.

Points are arrays whose last axis holds (x, y) in metres; leading axes broadcast.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

MAX_GRID_CELLS = 1 << 20
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


def _crossing(a: Floats, b: Floats, c: Floats, d: Floats) -> tuple[NDArray[np.bool_], Floats]:
    """Return a mask of the segments that cross properly, and their crossing points (undefined elsewhere)."""
    ab, cd, ac = b - a, d - c, c - a
    det = ab[..., 0] * cd[..., 1] - ab[..., 1] * cd[..., 0]
    safe = np.where(det != 0, det, 1.0)
    s = (ac[..., 0] * cd[..., 1] - ac[..., 1] * cd[..., 0]) / safe
    t = (ac[..., 0] * ab[..., 1] - ac[..., 1] * ab[..., 0]) / safe
    inside = (det != 0) & (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1)
    return inside, a + s[..., None] * ab
