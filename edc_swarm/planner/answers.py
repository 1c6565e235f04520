"""Which UAVs of a scene with foreign ones plan anew when they are in conflict."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from edc_swarm.geometry import length_m
from edc_swarm.planner import guidance_kernel as kernel


def answers(world: kernel.World, plans: kernel.Plans, foreign: int) -> NDArray[np.bool_]:
    """(n,) UAVs that answer conflicts: the own ones, and foreign ones with a plan or with a track near an own one.

    How foreign UAVs pass each other is for their own heads to say, and would take a third of the time of a plan.
    """
    count = len(world.track)
    answering = np.ones(count, dtype=bool)
    own = count - foreign
    if foreign:
        low_m, high_m = world.track.min(axis=1), world.track.max(axis=1)
        reach_m = world.r_m[:own, None] + world.r_m[None, own:] + world.rules.delta_m + world.rules.longest_m
        apart_m = np.maximum(low_m[:own, None] - high_m[None, own:], low_m[None, own:] - high_m[:own, None])
        k, other = np.nonzero((apart_m < reach_m[..., None]).all(axis=-1))
        nearest_m = length_m(world.track[k] - world.track[own + other]).min(axis=1)
        answering[own:] = plans.size[own:] > 0
        answering[own + other[nearest_m < reach_m[k, other]]] = True
    return answering
