"""Simple polygons: the exact test that no two edges meet, in plain Python, since UAVs check zones before they plan."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

Point = tuple[float, float]

ROUNDING = 4e-16
"""Bound on the relative rounding error of a turn (J. R. Shewchuk, Discrete Comput. Geom. 18, 1997, section 4.3)."""


def polygon_fault(corners: Sequence[Point]) -> str:
    """Return why corners (x, y) are no simple polygon, "" if they are one."""
    if len(corners) < 3:
        return f"it has {len(corners)} corners, fewer than three"
    first = dict[Point, int]()
    for index, corner in enumerate(corners):
        if corner in first:
            return f"corners {first[corner]} and {index} are the same point {_shown(corner)}"
        first[corner] = index
    if not any(turn(corners[0], corners[1], corner) for corner in corners):
        return "its corners lie on one line, so its area is zero"
    meeting = _meeting_edges(corners)
    if meeting is None:
        return ""
    one, other = (f"edge {i} (from {_shown(corners[i])} to {_shown(corners[(i + 1) % len(corners)])})" for i in meeting)
    return f"{one} and {other} meet"


def turn(a: Point, b: Point, c: Point) -> int:
    """Return 1 if the way a-b-c turns left, -1 if it turns right, 0 if it is straight; the answer is exact."""
    left, right = (b[0] - a[0]) * (c[1] - a[1]), (b[1] - a[1]) * (c[0] - a[0])
    if abs(left - right) > ROUNDING * (abs(left) + abs(right)):
        return 1 if left > right else -1
    (ax, ay), (bx, by), (cx, cy) = (map(Fraction, point) for point in (a, b, c))
    exact = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    return (exact > 0) - (exact < 0)


def _meeting_edges(corners: Sequence[Point]) -> tuple[int, int] | None:
    """Return two edges that are no neighbours and have a point in common, None for a simple polygon."""
    count = len(corners)
    edges = [(corners[i], corners[(i + 1) % count]) for i in range(count)]
    ordered = sorted(range(count), key=lambda i: min(edges[i][0][0], edges[i][1][0]))
    for place, i in enumerate(ordered):
        right = max(edges[i][0][0], edges[i][1][0])
        for j in ordered[place + 1 :]:
            if min(edges[j][0][0], edges[j][1][0]) > right:
                break
            # Neighbours that lie over each other need no test: the edge after or before them meets one of them too.
            if (i - j) % count not in {1, count - 1} and _meet(edges[i], edges[j]):
                return min(i, j), max(i, j)
    return None


def _meet(one: tuple[Point, Point], other: tuple[Point, Point]) -> bool:
    """Return True if two closed segments have a point in common."""
    (a, b), (c, d) = one, other
    if max(a[1], b[1]) < min(c[1], d[1]) or max(c[1], d[1]) < min(a[1], b[1]):
        return False
    sides = turn(a, b, c), turn(a, b, d), turn(c, d, a), turn(c, d, b)
    if sides[0] * sides[1] < 0 and sides[2] * sides[3] < 0:
        return True
    ends = ((a, b, c), (a, b, d), (c, d, a), (c, d, b))
    return any(side == 0 and _between(*end) for side, end in zip(sides, ends, strict=True))


def _between(a: Point, b: Point, c: Point) -> bool:
    """Return True if `c`, which lies on the line a-b, lies on the segment a-b."""
    return min(a[0], b[0]) <= c[0] <= max(a[0], b[0]) and min(a[1], b[1]) <= c[1] <= max(a[1], b[1])


def _shown(point: Point) -> str:
    return f"({point[0]:g}, {point[1]:g})"
