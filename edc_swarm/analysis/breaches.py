"""Breaches of zones by straight motions: how far, and where on the motion, by the zones' own polygons and circles.

Motions are segments p-q (n, 2) in metres, taken as sets of points, so a verdict holds for any pace. The planner's
barriers (`mission.zones`) have no part in this.
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from edc_swarm.geometry import (
    DISC_TOLERANCE_M,
    inside_polygon,
    nearest_on_segment,
    point_segment_distance_m,
    segment_distance_m,
)
from edc_swarm.mission.zone import Zone

Floats = NDArray[np.float64]

PARTS = 8
"""Parts of a stretch on the wrong side at whose ends its depth is measured."""
_BLOCK = 1 << 18


def breaches(zone: Zone, p_m: Floats, q_m: Floats, keep_m: Floats) -> tuple[Floats, Floats]:
    """Return by how much (n,) each motion breaks the zone at most, and at which share (n,) of the motion.

    `keep_m` (n,) is the distance that the centre keeps from the zone's boundary, on the right side of it. A breach is
    negative, or at least `-keep_m`, for a motion that keeps to the zone; its exact value then has no meaning.
    """
    if not zone.polygon:
        return _of_circle(zone, p_m, q_m, keep_m)
    found = [np.empty((2, 0))]
    block = max(1, _BLOCK // len(zone.polygon))
    for begin in range(0, len(p_m), block):
        rows = slice(begin, begin + block)
        found.append(np.stack(_of_polygon(zone, p_m[rows], q_m[rows], keep_m[rows])))
    breach_m, share = np.concatenate(found, axis=1)
    return breach_m, share


def _of_circle(zone: Zone, p_m: Floats, q_m: Floats, keep_m: Floats) -> tuple[Floats, Floats]:
    """Return breach and share at a circle: exclusion counts the nearest point, inclusion the farther end."""
    centre_m = np.array(zone.centre)
    if zone.kind == "exclusion":
        share = _share(p_m, q_m, nearest_on_segment(centre_m, p_m, q_m))
        return zone.radius_m + keep_m - point_segment_distance_m(centre_m, p_m, q_m), share
    ends_m = np.stack([np.hypot(*(end_m - centre_m).T) for end_m in (p_m, q_m)])
    return ends_m.max(axis=0) + keep_m - zone.radius_m, ends_m.argmax(axis=0).astype(np.float64)


def _of_polygon(zone: Zone, p_m: Floats, q_m: Floats, keep_m: Floats) -> tuple[Floats, Floats]:
    """Return breach and share at a polygon.

    A motion that does not touch the boundary is on one side of it. One that does is cut where it meets the boundary,
    and each stretch is judged.
    """
    a_m = np.array(zone.polygon, dtype=np.float64)
    b_m = np.roll(a_m, -1, axis=0)
    from_p_m = point_segment_distance_m(p_m[:, None], a_m, b_m).min(axis=1)
    near = from_p_m <= np.hypot(*(q_m - p_m).T) + keep_m + 1e-6
    gap_m = from_p_m.copy()
    gap_m[near] = segment_distance_m(p_m[near][:, None], q_m[near][:, None], a_m, b_m).min(axis=1)
    wrong = inside_polygon(p_m, a_m, b_m) != (zone.kind == "inclusion")
    breach_m = np.where(wrong, keep_m + from_p_m, keep_m - gap_m)
    share = np.zeros(len(p_m))
    for row in np.flatnonzero((gap_m <= DISC_TOLERANCE_M) | (breach_m > DISC_TOLERANCE_M)):
        breach_m[row], share[row] = _of_one(zone, a_m, b_m, p_m[row], q_m[row], float(keep_m[row]))
    return breach_m, share


def _of_one(zone: Zone, a_m: Floats, b_m: Floats, p_m: Floats, q_m: Floats, keep_m: float) -> tuple[float, float]:
    """Return breach and share of one motion: its greatest depth on the wrong side, or its least distance else."""
    cut = np.unique(np.concatenate([[0.0, 1.0], _crossings(p_m, q_m, a_m, b_m)]))
    share = np.unique(np.concatenate([np.linspace(s, t, PARTS + 1) for s, t in itertools.pairwise(cut)]))
    point_m = p_m + share[:, None] * (q_m - p_m)
    away_m = point_segment_distance_m(point_m[:, None], a_m, b_m).min(axis=1)
    depth_m = np.where(inside_polygon(point_m, a_m, b_m) != (zone.kind == "inclusion"), away_m, -away_m)
    deepest = int(np.argmax(depth_m))
    if depth_m[deepest] > 0:
        return keep_m + float(depth_m[deepest]), float(share[deepest])
    nearest = int(np.argmin(segment_distance_m(p_m, q_m, a_m, b_m)))
    gap_m = float(segment_distance_m(p_m, q_m, a_m[nearest], b_m[nearest]))
    ends_m = np.array([p_m, q_m, *(nearest_on_segment(end, p_m, q_m) for end in (a_m[nearest], b_m[nearest]))])
    at = int(np.argmin(point_segment_distance_m(ends_m, a_m[nearest], b_m[nearest])))
    return keep_m - gap_m, float(_share(p_m[None], q_m[None], ends_m[at][None])[0])


def _crossings(p_m: Floats, q_m: Floats, a_m: Floats, b_m: Floats) -> Floats:
    """Return the shares of the motion p-q at which it meets the edges a-b, or passes nearest to their corners."""
    along_m, edge_m, to_m = q_m - p_m, b_m - a_m, a_m - p_m
    det = along_m[0] * edge_m[:, 1] - along_m[1] * edge_m[:, 0]
    safe = np.where(det != 0, det, 1.0)
    meets = np.where(det != 0, (to_m[:, 0] * edge_m[:, 1] - to_m[:, 1] * edge_m[:, 0]) / safe, 0.0)
    corners = _share(p_m, q_m, nearest_on_segment(a_m, p_m, q_m))
    return np.asarray(np.clip(np.concatenate([meets, corners]), 0.0, 1.0))


def _share(p_m: Floats, q_m: Floats, point_m: Floats) -> Floats:
    """Return the shares (n,) of the motions p-q at which they are at these points of them."""
    along_m = q_m - p_m
    squared = (along_m**2).sum(axis=-1)
    return np.asarray(((point_m - p_m) * along_m).sum(axis=-1) / np.where(squared > 0, squared, 1.0))
