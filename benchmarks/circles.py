"""The least distance found for UAVs that change places across a circle within a time, beside what `edc` flies.

    python benchmarks/circles.py                           K = 20 in 1.6 and 2 times the least makespan: minutes
    python benchmarks/circles.py --ratios 1.3 --together   only apart if all fly their steps evenly

Descent (L-BFGS) on whole tracks from random starts: the price is their length, and penalties for steps that are too
long and for pairs that come too near. By default these are all pairs of places within two steps, as for planner
`edc`, whose steps are safe in every uneven execution; with --together only the places at the same time. The tracks
of a few UAVs are free, and those of the others are these, turned about the centre. A flight that it finds is
flyable to within 2 %; where it finds none, that proves nothing.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.optimize import minimize

from edc_swarm.geometry import Floats, Indices, length_m
from edc_swarm.mission.configuration import Mission

STAGES = ((0.05, 100), (0.3, 200), (2.0, 300), (20.0, 500), (200.0, 500))
"""Weights of the penalties, and the iterations with each."""
SPARE_M = 0.03
"""Distance by which the penalty begins before two discs touch."""
LEAST_SHARE, MOST_SHARE = 0.99, 1.02
"""Shares of the distance and of the longest step that count, since penalties give way a little."""
SMOOTH_M = 0.05


@dataclass(frozen=True)
class Circle:
    """The task: free tracks from `start_m` (c, 2) to the opposite side in `slots` steps of at most `step_m`.

    Pair p is tracks `one[p]` and `other[p]`, the latter turned by `turn[p]` (2, 2); `twice` is 1/2 where it counts
    twice.
    """

    start_m: Floats
    slots: int
    step_m: float
    apart_m: float
    together: bool
    one: Indices
    other: Indices
    turn: Floats
    twice: Floats

    def tracks_m(self, variables: Floats) -> Floats:
        """Return the tracks (c, slots + 1, 2)."""
        inner_m = variables.reshape(len(self.start_m), self.slots - 1, 2)
        return np.concatenate([self.start_m[:, None], inner_m, -self.start_m[:, None]], axis=1)

    def nearest(self, track_m: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the least difference (p, slots, 2) of each pair in each slot, and the shares of the steps there."""
        mine, theirs = track_m[self.one], np.einsum("pij,ptj->pti", self.turn, track_m[self.other])
        apart_m, by_mine, by_theirs = (mine - theirs)[:, :-1], np.diff(mine, axis=1), -np.diff(theirs, axis=1)
        ways = (
            [(apart_m, by_mine + by_theirs, 1, 1, 0, 0)]
            if self.together
            else [
                (apart_m, by_mine, 1, 0, 0, 0),
                (apart_m, by_theirs, 0, 1, 0, 0),
                (apart_m + by_theirs, by_mine, 1, 0, 0, 1),
                (apart_m + by_mine, by_theirs, 0, 1, 1, 0),
            ]
        )
        least: list[Floats] = []
        for begin_m, along_m, slope, other_slope, share, other_share in ways:
            square = (along_m**2).sum(axis=-1) + 1e-12
            place = np.clip(-(begin_m * along_m).sum(axis=-1) / square, 0.0, 1.0)
            found = [begin_m + place[..., None] * along_m, slope * place + share, other_slope * place + other_share]
            if not least:
                least = found
                continue
            nearer = (found[0] ** 2).sum(axis=-1) < (least[0] ** 2).sum(axis=-1)
            least = [
                np.where(nearer[..., None] if new.ndim == 3 else nearer, new, old)
                for new, old in zip(found, least, strict=True)
            ]
        return least[0], least[1], least[2]

    def price(self, variables: Floats, weight: float) -> tuple[float, Floats]:
        """Return the length with penalties, and its gradient."""
        track_m = self.tracks_m(variables)
        slope = np.zeros_like(track_m)
        step = np.diff(track_m, axis=1)
        long_m = np.sqrt((step**2).sum(axis=-1) + SMOOTH_M**2)
        over_m = np.maximum(long_m - self.step_m, 0.0)
        pull = ((1 + 2 * weight * over_m) / long_m)[..., None] * step
        slope[:, 1:] += pull
        slope[:, :-1] -= pull
        difference, share, other_share = self.nearest(track_m)
        near_m = np.sqrt((difference**2).sum(axis=-1) + 1e-12)
        lack_m = np.maximum(self.apart_m + SPARE_M - near_m, 0.0)
        push = -(2 * weight * self.twice[:, None] * lack_m / near_m)[..., None] * difference
        mine, theirs = np.zeros((2, len(self.one), self.slots + 1, 2))
        mine[:, :-1] += push * (1 - share)[..., None]
        mine[:, 1:] += push * share[..., None]
        theirs[:, :-1] -= push * (1 - other_share)[..., None]
        theirs[:, 1:] -= push * other_share[..., None]
        np.add.at(slope, self.one, mine)
        np.add.at(slope, self.other, np.einsum("pji,ptj->pti", self.turn, theirs))
        total = long_m.sum() + weight * ((over_m**2).sum() + (self.twice[:, None] * lack_m**2).sum())
        return float(total), slope[:, 1:-1].ravel()


