"""The convex programme of one iteration: eq. 13-21 with each disc's complement replaced by half-planes.

    minimise   sum |u_k(t)|        (or eq. 13, sum |u_k(t)|^2)  +  penalty * sum z
    subject to u_k(t) = p_k(t) - p_k(t - 1),  |u_k(t)| <= u_max          (14, 15, 21; ends are fixed: 17-20)
               n_kl(t) . (p_k - p_l) >= R_kl - z_kl(t)   at both ends of slot t, for one direction n_kl(t)   (16)

Both ends of a slot on one side of one line keep the whole of a straight step there, so eq. 16 holds at every time and
not only at t = 1..F. The half-plane is a part of the disc's complement: what satisfies the programme with z = 0
satisfies eq. 16. The solver is Clarabel (extra `reference`), since eq. 21 is a cone.
"""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from edc_swarm.errors import InputError
from edc_swarm.extras import install_command
from edc_swarm.geometry import Floats
from edc_swarm.reference.problem import Problem

Objective = Literal["distance", "squares"]
PENALTY = 10.0
"""Cost of a metre of z, in metres of distance; the tension of two ways that bend about one another is at most 2."""
EVENNESS = 1e-3
"""Weight of the squares of the steps, each over u_max, beside the distance: among ways of one length, the even one."""
_SOLVED = ("Solved", "AlmostSolved")


class Programme:
    """The programme of a problem; `solve` takes the directions of one iteration."""

    def __init__(self, problem: Problem, objective: Objective) -> None:
        try:
            import clarabel  # noqa: PLC0415  (an extra)
        except ImportError:
            raise InputError("reference", "clarabel", f"installed: {install_command('reference')}") from None
        self._clarabel: Any = clarabel
        self._problem = problem
        count, slots = problem.start_m.shape[0], problem.slots
        self._places, self._steps = 2 * count * (slots - 1), count * slots
        forward = scipy.sparse.eye(slots, slots - 1) - scipy.sparse.eye(slots, slots - 1, k=-1)
        step = scipy.sparse.kron(forward, scipy.sparse.identity(2 * count), format="csc")
        known_m = np.zeros((slots, count, 2))
        known_m[0] -= problem.start_m
        known_m[-1] += problem.target_m
        weight = (EVENNESS if objective == "distance" else 0.5) / float(problem.u_max_m.mean())
        self._length_cost = 1.0 if objective == "distance" else 0.0
        self._squares = 2 * weight * (step.T @ step)
        self._slope = 2 * weight * (step.T @ known_m.ravel())
        to_cone = scipy.sparse.kron(scipy.sparse.identity(self._steps), np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
        length = scipy.sparse.kron(scipy.sparse.identity(self._steps), np.array([[1.0], [0.0], [0.0]]))
        self._cone_places, self._cone_lengths, self._cone_known = -(to_cone @ step), -length, to_cone @ known_m.ravel()

    def solve(self, normal: Floats, near: NDArray[np.bool_]) -> Floats | None:
        """Return a path (slots + 1, K, 2), which may violate eq. 16; None if the solver fails.

        `normal` (slots, pairs, 2) are unit vectors; rows are made for the slots and pairs in the mask `near`.
        """
        problem, clarabel = self._problem, self._clarabel
        rows, bound, slack = self._rows(normal, near)
        size, most = 2 * slack, scipy.sparse.identity(self._steps)
        relax = scipy.sparse.kron(scipy.sparse.identity(slack), np.ones((2, 1)))
        positive = scipy.sparse.identity(slack)
        blocks: Any = [
            [rows, _zeros(size, self._steps), -relax],
            [_zeros(slack, self._places), _zeros(slack, self._steps), -positive],
            [_zeros(self._steps, self._places), most, _zeros(self._steps, slack)],
            [self._cone_places, self._cone_lengths, _zeros(3 * self._steps, slack)],
        ]
        right = np.concatenate([bound, np.zeros(slack), np.tile(problem.u_max_m, problem.slots), self._cone_known])
        rest = self._steps + slack
        cost = scipy.sparse.block_diag([self._squares, _zeros(rest, rest)], format="csc")
        slope = np.concatenate([self._slope, np.full(self._steps, self._length_cost), np.full(slack, PENALTY)])
        cones = [clarabel.NonnegativeConeT(3 * slack + self._steps)]
        cones += [clarabel.SecondOrderConeT(3)] * self._steps
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        upper = scipy.sparse.csc_matrix(scipy.sparse.triu(cost))
        answer = clarabel.DefaultSolver(
            upper, slope, scipy.sparse.csc_matrix(scipy.sparse.block_array(blocks)), right, cones, settings
        ).solve()
        if str(answer.status) not in _SOLVED:
            return None
        inner_m = np.array(answer.x[: self._places]).reshape(problem.slots - 1, *problem.start_m.shape)
        return np.concatenate([problem.start_m[None], inner_m, problem.target_m[None]])

    def _rows(self, normal: Floats, near: NDArray[np.bool_]) -> tuple[Any, Floats, int]:
        """Return the rows -n.(p_k - p_l) <= bound for positions, their bounds, and the number of slacks.

        Rows 2 i and 2 i + 1 are those of the i-th slot and pair in `near`, at its beginning and its end.
        """
        problem = self._problem
        count = len(problem.start_m)
        slot, pair = np.nonzero(near)
        axes = normal[slot, pair]
        bound = np.empty((len(slot), 2))
        entries: list[tuple[Floats, Any, Any]] = []
        for end in (0, 1):
            place = slot + end
            inner = (place > 0) & (place < problem.slots)
            row = (2 * np.arange(len(slot)) + end)[inner]
            for who, sign in zip(problem.pairs, (-1.0, 1.0), strict=True):
                column = 2 * ((place - 1) * count + who[pair])[inner]
                entries += [(sign * axes[inner, axis], row, column + axis) for axis in (0, 1)]
            fixed_m = problem.between_m(problem.start_m if end == 0 else problem.target_m)[pair]
            bound[:, end] = np.where(inner, 0.0, (axes * fixed_m).sum(axis=1)) - problem.apart_m[pair]
        values, row, column = (np.concatenate(parts) for parts in zip(*entries, strict=True))
        shape = (2 * len(slot), self._places)
        return scipy.sparse.csc_array((values, (row, column)), shape=shape), bound.ravel(), len(slot)


def _zeros(rows: int, columns: int) -> Any:
    return scipy.sparse.csc_array((rows, columns))


def unit(vector: Floats) -> Floats:
    """Return vectors (..., 2) of length 1; those of almost no length stay as they are."""
    length = np.hypot(vector[..., 0], vector[..., 1])
    return np.asarray(vector / np.maximum(length, math.ulp(1.0))[..., None])
