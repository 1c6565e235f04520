"""Least distances of moving pairs over a whole mission, by a broad and an exact phase.

Arrays are (S, K, 2) in metres: K points over S slots; within a slot all move linearly and together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edc_swarm.geometry import closest_approach_m, segment_distance_m

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_BLOCK = 1 << 19


@dataclass(frozen=True, slots=True)
class Encounters:
    """Pairs (indices, first < second) of UAVs in a slot, with their least gap in it.

    `gap_m` is distance minus the sum of the two radii: negative where discs overlap.
    """

    slot: Ints
    first: Ints
    second: Ints
    gap_m: Floats


def encounters(from_m: Floats, to_m: Floats, radius_m: Floats, below_m: float) -> Encounters:
    """Return the pairs whose discs come closer than a gap of `below_m`, by exact closest approach."""
    slot, first, second, sum_m = _candidates(from_m, to_m, radius_m, below_m)
    ends = (from_m[slot, first], to_m[slot, first], from_m[slot, second], to_m[slot, second])
    return _kept(slot, first, second, closest_approach_m(*ends) - sum_m, below_m)


def swept_encounters(from_m: Floats, to_m: Floats, radius_m: Floats, below_m: float) -> Encounters:
    """Return the pairs whose segments come closer than a gap of `below_m`, at any pace of either UAV."""
    slot, first, second, sum_m = _candidates(from_m, to_m, radius_m, below_m)
    ends = (from_m[slot, first], to_m[slot, first], from_m[slot, second], to_m[slot, second])
    return _kept(slot, first, second, segment_distance_m(*ends) - sum_m, below_m)


def least_gap_m(from_m: Floats, to_m: Floats, radius_m: Floats) -> float:
    """Return the least gap of any two discs in any slot; NaN for fewer than two UAVs, or no slot."""
    if not from_m.size or from_m.shape[1] < 2:
        return float("nan")
    bound_m = _sampled_gap_m(from_m, radius_m)
    found = encounters(from_m, to_m, radius_m, np.nextafter(bound_m, np.inf))
    least_m = float(np.min(found.gap_m, initial=bound_m))
    return least_m if np.isfinite(least_m) else float("nan")


def least_gaps_m(from_m: Floats, to_m: Floats, radius_m: Floats) -> Floats:
    """Return (S,) least gaps of any two discs in each slot; NaN for fewer than two UAVs with known (not NaN) places."""
    first, second = np.triu_indices(len(radius_m), 1)
    least_m = np.full(len(from_m), np.nan)
    if len(first):
        sum_m = radius_m[first] + radius_m[second]
        for slot, (a_m, b_m) in enumerate(zip(from_m, to_m, strict=True)):
            least_m[slot] = np.fmin.reduce(closest_approach_m(a_m[first], b_m[first], a_m[second], b_m[second]) - sum_m)
    return least_m


def closest_moment(from_m: Floats, to_m: Floats, slot: int, first: int, second: int) -> float:
    """Return the share of the slot, in [0, 1], at which two points that move simultaneously are closest."""
    apart_m = from_m[slot, first] - from_m[slot, second]
    closing_m = (to_m[slot, first] - to_m[slot, second]) - apart_m
    squared = float(closing_m @ closing_m)
    return float(np.clip(-(apart_m @ closing_m) / squared, 0.0, 1.0)) if squared > 0 else 0.0


def _sampled_gap_m(points_m: Floats, radius_m: Floats) -> float:
    """Return the least gap at the start of every 16th slot, an upper bound on the least gap."""
    first, second = np.triu_indices(points_m.shape[1], 1)
    sum_m, least_m = radius_m[first] + radius_m[second], np.inf
    for x_m, y_m in np.moveaxis(points_m[::16], 2, 1):
        gap_m = np.hypot(x_m[first] - x_m[second], y_m[first] - y_m[second]) - sum_m
        least_m = float(np.fmin.reduce(gap_m, initial=least_m))
    return least_m


def _candidates(from_m: Floats, to_m: Floats, radius_m: Floats, below_m: float) -> tuple[Ints, Ints, Ints, Floats]:
    """Return slot, first, second and radius sum of all pairs that could come closer than `below_m`.

    Two points that are d apart at the start and fly a and b come no closer than d - a - b. A pair with an unknown
    (NaN) position is never a candidate.
    """
    slots, count, _ = from_m.shape
    first, second = np.triu_indices(count, 1)
    way_m = np.hypot(to_m[..., 0] - from_m[..., 0], to_m[..., 1] - from_m[..., 1])
    reach_m = way_m + radius_m
    found: list[tuple[Ints, Ints]] = []
    block = max(1, _BLOCK // max(1, len(first)))
    for begin in range(0, slots, block):
        rows = slice(begin, begin + block)
        x_m, y_m, far_m = from_m[rows, :, 0], from_m[rows, :, 1], reach_m[rows]
        dx_m, dy_m = x_m[:, first] - x_m[:, second], y_m[:, first] - y_m[:, second]
        limit_m = np.maximum(far_m[:, first] + far_m[:, second] + below_m, 0.0)
        slot, pair = np.nonzero(dx_m * dx_m + dy_m * dy_m <= limit_m * limit_m * (1 + 1e-12))
        found.append((slot + begin, pair))
    slot, pair = (np.concatenate(part) for part in zip(*found, strict=True)) if found else _nothing()
    first, second = first[pair], second[pair]
    return slot, first, second, radius_m[first] + radius_m[second]


def _nothing() -> tuple[Ints, Ints]:
    return np.empty(0, np.int64), np.empty(0, np.int64)


def _kept(slot: Ints, first: Ints, second: Ints, gap_m: Floats, below_m: float) -> Encounters:
    near = gap_m < below_m
    return Encounters(slot[near], first[near], second[near], gap_m[near])
