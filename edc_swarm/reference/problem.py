"""The problem of eq. 14-21, and a bound on the distance that every plan flies."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edc_swarm.errors import InputError
from edc_swarm.geometry import Floats, closest_approach_m, length_m

MOST_UAVS = 6
MOST_REFERENCE_SLOTS = 400
TOLERANCE_M = 1e-6
"""How far two discs may overlap, and a step exceed its limit, in a plan that counts as feasible."""
TAUT_SHARE = 1e-12
"""Share of a squared length below which a relative way is a point."""


@dataclass(frozen=True)
class Problem:
    """K UAVs fly from `start_m` to `target_m`, (K, 2) each, in `slots` slots.

    `r_m` and `u_max_m`, (K,) each, are the radius of each disc and the longest step. Raises InputError for what no plan
    can satisfy, and for more UAVs or slots than the search is made for.
    """

    start_m: Floats
    target_m: Floats
    r_m: Floats
    u_max_m: Floats
    slots: int

    def __post_init__(self) -> None:
        count = len(self.start_m)
        if not 1 <= count <= MOST_UAVS:
            raise InputError("reference.start_m", count, f"1 to {MOST_UAVS} UAVs")
        if not 1 <= self.slots <= MOST_REFERENCE_SLOTS:
            raise InputError("reference.slots", self.slots, f"1 to {MOST_REFERENCE_SLOTS} slots")
        for name, shape in (
            ("start_m", (count, 2)),
            ("target_m", (count, 2)),
            ("r_m", (count,)),
            ("u_max_m", (count,)),
        ):
            value = getattr(self, name)
            if value.shape != shape or not np.isfinite(value).all():
                raise InputError(f"reference.{name}", value.shape, f"finite numbers of shape {shape}")
        if (self.straight_m > self.u_max_m * self.slots).any():
            raise InputError("reference.slots", self.slots, "enough for each UAV to fly straight to its target")
        for name in ("start_m", "target_m"):
            if (length_m(self.between_m(getattr(self, name))) < self.apart_m - TOLERANCE_M).any():
                raise InputError(f"reference.{name}", "discs that overlap", "places at which discs do not overlap")

    @property
    def pairs(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """The pairs k < l, as two arrays of indices (pairs,)."""
        first, second = np.triu_indices(len(self.start_m), 1)
        return first, second

    @property
    def apart_m(self) -> Floats:
        """The least distance r_k + r_l (pairs,) of eq. 16."""
        first, second = self.pairs
        return np.asarray(self.r_m[first] + self.r_m[second])

    @property
    def straight_m(self) -> Floats:
        """The length (K,) of each straight way."""
        return length_m(self.target_m - self.start_m)

    def between_m(self, place_m: Floats) -> Floats:
        """Return the relative positions p_k - p_l, (..., pairs, 2), of places (..., K, 2)."""
        first, second = self.pairs
        return np.asarray(place_m[..., first, :] - place_m[..., second, :])

    def least_gap_m(self, path_m: Floats) -> float:
        """Return the least gap of two discs on a path (slots + 1, K, 2), at any time: eq. 16 between slots as well."""
        first, second = self.pairs
        near_m = closest_approach_m(path_m[:-1, first], path_m[1:, first], path_m[:-1, second], path_m[1:, second])
        return float((near_m - self.apart_m).min(initial=math.inf))

    def allows(self, path_m: Floats) -> bool:
        """Return True if a path (slots + 1, K, 2) keeps eq. 14-21 and no two discs overlap at any time."""
        ends = np.array_equal(path_m[0], self.start_m) and np.array_equal(path_m[-1], self.target_m)
        in_limit = (length_m(np.diff(path_m, axis=0)) <= self.u_max_m + TOLERANCE_M).all()
        return bool(len(path_m) == self.slots + 1 and ends and in_limit and self.least_gap_m(path_m) >= -TOLERANCE_M)

    def bound_m(self) -> float:
        """Return a distance that no plan undercuts, whatever the time it takes.

        Two UAVs together fly at least the way of their relative position, which goes round a disc of radius r_k + r_l;
        and at least their straight ways. The best division of the UAVs into pairs and single ones counts. For two UAVs
        that change places, half of the relative way each is a plan, so the bound is the optimum.
        """
        straight_m = self.straight_m
        pair_m = {
            pair: max(float(straight_m[list(pair)].sum()), taut_m(before, after, apart))
            for pair, before, after, apart in zip(
                zip(*(index.tolist() for index in self.pairs), strict=True),
                self.between_m(self.start_m), self.between_m(self.target_m), self.apart_m.tolist(), strict=True,
            )
        }  # fmt: skip

        def best_m(left: tuple[int, ...]) -> float:
            if not left:
                return 0.0
            one, rest = left[0], left[1:]
            alone_m = float(straight_m[one]) + best_m(rest)
            return max([alone_m, *(pair_m[one, other] + best_m(tuple(set(rest) - {other})) for other in rest)])

        return best_m(tuple(range(len(self.start_m))))


def taut_m(before_m: Floats, after_m: Floats, radius_m: float) -> float:
    """Return the length of the shortest way between two points round the disc of `radius_m` about the origin."""
    way_m = after_m - before_m
    square = float(way_m @ way_m)
    share = min(max(-float(before_m @ way_m) / square, 0.0), 1.0) if square > TAUT_SHARE else 0.0
    if float(length_m(before_m + share * way_m)) >= radius_m:
        return math.sqrt(square)
    turn = abs(math.remainder(heading(after_m) - heading(before_m), math.tau))
    return _taut_m(float(length_m(before_m)), float(length_m(after_m)), radius_m, turn)


def heading(vector: Floats) -> float:
    """Return the direction of a vector (2,), in radians from the x axis."""
    return math.atan2(vector[1], vector[0])


def tangent_m(distance_m: float, radius_m: float) -> tuple[float, float]:
    """Return the length of the tangent from a point to a disc, and the angle at the disc's centre that it spans."""
    return math.sqrt(max(distance_m**2 - radius_m**2, 0.0)), math.acos(min(radius_m / distance_m, 1.0))


def _taut_m(before_m: float, after_m: float, radius_m: float, turn: float) -> float:
    (in_m, in_angle), (out_m, out_angle) = tangent_m(before_m, radius_m), tangent_m(after_m, radius_m)
    return in_m + radius_m * max(turn - in_angle - out_angle, 0.0) + out_m
