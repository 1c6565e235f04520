"""The declared path of a vehicle with inertia: the uniform quadratic B-spline of its waypoints."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

V = TypeVar("V", complex, "NDArray[np.float64]")
"""A point: a complex number, or an array of points."""


def declared(before: V, here: V, there: V, share: float) -> V:
    """Return the place on the path in a slot with a step from `here` to `there` after one from `before` to `here`.

    `share` of the slot is over. The weights are never negative and their sum is 1, so the place is inside the triangle
    of the three waypoints (C. de Boor, "A Practical Guide to Splines", 1978).
    """
    return 0.5 * (1 - share) ** 2 * before + (0.5 + share - share**2) * here + 0.5 * share**2 * there
