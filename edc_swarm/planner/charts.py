"""Charts of the airspace: the shortest ways round the barriers of zones, computed once per radius and goal.

The nodes of a chart are the places where such a way can bend: about each convex corner of a zone and about each circle,
at the distance that a UAV keeps. The legs between them are tested once, as the searches need them. For each UAV the
chart has the length of the shortest way from every node to the UAV's goal, so that the way from any place is one
search among the nodes in sight.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from edc_swarm.geometry import Floats, Indices, point_segment_distance_m
from edc_swarm.planner import guidance_kernel as kernel
from edc_swarm.solver.barrier_rows import Airspace
from edc_swarm.solver.normals import DELTA_M

SPARE_M = 1e-5
"""Distance added to a node for rounding."""
BEND = math.pi / 4
"""Most of the turn at a corner that one node stands for."""
CIRCLE_NODES = 12
MAX_NODES = 1000
MAX_CHARTS = 8
"""Most radii with a chart of their own; UAVs with other radii use the next wider one."""
LEG_TESTS = 1_000_000
"""Limit per slot on tests of a leg against a barrier; UAVs without a way by then fly towards their goals."""


@dataclass(frozen=True, slots=True)
class Chart:
    """The c nodes (c, 2) for one radius, the lengths of the open legs between them, and the rows that are complete."""

    r_m: float
    node_m: Floats
    leg_m: Floats
    known: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Field:
    """The lengths (c,) of the ways from a chart's nodes to one goal, and the next node of each (-1: the goal)."""

    goal_m: tuple[float, float]
    chart: Chart
    cost_m: Floats
    after: Indices


@dataclass
class Charts:
    """The charts of an airspace and the fields of its UAVs, by roster index."""

    airspace: Airspace
    barred: kernel.Barred
    charts: dict[float, Chart] = field(default_factory=dict)
    fields: dict[int, Field] = field(default_factory=dict)

    @staticmethod
    def of(airspace: Airspace) -> Charts:
        """Return charts without any node yet."""
        barriers, index = airspace.barriers, airspace.index
        size_m = np.stack([barriers.radius_m, barriers.keeps_disc.astype(np.float64)], axis=-1)
        edge = np.concatenate([barriers.a_m, barriers.b_m, barriers.side, size_m], axis=1)
        barred = kernel.Barred(
            np.ascontiguousarray(edge),
            index.begin,
            index.which,
            *index.low_m,
            1 / index.side_m,
            index.rows,
            index.columns,
        )
        return Charts(airspace, barred)

    def chart(self, r_m: float) -> Chart:
        """Return the chart for a UAV with this radius."""
        if r_m not in self.charts:
            wider = [chart for radius_m, chart in sorted(self.charts.items()) if radius_m > r_m]
            if len(self.charts) >= MAX_CHARTS and wider:
                return wider[0]
            node_m = nodes(self.airspace, r_m)
            count = len(node_m)
            self.charts[r_m] = Chart(r_m, node_m, np.full((count, count), np.inf), np.zeros(count, dtype=bool))
        return self.charts[r_m]

    def reaches(self, uav: int, r_m: float, start_m: Floats, goal_m: Floats) -> bool:
        """Return True if a way leads from the start to the goal, straight or over nodes, without a limit on tests."""
        clear = kernel.open_leg(self.barred, r_m, DELTA_M, *start_m.tolist(), *goal_m.tolist())[0]
        return clear or self.way(uav, r_m, start_m, goal_m, 10**12)[1] >= 0

    def way(
        self, uav: int, r_m: float, start_m: Floats, goal_m: Floats, budget: int
    ) -> tuple[Field | None, int, float, int]:
        """Return the UAV's field, the first node of its way, the way's length, and the number of tests.

        The field is None if the budget ended first; the node is -1 if no way is known.
        """
        goal = (float(goal_m[0]), float(goal_m[1]))
        known, spent = self.fields.get(uav), 0
        if known is None or known.goal_m != goal:
            chart = self.chart(r_m)
            count = len(chart.known)
            known = Field(goal, chart, np.empty(count), np.empty(count, np.int64))
            done, spent = kernel.measure_ways(
                self.barred, chart.r_m, DELTA_M, chart.node_m, chart.leg_m, chart.known,
                goal_m, known.cost_m, known.after, np.empty(count, dtype=bool), budget,
            )  # fmt: skip
            if not done:
                return None, -1, 0.0, spent
            self.fields[uav] = known
        chart = known.chart
        node, length_m, tests = kernel.next_node(
            self.barred, chart.r_m, DELTA_M, chart.node_m, known.cost_m, float(start_m[0]), float(start_m[1]),
            np.empty(len(chart.known), dtype=bool), budget,
        )  # fmt: skip
        return known, node, length_m, spent + tests