def circle_of(uavs: int, fold: int, ratio: float, together: bool) -> Circle:
    """Return the task for the circle of `benchmarks/planner.py`."""
    mission = Mission(uavs=uavs)
    radius_m = max(40.0, 10.5 * uavs / (2 * math.pi))
    free = uavs // fold
    angle = np.arange(free) * 2 * math.pi / uavs
    cos, sin = (f(np.arange(fold) * 2 * math.pi / fold) for f in (np.cos, np.sin))
    turn = np.stack([np.stack([cos, -sin], axis=-1), np.stack([sin, cos], axis=-1)], axis=-2)
    pairs = [
        (a, b, t) for a in range(free) for b in range(a, free) for t in range(fold) if a != b or 0 < t <= fold // 2
    ]
    one, other, turned = np.array(pairs).T
    half = (one == other) & (2 * turned == fold)
    start_m = radius_m * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    slots = round(ratio * 2 * radius_m / mission.u_max_m)
    return Circle(
        start_m, slots, mission.u_max_m, 2 * mission.r_m, together, one, other, turn[turned], np.where(half, 0.5, 1.0)
    )


def descend(circle: Circle, seed: int) -> float | None:
    """Return the extra distance, in %, of what one random start leads to; None if it breaks a limit."""
    random = np.random.default_rng(seed)
    straight_m = 2 * length_m(circle.start_m)
    spare = circle.slots - straight_m / circle.step_m
    delay = random.uniform(0.0, 1.0, len(spare)) * spare
    share = np.clip((np.arange(circle.slots + 1) - delay[:, None]) / (circle.slots - spare)[:, None], 0.0, 1.0)
    # More often than not all pass the centre on the same side.
    side = np.ones(len(spare)) if random.random() < 0.6 else random.choice([-1.0, 1.0], len(spare))
    aside_m = side * random.uniform(0.0, 0.5, len(spare))
    across_m = circle.start_m @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    track_m = (
        circle.start_m[:, None] * (1 - 2 * share)[..., None]
        + (aside_m[:, None] * np.sin(math.pi * share))[..., None] * across_m[:, None]
    )
    variables = (track_m[:, 1:-1] + random.normal(0.0, 0.3, track_m[:, 1:-1].shape)).ravel()
    for weight, iterations in STAGES:
        price = partial(circle.price, weight=weight)
        variables = minimize(
            price, variables, jac=True, method="L-BFGS-B", options={"maxiter": iterations, "maxcor": 20}
        ).x
    track_m = circle.tracks_m(variables)
    step_m = length_m(np.diff(track_m, axis=1))
    near_m = float(length_m(circle.nearest(track_m)[0]).min())
    if near_m < LEAST_SHARE * circle.apart_m or step_m.max() > MOST_SHARE * circle.step_m:
        return None
    return 100 * (float(step_m.sum() / straight_m.sum()) - 1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--uavs", type=int, default=20)
    parser.add_argument("--folds", type=int, nargs="+", default=[5, 10], help="divisors of K: the symmetries tried")
    parser.add_argument("--ratios", type=float, nargs="+", default=[1.6, 2.0], help="times the least makespan")
    parser.add_argument("--starts", type=int, default=16)
    parser.add_argument("--together", action="store_true", help="apart only at the same time")
    options = parser.parse_args()
    print("| K | symmetry | makespan, times the least | found | least extra distance, % |\n|---|---|---|---|---|")
    for ratio in options.ratios:
        for fold in options.folds:
            if options.uavs % fold:
                parser.error(f"--folds {fold}: not a divisor of {options.uavs}")
            circle = circle_of(options.uavs, fold, ratio, options.together)
            found = [extra for seed in range(options.starts) if (extra := descend(circle, seed)) is not None]
            best = f"{min(found):.1f}" if found else "-"
            print(f"| {options.uavs} | {fold} | {ratio} | {len(found)} of {options.starts} | {best} |", flush=True)


if __name__ == "__main__":
    main()
