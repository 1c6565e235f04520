"""Planner "straight": no collision avoidance, as in the paper's Fig. 4.

A UAV that cannot stop at once takes up speed and slows down before its target.
"""

from __future__ import annotations

import math

import numpy as np

from edc_swarm.geometry import length_m
from edc_swarm.mission.configuration import Mission
from edc_swarm.planner.interface import Plan, PlanRequest, Stopwatch
from edc_swarm.planner.pilot import momentum_of, slowed_m, step_changes
from edc_swarm.planner.request import checked_arrays
from edc_swarm.solver.certificate import limited_waypoints


class Straight:
    """Planner that sends every UAV straight to its target at full speed, to stop exactly there."""

    def __init__(self, mission: Mission, stopwatch: Stopwatch) -> None:
        self._u_max_m = np.array(mission.steps_m)
        self._change_m = step_changes(mission)
        self._stopwatch = stopwatch

    def plan(self, request: PlanRequest) -> Plan:
        """Return the next waypoints of the UAVs of `request`."""
        started_ns = self._stopwatch()
        scene = checked_arrays(request)
        waypoint_m = limited_waypoints(scene.position_m, scene.target_m, self._u_max_m[scene.uav])
        if (momentum := momentum_of(scene, self._u_max_m, self._change_m)) is not None:
            waypoint_m = momentum.towards_m(slowed_m(momentum, waypoint_m, scene.target_m))
        return Plan(
            waypoint_m=[(x, y) for x, y in waypoint_m.tolist()],
            status="no-qp-needed",
            min_gap_m=least_end_gap_m(waypoint_m, scene.r_m),
            guidance_ms=(self._stopwatch() - started_ns) / 1e6,
        )


def least_end_gap_m(waypoint_m: np.typing.NDArray[np.float64], r_m: np.typing.NDArray[np.float64]) -> float:
    """Return the least centre distance minus R at the end of the slot, 0 for fewer than two UAVs."""
    least_m = math.inf
    for k in range(1, len(r_m)):
        gap_m = length_m(waypoint_m[:k] - waypoint_m[k]) - r_m[:k] - r_m[k]
        least_m = min(least_m, float(gap_m.min()))
    return least_m if math.isfinite(least_m) else 0.0
