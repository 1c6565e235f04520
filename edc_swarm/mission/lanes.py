"""Lanes cut into pieces, and the orders in which UAVs can be in them: a proof that some cannot reach their targets.

A lane is a connected part of the airspace. Pieces, of any shape, cover it. While UAVs fly, each is in a piece, and goes
from it to one that touches it. At no time are two UAVs in pieces of which no two points are R apart, R being the sum of
their radii. So there is a graph: a node is a piece for each UAV, each two of which have points R apart; an edge moves
one UAV to a touching piece. If no chain of edges joins the starts to the targets, no motion in the plane does. (A UAV
on a common edge of pieces is in all of them. So when several UAVs change pieces at once, they also do so one after
another.)

That holds for all pieces, but it proves most with thin ones that lie across the lane: two UAVs are then never in the
same one, and keep their order. Water that rains evenly on the lane and drains at one end flows along it, and its
level is constant across it, also in bends, at ends and in branches. A piece is what lies between two levels. In bad
pieces, two UAVs may be in more states than in the plane: then less is proven.

Cells of a 16th of a radius make up the pieces. At the edge of the airspace, parts of cells count for distances.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import combinations, islice

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import spsolve

from edc_swarm.geometry import Floats, Indices
from edc_swarm.mission.airspace import Airspace
from edc_swarm.mission.field_types import Point
from edc_swarm.mission.roster_entry import ARRIVED_M

Bools = NDArray[np.bool_]
Way = tuple[Point, Point]

FINE = 4
"""Cells along the side of a coarse cell."""
PARTS = 8
"""Parts along the side of a cell at the edge of the airspace."""
THICKNESSES = (0.1, 0.2, 1 / 3, 0.5, 1.0)
"""Thicknesses of pieces in radii, in the order in which they are tried until the graph is small enough."""
MOST_TOGETHER = 4
"""Most UAVs that are looked at together."""
MAX_PLACINGS = 1_000_000
MAX_GROUPS = 20_000
GAP_DIRECTIONS = 64
"""Directions in which the distance of two pieces is measured; an even number."""
ROUNDING_M = 1e-6
HALF_DIAGONAL = math.sqrt(0.5)
_AROUND = np.array([(0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)])
_LEAK = 1e-9


def stuck(lane: Lane, ways: Sequence[Way]) -> tuple[int, ...]:
    """Return the indices of UAVs that cannot all be at their targets, few if few suffice; () if that is not proven.

    Each of `ways` is the start and the target of a UAV.
    """
    for count in range(2, min(len(ways), MOST_TOGETHER) + 1):
        pieces = lane.pieces(count)
        if pieces is None:
            continue
        joined = pieces.joined(count)
        starts = [pieces.near(start, 0.0) for start, _ in ways]
        ends = [pieces.near(end, ARRIVED_M) for _, end in ways]
        for group in islice(combinations(range(len(ways)), count), MAX_GROUPS):
            first = joined[np.ix_(*(starts[k] for k in group))]
            last = joined[np.ix_(*(ends[k] for k in group))]
            if (first >= 0).any() and not np.isin(last, first[first >= 0]).any():
                return group
    return ()


@dataclass(frozen=True, slots=True)
class Lane:
    """The cells of a lane, for UAVs of one radius.

    `side_m` is the side of a cell, `cell` (n, 2) the numbers of the cells, `touching` (n, 8) the index of each cell's
    neighbours, -1 for none; `level` and `slope` (n,) are those of the water, the slope per cell. `point_m` (p, 2) are
    the middles of squares that together hold all points of the airspace, `half_m` (p,) half the sides of these squares,
    and `owner` (p,) the cells that they are parts of.
    """

    r_m: float
    side_m: float
    cell: Indices
    touching: Indices
    level: Floats
    slope: Floats
    point_m: Floats
    half_m: Floats
    owner: Indices

    @classmethod
    def of(cls, airspace: Airspace, coarse: Iterable[tuple[int, int]], coarse_m: float, r_m: float) -> Lane:
        """Return the lane in coarse cells of side `coarse_m`, for UAVs of radius `r_m`."""
        side_m = coarse_m / FINE
        cell = (np.array(sorted(coarse))[:, None] * FINE + _grid(FINE)).reshape(-1, 2)
        room_m = airspace.room_m(_middles(cell, side_m), r_m)
        may_hold = room_m >= -HALF_DIAGONAL * side_m - ROUNDING_M
        cell, room_m = cell[may_hold], room_m[may_hold]
        touching = _touching(cell)
        # Water that drains at one cell has round levels about it. So a whole end of the lane is the drain: the highest
        # piece of the water that drains at the middle, whose levels go on below those of the other water.
        far_level, far_slope = _water(touching, room_m.argmax())
        piece = _cut(touching, far_level, far_slope, THICKNESSES[-1] * r_m / side_m)
        end = piece == piece[far_level.argmax()]
        level, slope = _water(touching, np.flatnonzero(end))
        level[end], slope[end] = far_level[end].min() - far_level[end], far_slope[end]
        point_m, half_m, owner = _squares(airspace, cell, room_m, side_m, r_m)
        return cls(r_m, side_m, cell, touching, level, slope, point_m, half_m, owner)

    def pieces(self, count: int) -> Pieces | None:
        """Return the thinnest pieces whose graph for `count` UAVs is small enough."""
        for thickness in THICKNESSES:
            piece = _cut(self.touching, self.level, self.slope, thickness * self.r_m / self.side_m)
            if (piece.max() + 1) ** count <= MAX_PLACINGS:
                return Pieces.of(self, piece)
        return None


@dataclass(frozen=True, slots=True)
class Pieces:
    """A lane in pieces: `piece` (n,) of each cell, `allowed` (m, m) pairs, and the pairs (2, e) that touch."""

    lane: Lane
    piece: Indices
    allowed: Bools
    touching: Indices

    @classmethod
    def of(cls, lane: Lane, piece: Indices) -> Pieces:
        """Return the pieces of a lane with what is allowed in them."""
        far_m = _far_m(lane, piece)
        at, other = np.repeat(piece, 8), lane.touching.ravel()
        pairs = np.stack([at, piece[other]])[:, other >= 0]
        return cls(lane, piece, far_m >= 2 * lane.r_m - ROUNDING_M, np.unique(pairs[:, pairs[0] < pairs[1]], axis=1))

    def near(self, point_m: Point, within_m: float) -> Indices:
        """Return the pieces that may hold a point within a distance of `point_m`."""
        away_m = np.abs(_middles(self.lane.cell, self.lane.side_m) - point_m).max(axis=1)
        return np.unique(self.piece[away_m <= self.lane.side_m / 2 + within_m + ROUNDING_M])

    def joined(self, count: int) -> Indices:
        """Return (m, ...) a number for each node of the graph of `count` UAVs, equal if a chain joins them.

        -1 is for what is not allowed.
        """
        size = len(self.allowed)
        shape = (size,) * count
        allowed = np.ones(shape, dtype=bool)
        for i, j in combinations(range(count), 2):
            allowed &= self.allowed.reshape([size if axis in (i, j) else 1 for axis in range(count)])
        node = np.flatnonzero(allowed)
        number = np.full(allowed.size, -1, dtype=np.int32)
        number[node] = np.arange(len(node), dtype=np.int32)
        after = _table(self.touching, size)
        edges = []
        for axis in range(count):
            stride = size ** (count - 1 - axis)
            at = node // stride % size
            for to in after[at].T:
                other = np.where(to >= 0, number[node + (to - at) * stride * (to >= 0)], -1)
                edges.append(np.stack([np.flatnonzero(other >= 0), other[other >= 0]]))
        first, second = np.concatenate([np.empty((2, 0)), *edges], axis=1).astype(np.int32)
        graph = csr_array((np.ones(len(first), np.int8), (first, second)), shape=(len(node), len(node)))
        number[node] = connected_components(graph, directed=False)[1]
        return number.reshape(shape).astype(np.int64)


def _grid(count: int) -> Indices:
    return np.stack(np.meshgrid(np.arange(count), np.arange(count)), axis=-1).reshape(-1, 2)


def _middles(cell: Indices, side_m: float) -> Floats:
    return np.asarray((cell + 0.5) * side_m, dtype=np.float64)


def _touching(cell: Indices) -> Indices:
    """Return (n, 8) the indices of each cell's neighbours, the four at its sides first, -1 for none."""
    low, size = cell.min(axis=0) - 1, np.ptp(cell, axis=0) + 3
    index = np.full(size, -1)
    index[tuple((cell - low).T)] = np.arange(len(cell))
    at = (cell - low)[:, None] + _AROUND
    return np.asarray(index[at[..., 0], at[..., 1]])


