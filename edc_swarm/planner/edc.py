"""Planner "edc": guidance proposes, the slot QP makes it safe, the certificate has the last word."""

from __future__ import annotations

import math
from typing import cast

import numpy as np

from edc_swarm.config import Mission
from edc_swarm.energy import propulsion_power_w
from edc_swarm.geometry import Floats, length_m, nearest_on_segment
from edc_swarm.planner.guidance import Guidance, Scene, Tuning
from edc_swarm.planner.interface import Plan, PlanRequest, PlanStatus, Stopwatch
from edc_swarm.planner.request import Arrays, checked_arrays
from edc_swarm.solver import certificate, slot_qp, solution


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
        self._duals = solution.Memory()

    def plan(self, request: PlanRequest) -> Plan:
        """Next waypoints of the UAVs of `request`."""
        ticks_ns = [self._stopwatch()]
        arrays = checked_arrays(request)
        wish_m = self._wishes(arrays)
        ticks_ns.append(self._stopwatch())
        problem = slot_qp.slot_problem(
            arrays.position_m, wish_m, arrays.r_m, self._u_max_m, arrays.obstacles, arrays.previous_m
        )
        program = None
        if not solution.keeps_every_row(problem):
            program = solution.active_program(problem, arrays.uav)
        ticks_ns.append(self._stopwatch())
        if program is None:
            solved = solution.Solution(problem.wish_step_m, "no-qp-needed")
        else:
            solved = solution.solve(problem, program, self._duals)
        certified = certificate.certify(problem, solved.step_m)
        gap_m = certificate.least_gap_m(problem, certified.waypoint_m)
        ticks_ns.append(self._stopwatch())
        guidance_ms, assemble_ms, solve_ms = np.diff(ticks_ns) / 1e6
        return Plan(
            waypoint_m=[(x, y) for x, y in certified.waypoint_m.tolist()],
            status=cast("PlanStatus", solved.status),
            min_gap_m=gap_m if math.isfinite(gap_m) else 0.0,
            guidance_ms=float(guidance_ms),
            assemble_ms=float(assemble_ms),
            solve_ms=float(solve_ms),
            iterations=solved.iterations,
        )

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