def along(known: Field, node: int, start_m: Floats) -> Floats:
    """Return the points (p, 2) of the way from a start over `node` to the field's goal."""
    points_m = [start_m]
    while node >= 0:
        points_m.append(known.chart.node_m[node])
        node = int(known.after[node])
    return np.array([*points_m, known.goal_m])


def nodes(airspace: Airspace, r_m: float) -> Floats:
    """Return the places (c, 2) where the shortest way of a UAV with radius `r_m` can bend, without those too close."""
    barriers = airspace.barriers
    keep_m = barriers.least_m(np.full(1, r_m))[0] + DELTA_M
    before = _edge_before(barriers.a_m, barriers.b_m)
    found: list[tuple[float, float]] = []
    for edge, (x_m, y_m) in enumerate(barriers.a_m.tolist()):
        low, turn = _open_arc(barriers.a_m, barriers.b_m, edge, before[edge])
        count = CIRCLE_NODES if turn == math.tau else math.ceil(turn / BEND - 1e-9)
        for part in range(count):
            angle = low + (part + 0.5) * turn / count
            out_m = (max(keep_m[edge], keep_m[before[edge]]) + SPARE_M) / math.cos(turn / (2 * count))
            found.append((x_m + out_m * math.cos(angle), y_m + out_m * math.sin(angle)))
    node_m = np.array(found).reshape(-1, 2)
    node_m = node_m[clear_of(airspace, node_m, np.full(len(node_m), r_m))]
    return node_m[:: math.ceil(len(node_m) / MAX_NODES)] if len(node_m) else node_m


def clear_of(airspace: Airspace, point_m: Floats, r_m: Floats) -> NDArray[np.bool_]:
    """Return a mask (n,) of the points at which UAVs with radii (n,) keep their distance and the QP's buffer."""
    barriers = airspace.barriers
    which, near = airspace.index.near(point_m)
    away_m = point_segment_distance_m(point_m[which], barriers.a_m[near], barriers.b_m[near])
    keep_m = barriers.radius_m[near] + barriers.keeps_disc[near] * r_m[which] + DELTA_M
    clear = np.ones(len(point_m), dtype=bool)
    clear[which[away_m < keep_m]] = False
    return clear


def _edge_before(a_m: Floats, b_m: Floats) -> list[int]:
    """Return the edge that ends where each edge begins; the edges of a polygon come one after another."""
    before, first = list(range(-1, len(a_m) - 1)), 0
    for edge in range(len(a_m)):
        if (b_m[edge] == a_m[first]).all():
            before[first] = edge
            first = edge + 1
    return before


def _open_arc(a_m: Floats, b_m: Floats, edge: int, before: int) -> tuple[float, float]:
    """Return the first direction and the size of the arc of directions whose nearest point is an edge's first end.

    The size is 0 at a corner that ways do not bend round, and a full turn about a point.
    """
    if edge == before:
        return 0.0, math.tau
    ahead, behind = b_m[edge] - a_m[edge], a_m[before] - a_m[edge]
    first, second = math.atan2(ahead[1], ahead[0]), math.atan2(behind[1], behind[0])
    gap = (second - first) % math.tau
    # Seen from the corner the two edges span `gap` and tau - gap: the way bends round the smaller of the two angles.
    low, wide = (second, math.tau - gap) if gap <= math.pi else (first, gap)
    return low + math.pi / 2, wide - math.pi


__all__ = ["Chart", "Charts", "Field", "along", "clear_of", "nodes"]