def _water(touching: Indices, drain: Indices | np.intp) -> tuple[Floats, Floats]:
    """Return (n,) level and slope of water that rains on all cells and flows through their sides to the drain."""
    count, sides = len(touching), touching[:, :4]
    at, other = np.repeat(np.arange(count), 4)[sides.ravel() >= 0], sides[sides >= 0]
    # Cells that no side joins to the drain leak a little, so that they have a level too.
    out = np.bincount(at, minlength=count) + _LEAK
    out[drain] += 1.0
    here = np.arange(count)
    row, column = np.concatenate([at, here]).astype(np.int32), np.concatenate([other, here]).astype(np.int32)
    flow = csc_array((np.concatenate([np.full(len(at), -1.0), out]), (row, column)), shape=(count, count))
    level = np.asarray(spsolve(flow, np.ones(count)))
    return level, np.where(sides >= 0, np.abs(level[sides] - level[:, None]), 0.0).max(axis=1)


def _squares(
    airspace: Airspace, cell: Indices, room_m: Floats, side_m: float, r_m: float
) -> tuple[Floats, Floats, Indices]:
    """Return the cells inside the airspace and the parts of the others that may hold some of it (see `Lane`)."""
    inside = room_m >= HALF_DIAGONAL * side_m
    edge, part_m = np.flatnonzero(~inside), side_m / PARTS
    part = ((cell[edge] * PARTS)[:, None] + _grid(PARTS)).reshape(-1, 2)
    at_m, owner = _middles(part, part_m), np.repeat(edge, PARTS**2)
    may_hold = airspace.room_m(at_m, r_m) >= -HALF_DIAGONAL * part_m - ROUNDING_M
    point_m = np.concatenate([_middles(cell[inside], side_m), at_m[may_hold]])
    half_m = np.repeat([side_m / 2, part_m / 2], [inside.sum(), may_hold.sum()])
    return point_m, half_m, np.concatenate([np.flatnonzero(inside), owner[may_hold]])


