"""Planner "edc": guidance proposes, the slot QP makes it safe, the certificate has the last word."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from edc_swarm.emulation.energy import propulsion_power_w
from edc_swarm.geometry import Floats, point_segment_distance_m
from edc_swarm.mission.configuration import Mission
from edc_swarm.planner import ways
from edc_swarm.planner.guidance import Guidance, Scene, Tuning
from edc_swarm.planner.interface import Plan, PlanRequest, Stopwatch
from edc_swarm.planner.request import Arrays, checked_arrays
from edc_swarm.planner.safe import SafeSteps
from edc_swarm.solver import certificate, slot_qp
from edc_swarm.solver.slot_qp import Obstacles


def weights(mission: Mission) -> tuple[float, float]:
    """Prices (wt, wd) of a slot of time and of a full step of distance; wt + wd = 1.

    "time" asks for the earliest arrival. "distance" balances distance with time: with more weight on
    distance UAVs wait for each other rather than go round, and missions stall. "energy" takes the
    weights from the power curve: a slot of flight at full speed costs P(v_max), a slot of waiting
    P(0), so time is worth P(0) and distance the rest, P(v_max) - P(0), of which there is none while
    hovering costs more than cruising.
    """
    if mission.minimise == "distance":
        return 0.5, 0.5
    if mission.minimise == "time":
        return 1.0, 0.0
    hover_w = propulsion_power_w(0.0, mission.energy)
    cruise_w = propulsion_power_w(mission.v_max_mps, mission.energy)
    share = min(hover_w / cruise_w, 1.0)
    return share, 1.0 - share


class Edc:
    """The project's own planner: complete, and free of overlaps however the steps are flown."""

    def __init__(self, mission: Mission, stopwatch: Stopwatch, tuning: Tuning | None = None) -> None:
        self._u_max_m = mission.u_max_m
        self._stopwatch = stopwatch
        self._guidance = Guidance(self._u_max_m, weights(mission), mission.seed, tuning or Tuning())
        self._safe = SafeSteps(self._u_max_m, stopwatch)

    def plan(self, request: PlanRequest) -> Plan:
        """Next waypoints of the UAVs of `request`."""
        started_ns = self._stopwatch()
        arrays = checked_arrays(request)
        wish_m = self._wishes(arrays)
        return self._safe.plan(arrays, wish_m, guidance_ms=(self._stopwatch() - started_ns) / 1e6)

    def _wishes(self, arrays: Arrays) -> Floats:
        """What guidance prefers, but for UAVs that have to leave a hull's neighbourhood first."""
        free, obstacles = ~self._held(arrays), arrays.obstacles
        if not free.all():
            # A plan for a UAV that cannot move would only keep others from going where it never goes.
            still_m, still_r_m = arrays.position_m[~free], arrays.r_m[~free]
            obstacles = Obstacles(
                np.concatenate([obstacles.a_m, still_m]),
                np.concatenate([obstacles.b_m, still_m]),
                np.concatenate([obstacles.radius_m, np.zeros(len(still_m))]),
                np.concatenate([obstacles.keep_m, still_r_m]),
            )
        position_m, r_m = arrays.position_m[free], arrays.r_m[free]
        goal_m = ways.free_goals(arrays.target_m[free], r_m, obstacles)
        wish_m = arrays.position_m.copy()
        wish_m[free] = self._guidance.wishes(Scene(arrays.slot, arrays.uav[free], position_m, goal_m, r_m, obstacles))
        if len(arrays.obstacles.keep_m) and len(arrays.uav):
            self._leave(arrays, wish_m)
        return wish_m

    def _held(self, arrays: Arrays) -> NDArray[np.bool_]:
        """(n,) UAVs within a hull, or nearer than R to hulls without a step that leads away from all of them."""
        if not len(arrays.obstacles.keep_m):
            return np.zeros(len(arrays.uav), dtype=bool)
        alone = slot_qp.slot_problem(arrays.position_m, arrays.position_m, arrays.r_m, self._u_max_m, arrays.obstacles)
        held = alone.frozen.copy()
        for k in np.unique(alone.row_uav[alone.row_room_m == 0]).tolist():
            normal = alone.row_normal[(alone.row_uav == k) & (alone.row_room_m == 0)]
            held[k] |= not ways.clearest(normal).any()
        return held

    def _leave(self, arrays: Arrays, wish_m: Floats) -> None:
        """Send UAVs nearer than R to a hull away from it, if what they prefer and may fly brings them hardly farther.

        Nearer than R a UAV may take only steps by which it comes nearer to no point of the hull. Of these it takes
        the one most clear of all that bound them.
        """
        alone = slot_qp.slot_problem(arrays.position_m, wish_m, arrays.r_m, self._u_max_m, arrays.obstacles)
        lack_m = self._lack_m(arrays, arrays.position_m)
        for k in np.flatnonzero((lack_m > 0).any(axis=1) & ~alone.frozen).tolist():
            inner = (alone.row_uav == k) & (alone.row_room_m == 0)
            normal = alone.row_normal[inner]
            step_m = certificate.nearest_step_m(alone.wish_step_m[k], normal, np.zeros(len(normal)))
            gained_m = lack_m[k] - self._lack_m(arrays, arrays.position_m[k] + step_m, k)
            must_m = np.minimum(lack_m[k] + slot_qp.DELTA_M, self._u_max_m)[lack_m[k] > 0]
            if (gained_m[lack_m[k] > 0] < must_m / 2).any():
                far_m = min(float(lack_m[k].max()) + 2 * slot_qp.DELTA_M, self._u_max_m)
                wish_m[k] = arrays.position_m[k] + far_m * ways.clearest(normal)

    def _lack_m(self, arrays: Arrays, point_m: Floats, k: int | None = None) -> Floats:
        """How much less than R from each hull the points are, (n, m); or (m,) one point of UAV `k`."""
        obstacles = arrays.obstacles
        r_m = arrays.r_m[:, None] if k is None else arrays.r_m[k]
        away_m = point_segment_distance_m(point_m[..., None, :], obstacles.a_m, obstacles.b_m)
        return np.asarray(r_m + obstacles.keep_m + obstacles.radius_m - away_m)
