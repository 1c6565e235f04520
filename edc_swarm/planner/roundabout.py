"""The roundabout: UAVs that would all meet in the middle pass their centre on the same side.

Best responses change one track at a time. If all straight ways lead through one place, each UAV goes round a jam of
tracks that others are about to leave, some to the left and some to the right. So a planner that knows no tracks yet
compares straight ways with roundabouts of several radii, in both senses, for the whole flight and for all UAVs
together, and starts from the cheapest. Ways that cross by chance gain next to nothing by any roundabout, and stay
straight.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from edc_swarm.geometry import Floats, dot, length_m
from edc_swarm.planner import guidance_kernel as kernel
from edc_swarm.planner.roundabout_kernel import entangled
from edc_swarm.solver.normals import DELTA_M

LARGEST_CROWD = 300
"""UAVs beyond which ways stay straight: a comparison looks at all pairs."""
SMALLEST_CROWD = 7
"""UAVs below which they do: up to six are within 3 % of the optimum without (docs/planner.md)."""
CROWDED = 0.25
"""Share of the slots of straight flight that conflicts must cost before a roundabout is looked for."""
LEAST_GAIN = 0.1
"""Share of the price of straight ways by which a roundabout must be cheaper."""
SHARES = (0.1, 0.2, 0.3, 0.4, 0.5)
"""Radii of roundabouts, as shares of the (quadratic) mean distance from the centre of the UAVs that pass it."""


def begin(world: kernel.World, plans: kernel.Plans) -> None:
    """Write the first plans of all UAVs: by way of the roundabout, if there is one, else none."""
    bend_m = roundabout(world.start_m, world.goal_m, world.r_m, world.u_max_m, world.walls, world.barred)
    bends = (bend_m != world.start_m).any(axis=1)
    plans.size[bends] = 1
    plans.slot[bends, 0] = np.ceil(length_m(bend_m - world.start_m) / world.u_max_m)[bends]
    plans.point_m[bends, 0] = bend_m[bends]


def roundabout(
    start_m: Floats, goal_m: Floats, r_m: Floats, u_max_m: Floats, walls: kernel.Walls, barred: kernel.Barred
) -> Floats:
    """Return the point by which each UAV flies to its goal (n, 2): its start if it flies straight."""
    n = len(start_m)
    if n > LARGEST_CROWD:
        return start_m
    # Few UAVs ask too, in vain: a rehearsal before take-off, which has few, calls every compiled function.
    flown, lost = entangled(start_m, start_m, goal_m, r_m, u_max_m)
    best_m, least = start_m, (1 - LEAST_GAIN) * (flown + lost)
    if n < SMALLEST_CROWD or lost < CROWDED * flown:
        return best_m
    length = length_m(goal_m - start_m)
    ahead = (goal_m - start_m) / np.maximum(length, kernel.AT_GOAL_M)[:, None]
    aside = np.stack([ahead[:, 1], -ahead[:, 0]], axis=-1)
    centre_m = _centre(start_m, aside)
    along_m = dot(centre_m - start_m, ahead)
    offset_m = dot(start_m - centre_m, aside)
    passes = (along_m > 0) & (along_m < length)
    far_m = length_m(start_m - centre_m)[passes]
    mean_m = math.sqrt(math.fsum(far_m**2) / max(len(far_m), 1))
    for sense in (1.0, -1.0):
        for share in SHARES:
            lack_m = share * mean_m - sense * offset_m
            bends = passes & (lack_m > 0) & (lack_m < 2 * share * mean_m)
            bend_m = start_m + along_m[:, None] * ahead + (sense * lack_m)[:, None] * aside
            bend_m = np.where(bends[:, None], bend_m, start_m)
            bend_m = np.where(_open(start_m, bend_m, goal_m, r_m, walls, barred)[:, None], bend_m, start_m)
            price = sum(entangled(start_m, bend_m, goal_m, r_m, u_max_m))
            if price < least:
                best_m, least = bend_m, price
    return best_m


def _centre(start_m: Floats, aside: Floats) -> Floats:
    """Return the point nearest to all straight ways (least squares); the mean start if all are parallel."""
    middle_m = start_m.mean(axis=0)
    off_m = dot(start_m - middle_m, aside)
    (xx, xy), (_, yy) = ((math.fsum(a * b) for b in aside.T) for a in aside.T)
    x, y = (math.fsum(off_m * a) for a in aside.T)
    square = xx * yy - xy * xy
    if square <= 1e-6 * (xx + yy) ** 2:
        return np.asarray(middle_m)
    return np.asarray(middle_m + np.array([yy * x - xy * y, xx * y - xy * x]) / square)


def _open(
    start_m: Floats, bend_m: Floats, goal_m: Floats, r_m: Floats, walls: kernel.Walls, barred: kernel.Barred
) -> NDArray[np.bool_]:
    """Return a mask of the UAVs whose two legs are clear of hulls and barriers."""
    there, on = np.empty(len(r_m), np.bool_), np.empty(len(r_m), np.bool_)
    kernel.clear_ways(walls, barred, DELTA_M, start_m, bend_m, r_m, there)
    kernel.clear_ways(walls, barred, DELTA_M, bend_m, goal_m, r_m, on)
    return there & on
