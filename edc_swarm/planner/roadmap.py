"""Roadmaps: places near some UAVs at which they can wait, and the legs between these places.

The places are the points of a lattice that keep their distance from hulls and zones. A point too near to a barrier moves
away from it, so that a lane hardly wider than a disc has places too, wherever its middle lies.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from edc_swarm.geometry import Floats, Indices, length_m, near_pairs, nearest_on_segment, segment_distance_m
from edc_swarm.planner import guidance_kernel as kernel
from edc_swarm.planner.charts import SPARE_M, Charts, clear_of
from edc_swarm.solver.barrier_rows import ON_EDGE_M
from edc_swarm.solver.slot_qp import DELTA_M, Airspace

HALF_SIDE = 28
"""Lattice points from the middle to each side."""
MOST_NODES = 1000
LEG = 1.6
"""Longest leg, in lattice spacings."""
CLOSE = 0.4
"""Places nearer to each other than this, in lattice spacings, count as one."""
PUSHES = 6


@dataclass(frozen=True, slots=True)
class Still:
    """What does not move, for one UAV: segments a-b (m, 2) and the distances (m,) that the UAV keeps from them."""

    a_m: Floats
    b_m: Floats
    keep_m: Floats


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
    charts: Charts, uav: Indices, r_m: Floats, start_m: Floats, goal_m: Floats, still: list[Still], spacing_m: float
) -> Roadmap:
    """Return the places about UAVs with radii (n,), between starts and goals (n, 2)."""
    count, low_m, high_m = len(uav), start_m.min(axis=0), start_m.max(axis=0)
    middle_m, half_m = (low_m + high_m) / 2, HALF_SIDE * spacing_m
    lattice_m = _lattice(middle_m, half_m, spacing_m)
    places = [_places(charts.airspace, lattice_m, radius_m, spacing_m) for radius_m in np.unique(r_m).tolist()]
    box_m = (np.abs(goal_m - middle_m) <= half_m).all(axis=1)
    node_m = np.concatenate([start_m, np.where(box_m[:, None], goal_m, start_m), *places])
    first, second = near_pairs(node_m, LEG * spacing_m)
    legs = [_open_legs(charts, r_m[k], still[k], node_m, first, second, k) for k in range(count)]
    near = [csr_array((length, (i, j)), shape=(len(node_m),) * 2) for i, j, length in legs]
    near = [graph + graph.T for graph in near]
    away_m = np.array([dijkstra(near[k], indices=k) for k in range(count)])
    kept = np.argsort(away_m[:, 2 * count :].min(axis=0), kind="stable")[: MOST_NODES - 2 * count] + 2 * count
    kept = np.sort(kept[np.isfinite(away_m[:, kept].min(axis=0))])
    cut_m = np.max(away_m[:, kept].min(axis=0), initial=0.0) if len(kept) == MOST_NODES - 2 * count else np.inf
    kept = np.concatenate([np.arange(2 * count), kept])
    edge = (np.abs(node_m - middle_m) > half_m - LEG * spacing_m).any(axis=1)
    edge |= away_m.min(axis=0) > cut_m - LEG * spacing_m
    node_m, edge = node_m[kept], edge[kept]
    near = [graph[kept][:, kept].tocsr() for graph in near]
    left_m = np.full((count, len(kept)), np.inf)
    end = np.zeros((count, len(kept)), dtype=bool)
    for k, graph in enumerate(near):
        reached = np.isfinite(away_m[k][kept])
        if box_m[k] and reached[count + k]:
            end[k, count + k] = True
            left_m[k] = dijkstra(graph, indices=count + k)
        else:
            _to_edge(charts, int(uav[k]), float(r_m[k]), goal_m[k], graph, node_m, edge & reached, left_m[k], end[k])
    begin = np.zeros((count, len(kept) + 1), np.int64)
    total = 0
    for k, graph in enumerate(near):
        begin[k] = total + graph.indptr
        total += len(graph.indices)
    return Roadmap(node_m, begin, np.concatenate([graph.indices for graph in near]).astype(np.int64), left_m, end)


def _lattice(middle_m: Floats, half_m: float, spacing_m: float) -> Floats:
    axes = [np.arange(np.ceil((m - half_m) / spacing_m), np.floor((m + half_m) / spacing_m) + 1) for m in middle_m]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2) * spacing_m


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
    first, second = near_pairs(point_m, CLOSE * spacing_m)
    dropped = np.zeros(len(point_m), dtype=bool)
    for i, j in zip(first.tolist(), second.tolist(), strict=True):
        if not dropped[i]:
            dropped[j] = True
    return point_m[~dropped]


def _nearest(point_m: Floats, a_m: Floats, b_m: Floats) -> Floats:
    return nearest_on_segment(point_m, a_m, b_m) if len(point_m) else np.empty((0, 2))


def _open_legs(
    charts: Charts, r_m: float, still: Still, node_m: Floats, first: Indices, second: Indices, k: int
) -> tuple[Indices, Indices, Floats]:
    """Return the open legs of UAV k as pairs of nodes, with their lengths."""
    is_open = np.empty(len(first), dtype=bool)
    kernel.open_legs(charts.barred, r_m, DELTA_M, node_m, first, second, is_open)
    first, second = first[is_open], second[is_open]
    if len(still.keep_m) and len(first):
        away_m = segment_distance_m(node_m[first][:, None], node_m[second][:, None], still.a_m, still.b_m)
        free = (away_m >= still.keep_m).all(axis=1)
        first, second = first[free], second[free]
    return first, second, np.maximum(length_m(node_m[first] - node_m[second]), 1e-6)


def _to_edge(
    charts: Charts, uav: int, r_m: float, goal_m: Floats, graph: csr_array, node_m: Floats,
    edge: NDArray[np.bool_], left_m: Floats, end: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Write the ways to a goal beyond the map: those over the nodes at its edge from which a way leads to the goal."""
    exits = []
    for v in np.flatnonzero(edge).tolist():
        if kernel.open_leg(charts.barred, r_m, DELTA_M, *node_m[v].tolist(), *goal_m.tolist())[0]:
            exits.append((v, float(length_m(goal_m - node_m[v]))))
        else:
            _, node, length, _ = charts.way(uav, r_m, node_m[v], goal_m, LEG_BUDGET)
            if node >= 0:
                exits.append((v, length))
    if not exits:
        return
    size = graph.shape[0]
    wide = csr_array(
        (
            np.concatenate([graph.data, [length + 1e-6 for _, length in exits]]),
            np.concatenate([graph.indices, np.array([v for v, _ in exits])]),
            np.concatenate([graph.indptr, [len(graph.data) + len(exits)]]),
        ),
        shape=(size + 1, size + 1),
    )
    left_m[:] = dijkstra(wide, indices=size)[:size]
    for v, length in exits:
        end[v] = left_m[v] >= length


LEG_BUDGET = 1_000_000
