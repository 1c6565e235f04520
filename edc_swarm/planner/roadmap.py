"""Roadmaps: places near some UAVs at which they can wait, and the legs between these places.

The places are the points of a lattice that keep their distance from hulls and zones, and the nodes of charts, where the
shortest ways bend. A point too near to a barrier is moved away from it, so that a lane hardly wider than a disc has
places too, wherever its middle lies.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from edc_swarm.geometry import Floats, Indices, length_m, near_pairs, nearest_on_segment, point_segment_distance_m
from edc_swarm.planner import guidance_kernel as kernel
from edc_swarm.planner.charts import LEG_TESTS, SPARE_M, Charts, along, clear_of
from edc_swarm.solver.barrier_rows import ON_EDGE_M, Airspace
from edc_swarm.solver.normals import DELTA_M

HALF_SIDE = 28
"""Lattice points from the middle to each side."""
MOST_NODES = 1000
LEG = 1.6
"""Longest leg, in lattice spacings."""
CLOSE = 0.4
"""Places nearer to each other than this, in lattice spacings, count as one."""
EXIT = 4.0
"""The same for places at the edge of the map over which UAVs leave it."""
PUSHES = 6
NEXT_M = 1e-6
"""Length of a leg between places that are one; a sparse matrix takes 0 for no leg."""


@dataclass(frozen=True, slots=True)
class Box:
    """Square about `middle_m` (2,) whose lattice has this spacing."""

    middle_m: Floats
    spacing_m: float

    @staticmethod
    def about(point_m: Floats, spacing_m: float) -> Box:
        """Return the square about points (n, 2)."""
        return Box((point_m.min(axis=0) + point_m.max(axis=0)) / 2, spacing_m)

    def inside(self, point_m: Floats, margin_m: float = 0.0) -> NDArray[np.bool_]:
        """Return a mask (n,) of the points that are at least `margin_m` within the square."""
        return np.asarray((np.abs(point_m - self.middle_m) <= HALF_SIDE * self.spacing_m - margin_m).all(axis=1))

    @property
    def lattice_m(self) -> Floats:
        """The points (c, 2) of the lattice."""
        first = np.round(self.middle_m / self.spacing_m) - HALF_SIDE
        axes = first[:, None] + np.arange(2 * HALF_SIDE + 1)
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2) * self.spacing_m


@dataclass(frozen=True, slots=True)
class Roadmap:
    """The c places of n UAVs.

    The first n nodes are the starts, the next n the goals. UAV k's legs from node v are
    `leg[begin[k, v]:begin[k, v + 1]]`; `left_m` (n, c) is the way that is left to its goal; it may end at the nodes
    `end` (n, c): its goal, or if that is far away the edge of the map.
    """

    node_m: Floats
    begin: Indices
    leg: Indices
    left_m: Floats
    end: NDArray[np.bool_]


def roadmap(
    charts: Charts, uav: Indices, r_m: Floats, start_m: Floats, goal_m: Floats, walls: kernel.Walls, box: Box
) -> Roadmap:
    """Return the places in a box for UAVs with radii (n,) between starts and goals (n, 2); `walls` do not move."""
    count, spacing_m = len(uav), box.spacing_m
    places = [each for radius_m in np.unique(r_m).tolist() for each in _places_for(charts, box, radius_m)]
    inside = box.inside(goal_m)
    node_m = np.concatenate([start_m, np.where(inside[:, None], goal_m, start_m), *places])
    first, second = near_pairs(node_m, LEG * spacing_m)
    legs = [_open_legs(charts, walls, k, float(r_m[k]), node_m, first, second) for k in range(count)]
    near = [csr_array((length, (i, j)), shape=(len(node_m),) * 2) for i, j, length in legs]
    near = [graph + graph.T for graph in near]
    away_m = np.array([_ways_m(near[k], k) for k in range(count)])
    kept = np.argsort(away_m[:, 2 * count :].min(axis=0), kind="stable")[: MOST_NODES - 2 * count] + 2 * count
    kept = np.sort(kept[np.isfinite(away_m[:, kept].min(axis=0))])
    cut_m = np.max(away_m[:, kept].min(axis=0), initial=0.0) if len(kept) == MOST_NODES - 2 * count else np.inf
    kept = np.concatenate([np.arange(2 * count), kept])
    edge = ~box.inside(node_m, LEG * spacing_m)
    edge |= away_m.min(axis=0) > cut_m - LEG * spacing_m
    node_m, edge = node_m[kept], edge[kept]
    near = [graph[kept][:, kept].tocsr() for graph in near]
    left_m = np.full((count, len(kept)), np.inf)
    end = np.zeros((count, len(kept)), dtype=bool)
    for k, graph in enumerate(near):
        reached = np.isfinite(away_m[k][kept])
        if inside[k] and reached[count + k]:
            end[k, count + k] = True
            left_m[k] = _ways_m(graph, count + k)
        else:
            _to_edge(
                charts,
                int(uav[k]),
                float(r_m[k]),
                goal_m[k],
                graph,
                node_m,
                spacing_m,
                edge,
                reached,
                left_m[k],
                end[k],
            )
    begin = np.zeros((count, len(kept) + 1), np.int64)
    total = 0
    for k, graph in enumerate(near):
        begin[k] = total + graph.indptr
        total += len(graph.indices)
    return Roadmap(node_m, begin, np.concatenate([graph.indices for graph in near]).astype(np.int64), left_m, end)


def _places_for(charts: Charts, box: Box, r_m: float) -> tuple[Floats, Floats]:
    """Return the places of a lattice and those where the shortest ways bend: the former alone may lead round no corner.

    In a lane hardly wider than a disc all places of the lattice are on one line, from which no leg leads round.
    """
    bend_m = charts.chart(r_m).node_m
    return _places(charts.airspace, box.lattice_m, r_m, box.spacing_m), bend_m[box.inside(bend_m)]


def _places(airspace: Airspace, lattice_m: Floats, r_m: float, spacing_m: float) -> Floats:
    """Return the lattice points in the airspace, those too near to barriers moved away from them."""
    barriers, point_m = airspace.barriers, lattice_m.copy()
    keep_m = barriers.radius_m + barriers.keeps_disc * r_m + DELTA_M
    moving = np.arange(len(point_m))
    for _ in range(PUSHES):
        which, near = airspace.index.near(point_m[moving])
        on_m = _nearest(point_m[moving][which], barriers.a_m[near], barriers.b_m[near])
        away_m = length_m(point_m[moving][which] - on_m)
        lack_m = keep_m[near] - away_m
        order = np.lexsort((-lack_m, which))
        first = order[np.unique(which[order], return_index=True)[1]]
        first = first[lack_m[first] > 0]
        moving, which, near, on_m, away_m = moving[which[first]], which[first], near[first], on_m[first], away_m[first]
        if not len(moving):
            break
        out = np.where(
            (away_m > ON_EDGE_M)[:, None], (point_m[moving] - on_m) / np.maximum(away_m, ON_EDGE_M)[:, None],
            barriers.side[near],
        )  # fmt: skip
        point_m[moving] = on_m + (keep_m[near] + SPARE_M)[:, None] * out
    point_m = point_m[length_m(point_m - lattice_m) < spacing_m]
    point_m = point_m[clear_of(airspace, point_m, np.full(len(point_m), r_m))]
    point_m = point_m[airspace.contains(point_m)]
    return point_m[_thinned(point_m, np.arange(len(point_m)), CLOSE * spacing_m)]


def _thinned(point_m: Floats, chosen: Indices, least_m: float) -> Indices:
    """Return those of the chosen points that are farther than `least_m` from all others returned before them."""
    dropped = np.zeros(len(chosen), dtype=bool)
    for i, j in zip(*(side.tolist() for side in near_pairs(point_m[chosen], least_m)), strict=True):
        if not dropped[i]:
            dropped[j] = True
    return chosen[~dropped]


def _nearest(point_m: Floats, a_m: Floats, b_m: Floats) -> Floats:
    return nearest_on_segment(point_m, a_m, b_m) if len(point_m) else np.empty((0, 2))


def _open_legs(
    charts: Charts, walls: kernel.Walls, k: int, r_m: float, node_m: Floats, first: Indices, second: Indices
) -> tuple[Indices, Indices, Floats]:
    """Return the open legs of UAV k as pairs of nodes, with their lengths."""
    is_open = np.empty(len(first), dtype=bool)
    kernel.open_legs(walls, charts.barred, k, r_m, DELTA_M, node_m, first, second, is_open)
    first, second = first[is_open], second[is_open]
    return first, second, np.maximum(length_m(node_m[first] - node_m[second]), NEXT_M)


def _ways_m(graph: Any, source: int) -> Floats:
    """Return the length (c,) of the shortest way from the source to each node of a sparse matrix of legs."""
    # scipy 1.13 searches only graphs with 32-bit indices.
    index, pointer = graph.indices.astype(np.int32), graph.indptr.astype(np.int32)
    graph = csr_array((graph.data, index, pointer), shape=graph.shape)
    return np.asarray(dijkstra(graph, indices=np.array([source]))[0])


def _to_edge(
    charts: Charts, uav: int, r_m: float, goal_m: Floats, graph: Any, node_m: Floats, spacing_m: float,
    edge: NDArray[np.bool_], reached: NDArray[np.bool_], left_m: Floats, end: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Write the ways to a goal beyond the map: those over nodes at its edge, from which a way leads on outside it."""
    exits, inner_m = [], node_m[reached & ~edge]
    for v in _thinned(node_m, np.flatnonzero(edge & reached), EXIT * spacing_m).tolist():
        way_m = _way_m(charts, uav, r_m, node_m[v], goal_m)
        if way_m is None:
            continue
        # A way that leads back through the map would let a UAV leave at one end of a lane to enter it at the other.
        far_m = inner_m[length_m(inner_m - node_m[v]) > 2 * LEG * spacing_m]
        if (point_segment_distance_m(far_m[:, None], way_m[:-1], way_m[1:]) > spacing_m).all():
            exits.append((v, float(length_m(np.diff(way_m, axis=0)).sum())))
    if not exits:
        return
    size = graph.shape[0]
    wide = csr_array(
        (
            np.concatenate([graph.data, [length + NEXT_M for _, length in exits]]),
            np.concatenate([graph.indices, np.array([v for v, _ in exits])]),
            np.concatenate([graph.indptr, [len(graph.data) + len(exits)]]),
        ),
        shape=(size + 1, size + 1),
    )
    left_m[:] = _ways_m(wide, size)[:size]
    for v, length in exits:
        end[v] = left_m[v] >= length


def _way_m(charts: Charts, uav: int, r_m: float, start_m: Floats, goal_m: Floats) -> Floats | None:
    """Return the points (p, 2) of the shortest way round zones, None if none is known."""
    if kernel.open_leg(charts.barred, r_m, DELTA_M, *start_m.tolist(), *goal_m.tolist())[0]:
        return np.stack([start_m, goal_m])
    known, node, _, _ = charts.way(uav, r_m, start_m, goal_m, LEG_TESTS)
    return along(known, node, start_m) if known is not None and node >= 0 else None
