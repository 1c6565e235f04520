"""Gaps between discs."""

from __future__ import annotations

import math
from dataclasses import dataclass

from edc_swarm.geometry import DISC_TOLERANCE_M
from edc_swarm.viz.shapes import Point


@dataclass(frozen=True, slots=True)
class Gaps:
    """The least gap between two discs (None for fewer than two), and the UAVs with overlapping discs."""

    least_m: float | None
    overlapping: set[str]


def gaps(discs: list[tuple[Point, float, str]]) -> Gaps:
    """Return the gaps between discs (centre, radius, name), by a sweep from left to right that skips distant pairs."""
    ordered = sorted(discs)
    widest_m = max((r_m for _, r_m, _ in ordered), default=0.0)
    least_m, overlapping = math.inf, set[str]()
    for i, ((x_m, y_m), r_m, name) in enumerate(ordered):
        for (other_x_m, other_y_m), other_r_m, other in ordered[i + 1 :]:
            if other_x_m - x_m - r_m - widest_m > max(least_m, 0.0):
                break
            gap_m = math.hypot(other_x_m - x_m, other_y_m - y_m) - r_m - other_r_m
            least_m = min(least_m, gap_m)
            if gap_m < -DISC_TOLERANCE_M:
                overlapping |= {name, other}
    return Gaps(least_m if math.isfinite(least_m) else None, overlapping)
