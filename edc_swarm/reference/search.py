"""The search: from many starts, each with the sides on which pairs pass one another, down to a local optimum.

Eq. 16 is not convex: on which side of p_l UAV k passes, which for crossing ways is who goes first, is a choice per
pair. Each start makes it for all pairs, and lays a taut string round the disc of each pair's relative position on that
side. From there sequential convex programming goes down: the half-planes of one iteration are those of the path before.
A path without overlap never gets longer in that. No start promises the global optimum, so `Reference` also has the
bound that no plan undercuts: where both agree, the reference is the optimum.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edc_swarm.errors import InputError
from edc_swarm.geometry import Floats, length_m, nearest_on_segment
from edc_swarm.reference.problem import Problem, heading, tangent_m
from edc_swarm.reference.program import Objective, Programme, unit

STARTS = 24
MOST_STARTS = 1000
MOST_ITERATIONS = 25
SETTLED_SHARE = 1e-5
"""Share of the distance by which the last iteration of a start has changed it at most."""

Sides = NDArray[np.float64]
"""One number a pair: 1 where the relative position turns to the left about the origin, -1 to the right."""


@dataclass(frozen=True)
class Reference:
    """The best plan that was found, `path_m` (slots + 1, K, 2), verified at every time (`Problem.allows`).

    `bound_m` is a distance that no plan undercuts, `straight_m` that of the straight ways, `least_gap_m` the least gap
    of two discs (infinite for one UAV). `feasible` of the `starts` led to a plan without overlap.
    """

    path_m: Floats
    distance_m: float
    bound_m: float
    straight_m: float
    least_gap_m: float
    starts: int
    feasible: int

    @property
    def squares_m2(self) -> float:
        """The objective of eq. 13."""
        return float((np.diff(self.path_m, axis=0) ** 2).sum())


def solve(
    problem: Problem,
    *,
    objective: Objective = "distance",
    starts: int = STARTS,
    seed: int = 0,
    also: Sequence[Floats] = (),
) -> Reference | None:
    """Return the shortest plan found from `starts` starts; None if none led to a plan without overlap.

    With `objective` "squares" it is the plan with the least objective of eq. 13. `also` has further starts: paths
    (slots + 1, K, 2), such as the flight of a planner, which is never better then. The same arguments give the same
    plan. Source: eq. 13-21 of the paper; sequential convex programming as by F. Augugliaro, A. P. Schoellig,
    R. D'Andrea, "Generation of collision-free trajectories for a quadrocopter fleet", IROS 2012. Raises InputError.
    """
    if not 1 <= starts <= MOST_STARTS:
        raise InputError("reference.starts", starts, f"1 to {MOST_STARTS}")
    programme = Programme(problem, objective)
    search = _Starts(problem, starts, np.random.default_rng(seed))
    best_m: Floats | None = None
    feasible = 0
    for found_m in (_descend(problem, programme, path_m, None) for path_m in also):
        best_m = _better(best_m, found_m, objective)
    for path_m, sides in search:
        found_m = _descend(problem, programme, path_m, sides)
        feasible += found_m is not None
        if (better_m := _better(best_m, found_m, objective)) is not best_m:
            best_m, search.best = better_m, sides
    if best_m is None:
        return None
    return Reference(
        path_m=best_m,
        distance_m=_cost(best_m, "distance"),
        bound_m=problem.bound_m(),
        straight_m=float(problem.straight_m.sum()),
        least_gap_m=problem.least_gap_m(best_m),
        starts=starts,
        feasible=feasible,
    )


def _better(best_m: Floats | None, found_m: Floats | None, objective: Objective) -> Floats | None:
    """Return the better one of two paths, the first one if they are equal."""
    if best_m is None or found_m is None:
        return found_m if best_m is None else best_m
    return found_m if _cost(found_m, objective) < _cost(best_m, objective) else best_m


def _cost(path_m: Floats, objective: Objective) -> float:
    step_m = length_m(np.diff(path_m, axis=0))
    return float((step_m if objective == "distance" else step_m**2).sum())


class _Starts:
    """The starts, as straight paths in some timing and the sides of all pairs.

    First each pair passes on its own side, evenly spaced and at full speed; then all that would overlap turn left, then
    right. The others alternate between one pair on another side than in `best`, and random sides and delays.
    """

    def __init__(self, problem: Problem, starts: int, rng: np.random.Generator) -> None:
        self._problem, self._starts, self._rng = problem, starts, rng
        self.best: Sides | None = None

    def __iter__(self) -> Iterator[tuple[Floats, Sides]]:
        count, rng = len(self._problem.start_m), self._rng
        for number in range(self._starts):
            fast = np.full(count, number == 1) if number < 4 else rng.random(count) < 0.5
            late = np.zeros(count) if number < 4 else rng.random(count) * (rng.random(count) < 0.5)
            path_m = self._straight(fast, late)
            sides, meets = self._own(path_m)
            if number in {2, 3}:
                sides[meets] = 5 - 2 * number
            elif number >= 4 and number % 2 and self.best is not None and meets.any():
                sides = self.best.copy()
                sides[rng.choice(np.flatnonzero(meets))] *= -1
            elif number >= 4:
                sides[meets & (rng.random(len(sides)) < 0.5)] *= -1
            yield path_m, sides

    def _straight(self, fast: NDArray[np.bool_], late: Floats) -> Floats:
        """Return straight ways (slots + 1, K, 2): evenly, or `fast` after a share `late` of the spare time."""
        problem = self._problem
        lasts = np.where(fast, np.maximum(problem.straight_m / problem.u_max_m, 1.0), problem.slots)
        begins = late * (problem.slots - lasts)
        share = np.clip((np.arange(problem.slots + 1)[:, None] - begins) / lasts, 0.0, 1.0)
        return np.asarray(problem.start_m + share[..., None] * (problem.target_m - problem.start_m))

    def _own(self, path_m: Floats) -> tuple[Sides, NDArray[np.bool_]]:
        """Return the side on which each pair passes on straight ways (left if they meet), and who would overlap."""
        between_m = self._problem.between_m(path_m)
        near_m = _nearest(between_m)
        when = length_m(near_m).argmin(axis=0), np.arange(between_m.shape[1])
        way_m, place_m = between_m[-1] - between_m[0], near_m[when]
        turn = place_m[:, 0] * way_m[:, 1] - place_m[:, 1] * way_m[:, 0]
        return np.where(turn < 0, -1.0, 1.0), length_m(place_m) < self._problem.apart_m


def _descend(problem: Problem, programme: Programme, path_m: Floats, sides: Sides | None) -> Floats | None:
    """Return the local optimum below a start, on the sides of the path itself if `sides` is None.

    Return None if it overlaps, or if the solver fails.
    """
    reach_m = 2 * problem.apart_m + 4 * float(problem.u_max_m.max())
    along_path = unit(_nearest(problem.between_m(path_m)))
    normal = along_path if sides is None else _taut_normals(problem, path_m, sides)
    near = np.ones(normal.shape[:2], dtype=np.bool_)
    before_m = math.inf
    for _ in range(MOST_ITERATIONS):
        next_m = programme.solve(normal, near)
        if next_m is None:
            return None
        path_m, length = next_m, _cost(next_m, "distance")
        if abs(before_m - length) <= SETTLED_SHARE * length and problem.allows(path_m):
            break
        before_m = length
        nearest_m = _nearest(problem.between_m(path_m))
        normal, near = unit(nearest_m), length_m(nearest_m) < reach_m
    return path_m if problem.allows(path_m) else None


def _nearest(between_m: Floats) -> Floats:
    """Return where relative positions (slots + 1, pairs, 2) come nearest to the origin in each slot."""
    return nearest_on_segment(np.zeros(2), between_m[:-1], between_m[1:])


def _taut_normals(problem: Problem, path_m: Floats, sides: Sides) -> Floats:
    """Return directions (slots, pairs, 2) of half-planes along the taut strings on the given sides."""
    between_m = problem.between_m(path_m)
    normal = np.empty((problem.slots, len(sides), 2))
    for pair, (side, apart_m) in enumerate(zip(sides.tolist(), problem.apart_m.tolist(), strict=True)):
        normal[:, pair] = _string_normals(between_m[:, pair], apart_m, side)
    return normal


def _string_normals(between_m: Floats, apart_m: float, side: float) -> Floats:
    """Return the directions (slots, 2) for one pair: those of both tangents, and in between those along the arc.

    A string that needs no arc is straight; its half-plane is on the side of its point that is nearest to the origin.
    """
    first, last = between_m[0], between_m[-1]
    (in_m, in_angle), (out_m, out_angle) = (tangent_m(float(length_m(end)), apart_m) for end in (first, last))
    arc = (side * (heading(last) - heading(first))) % math.tau - in_angle - out_angle
    if arc <= 0:
        return np.tile(unit(nearest_on_segment(np.zeros(2), first, last)), (len(between_m) - 1, 1))
    step_m = length_m(np.diff(between_m, axis=0))
    share = (np.cumsum(step_m) - step_m / 2) / max(float(step_m.sum()), 1e-9)
    along_m = share * (in_m + apart_m * arc + out_m)
    angle = heading(first) + side * (in_angle + np.clip((along_m - in_m) / apart_m, 0.0, arc))
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)
