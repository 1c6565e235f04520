"""An example of a user's planner in one file: a UAV turns right before others; the slot QP keeps it safe.

    cd examples
    edc-swarm sim --planner own_planner:TurnRight --fence none

Its discs never overlap, but it is not a good planner: in dense missions UAVs circle without end, and a UAV whose way
to the right ends at a fence waits there.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from edc_swarm.mission.configuration import Mission
from edc_swarm.planner import Plan, PlanRequest, SafeSteps, Stopwatch, airspace_of
from edc_swarm.planner.request import checked_arrays

NEAR_M = 5.0
"""Gap between two discs below which UAVs begin to turn."""
RIGHT_RAD = -np.pi / 3


class TurnRight:
    """A planner that flies straight to the target, and turns right before a UAV that is near and ahead."""

    def __init__(self, mission: Mission, stopwatch: Stopwatch) -> None:
        self._u_max_m = np.array(mission.steps_m)
        self._safe = SafeSteps(mission.steps_m, stopwatch, airspace_of(mission))

    def plan(self, request: PlanRequest) -> Plan:
        arrays = checked_arrays(request)
        step_m = self._straight_steps(arrays.target_m - arrays.position_m, self._u_max_m[arrays.uav])
        for k in range(len(step_m)):
            if self._is_blocked(k, arrays.position_m, arrays.r_m, step_m):
                turn = np.array([[np.cos(RIGHT_RAD), -np.sin(RIGHT_RAD)], [np.sin(RIGHT_RAD), np.cos(RIGHT_RAD)]])
                step_m[k] = turn @ step_m[k]
        return self._safe.plan(arrays, arrays.position_m + step_m)

    @staticmethod
    def _straight_steps(way_m: NDArray[np.float64], u_max_m: NDArray[np.float64]) -> NDArray[np.float64]:
        length_m = np.hypot(way_m[:, 0], way_m[:, 1])
        return way_m * np.minimum(1.0, u_max_m / np.maximum(length_m, 1e-9))[:, None]

    @staticmethod
    def _is_blocked(
        k: int, position_m: NDArray[np.float64], r_m: NDArray[np.float64], step_m: NDArray[np.float64]
    ) -> bool:
        to_m = position_m - position_m[k]
        room_m = np.hypot(to_m[:, 0], to_m[:, 1]) - r_m - r_m[k]
        ahead = to_m @ step_m[k] > 0
        return bool((ahead & (room_m < NEAR_M)).any())
