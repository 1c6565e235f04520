"""Compiled comparison of ways with one bend, for all pairs of UAVs: see `edc_swarm.planner.roundabout`."""

from __future__ import annotations

import math

from edc_swarm.planner.compiler import compiled, inner
from edc_swarm.planner.guidance_kernel import Floats, norm, to_segment


@inner
def _on_legs(
    x0: float, y0: float, bx: float, by: float, gx: float, gy: float, bend: float, end: float, slot: float
) -> tuple[float, float]:
    """Return the place in a slot of a flight over two legs, which bends in slot `bend` and ends in slot `end`."""
    if slot >= end:
        return gx, gy
    if slot >= bend:
        share = (slot - bend) / (end - bend)
        return bx + share * (gx - bx), by + share * (gy - by)
    share = slot / bend
    return x0 + share * (bx - x0), y0 + share * (by - y0)


@inner
def _least_distance(start_m: Floats, bend_m: Floats, goal_m: Floats, u_max_m: Floats, k: int, other: int) -> float:
    """Return the least distance of two vehicles that fly by their bends to their goals, at full speed."""
    kx, ky, kbx, kby, kgx, kgy = start_m[k, 0], start_m[k, 1], bend_m[k, 0], bend_m[k, 1], goal_m[k, 0], goal_m[k, 1]
    ox, oy, obx, oby = start_m[other, 0], start_m[other, 1], bend_m[other, 0], bend_m[other, 1]
    ogx, ogy = goal_m[other, 0], goal_m[other, 1]
    k_bend, o_bend = norm(kbx - kx, kby - ky) / u_max_m[k], norm(obx - ox, oby - oy) / u_max_m[other]
    k_end = k_bend + norm(kgx - kbx, kgy - kby) / u_max_m[k]
    o_end = o_bend + norm(ogx - obx, ogy - oby) / u_max_m[other]
    slot, x, y = 0.0, kx - ox, ky - oy
    least = x * x + y * y
    while slot < max(k_end, o_end):
        # Until the next bend or end of one of them, their relative motion is straight.
        after = max(k_end, o_end)
        if slot < k_bend:
            after = min(after, k_bend)
        elif slot < k_end:
            after = min(after, k_end)
        if slot < o_bend:
            after = min(after, o_bend)
        elif slot < o_end:
            after = min(after, o_end)
        ax, ay = _on_legs(kx, ky, kbx, kby, kgx, kgy, k_bend, k_end, after)
        bx, by = _on_legs(ox, oy, obx, oby, ogx, ogy, o_bend, o_end, after)
        least = min(least, to_segment(x, y, ax - bx - x, ay - by - y))
        slot, x, y = after, ax - bx, ay - by
    return math.sqrt(least)


@compiled
def entangled(start_m: Floats, bend_m: Floats, goal_m: Floats, r_m: Floats, u_max_m: Floats) -> tuple[float, float]:
    """Return the slots that all vehicles fly by their bends to their goals, and the slots that conflicts cost them.

    Two vehicles lose the slots in which one of them flies the distance that they lack where they are nearest.
    """
    flown, lost = 0.0, 0.0
    for k in range(len(r_m)):
        x, y = bend_m[k, 0], bend_m[k, 1]
        way = norm(x - start_m[k, 0], y - start_m[k, 1]) + norm(goal_m[k, 0] - x, goal_m[k, 1] - y)
        flown += way / u_max_m[k]
        for other in range(k):
            lack = r_m[k] + r_m[other] - _least_distance(start_m, bend_m, goal_m, u_max_m, k, other)
            lost += max(lack, 0.0) * 2.0 / (u_max_m[k] + u_max_m[other])
    return flown, lost
