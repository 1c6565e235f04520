"""Planner "edc": guidance proposes, the slot QP makes it safe, the certificate has the last word."""

from __future__ import annotations

import numpy as np

from edc_swarm.config import Mission
from edc_swarm.energy import propulsion_power_w
from edc_swarm.geometry import Floats, length_m, nearest_on_segment
from edc_swarm.planner.guidance import Guidance, Scene, Tuning
from edc_swarm.planner.interface import Plan, PlanRequest, Stopwatch
from edc_swarm.planner.request import Arrays, checked_arrays
from edc_swarm.planner.safe import SafeSteps
from edc_swarm.solver import slot_qp


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
        """What guidance prefers, but for UAVs too near to a hull: they leave its neighbourhood."""
        obstacles = arrays.obstacles
        middle_m = (obstacles.a_m + obstacles.b_m) / 2
        half_m = length_m(obstacles.b_m - obstacles.a_m) / 2
        wish_m = self._guidance.wishes(
            Scene(
                arrays.slot,
                arrays.uav,
                arrays.position_m,
                arrays.target_m,
                arrays.r_m,
                middle_m,
                half_m + obstacles.radius_m + obstacles.keep_m,
            )
        )
        if len(middle_m) and len(arrays.uav):
            self._flee(arrays, wish_m)
        return wish_m

    def _flee(self, arrays: Arrays, wish_m: Floats) -> None:
        """Send UAVs nearer than R to a hull straight away from it; between several, in the mean."""
        obstacles = arrays.obstacles
        nearest_m = nearest_on_segment(arrays.position_m[:, None], obstacles.a_m[None], obstacles.b_m[None])
        apart_m = arrays.position_m[:, None] - nearest_m
        distance_m = length_m(apart_m)
        lack_m = arrays.r_m[:, None] + obstacles.keep_m + obstacles.radius_m - distance_m
        outward = apart_m / np.where(distance_m > 0, distance_m, 1.0)[..., None]
        away = (outward * (lack_m > 0)[..., None]).sum(axis=1)
        norm = length_m(away)
        for k in np.flatnonzero((lack_m > 0).any(axis=1)):
            step_m = min(float(lack_m[k].max()) + 2 * slot_qp.DELTA_M, self._u_max_m)
            wish_m[k] = arrays.position_m[k] + (step_m * away[k] / norm[k] if norm[k] > 1e-9 else 0.0)