def _far_m(lane: Lane, piece: Indices) -> Floats:
    """Return (m, m) the largest distance of two points of two pieces, or a little more."""
    count, owner = piece.max() + 1, piece[lane.owner]
    angle = np.arange(GAP_DIRECTIONS) * 2 * math.pi / GAP_DIRECTIONS
    most_m = np.full((GAP_DIRECTIONS, count), -np.inf)
    for k, (x, y) in enumerate(zip(np.cos(angle), np.sin(angle), strict=True)):
        np.maximum.at(most_m[k], owner, lane.point_m @ [x, y] + lane.half_m * (abs(x) + abs(y)))
    far_m = np.full((count, count), -np.inf)
    for one, opposite in zip(most_m, np.roll(most_m, GAP_DIRECTIONS // 2, axis=0), strict=True):
        np.maximum(far_m, one[:, None] + opposite, out=far_m)
    return far_m / math.cos(math.pi / GAP_DIRECTIONS)


@dataclass(slots=True)
class _Front:
    """The cells above a level that touch each other and are in no piece yet; `is_cut` if pieces have been cut above."""

    is_cut: bool
    top: float
    slope: float = 0.0
    cells: list[int] = field(default_factory=list)

    def add(self, cells: list[int], top: float, slope: float) -> None:
        """Add cells with their highest level and the sum of their slopes."""
        self.cells += cells
        self.top, self.slope = max(self.top, top), self.slope + slope


def _cut(touching: Indices, level: Floats, slope: Floats, thick: float) -> Indices:
    """Return (n,) the piece of each cell: from the highest level downwards, bands that are `thick` cells deep."""
    near, high, steep = touching.tolist(), level.tolist(), slope.tolist()
    root, fronts, pieces = [-1] * len(near), dict[int, _Front](), list[list[int]]()
    for cell in np.argsort(-level, kind="stable").tolist():
        above = {_root(root, other) for other in near[cell] if other >= 0 and root[other] >= 0}
        met = [fronts.pop(each) for each in sorted(above)]
        for each in (cell, *above):
            root[each] = cell
        if sum(front.is_cut for front in met) > 1:
            pieces += [front.cells for front in met]
            met = []
        # A part from which no piece was cut is no branch, but a corner.
        front = max(met, key=lambda each: (each.is_cut, len(each.cells)), default=_Front(bool(above), high[cell]))
        for other in met:
            if other is not front:
                front.add(other.cells, other.top, other.slope)
        front.add([cell], high[cell], steep[cell])
        if (front.top - high[cell]) * len(front.cells) >= thick * front.slope:
            pieces.append(front.cells)
            front = _Front(True, high[cell])
        fronts[cell] = front
    piece = np.empty(len(near), dtype=np.int64)
    for number, cells in enumerate(each for each in [*pieces, *(front.cells for front in fronts.values())] if each):
        piece[cells] = number
    return piece


def _root(root: list[int], cell: int) -> int:
    while root[cell] != cell:
        root[cell] = root[root[cell]]
        cell = root[cell]
    return cell


def _table(pairs: Indices, count: int) -> Indices:
    """Return (count, most) for each first element of pairs (2, e), sorted by it, the second ones, padded with -1."""
    many = np.bincount(pairs[0], minlength=count)
    table = np.full((count, many.max(initial=0)), -1)
    table[np.arange(table.shape[1]) < many[:, None]] = pairs[1]
    return table
