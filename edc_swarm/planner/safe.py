"""Safe steps from any preferred steps: slot QP, then certificate. A user's guidance may use it as `edc` does."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import cast

import numpy as np

from edc_swarm.geometry import Floats
from edc_swarm.mission.braking import braking_m, changes_m
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.vehicle_budget import grown_r_m
from edc_swarm.mission.zones import barriers
from edc_swarm.planner.interface import Plan, PlanStatus, Stopwatch, stopped
from edc_swarm.planner.pilot import momentum_of
from edc_swarm.planner.request import Arrays, steps_of
from edc_swarm.solver import certificate, slot_qp, solution
from edc_swarm.solver.barrier_rows import Airspace
from edc_swarm.solver.foreign_rows import Foreign
from edc_swarm.solver.slot_qp import Problem
from edc_swarm.solver.stopping import Momentum


def airspace_of(mission: Mission) -> Airspace:
    """Return the airspace that the mission's zones leave to its UAVs."""
    r_m = max([mission.r_m, *(grown_r_m(mission, entry) for entry in mission.roster)])
    reach_m = 2 * max(mission.steps_m, default=0.0)
    if changes := changes_m(mission):
        steps = zip(mission.steps_m, changes, strict=True)
        reach_m += max(braking_m(step_m, change_m) for step_m, change_m in steps)
    return Airspace.of(barriers(mission.zone), r_m, reach_m)


class SafeSteps:
    """Planner of the steps nearest to the preferred ones that keep all discs apart in every execution.

    With an `airspace` (`airspace_of` the mission) the steps keep to the mission's zones too.
    """

    def __init__(
        self,
        u_max_m: Sequence[float] | Floats | float,
        stopwatch: Stopwatch = stopped,
        airspace: Airspace | None = None,
        change_m: Sequence[float] | Floats | None = None,
        *,
        lags: bool = True,
    ) -> None:
        """Take the longest step of every UAV of the roster (`Mission.steps_m`), or one for all.

        `change_m` are the step changes of the roster (`mission.braking.changes_m`), None if all UAVs stop at once.
        `lags` says if UAVs end a step up to a slot late; without momentum `previous_m` of a request says it.
        """
        self._change_m = None if change_m is None else np.array(change_m)
        self._lags = lags
        self._u_max_m = np.asarray(u_max_m, dtype=np.float64)
        self._stopwatch = stopwatch
        self._duals = solution.Memory()
        self._airspace = airspace

    def plan(self, arrays: Arrays, wish_m: Floats, guidance_ms: float = 0.0) -> Plan:
        """Plan for the UAVs of `arrays` with preferred waypoints `wish_m` (n, 2), at most u_max away."""
        ticks_ns = [self._stopwatch()]
        problem = self._problem(arrays, wish_m)
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
        assemble_ms, solve_ms = np.diff(ticks_ns) / 1e6
        return Plan(
            waypoint_m=[(x, y) for x, y in certified.waypoint_m.tolist()],
            status=cast("PlanStatus", solved.status),
            min_gap_m=gap_m if math.isfinite(gap_m) else 0.0,
            guidance_ms=guidance_ms,
            assemble_ms=float(assemble_ms),
            solve_ms=float(solve_ms),
            iterations=solved.iterations,
        )

    def _problem(self, arrays: Arrays, wish_m: Floats) -> Problem:
        momentum = momentum_of(arrays, self._u_max_m, self._change_m)
        if momentum is None:
            u_max_m = steps_of(self._u_max_m, arrays.uav)
            lags = arrays.previous_m is not None
            return slot_qp.slot_problem(
                arrays.position_m,
                wish_m,
                arrays.r_m,
                u_max_m,
                arrays.obstacles,
                arrays.previous_m,
                self._airspace,
                arrays.uav,
                self._foreign(arrays, lags=lags),
            )
        previous_m = arrays.previous_m if self._lags else None
        wish_m = momentum.towards_m(wish_m)
        return slot_qp.moving_problem(
            momentum,
            wish_m,
            arrays.r_m,
            arrays.obstacles,
            previous_m,
            self._airspace,
            arrays.uav,
            self._foreign(arrays, lags=self._lags),
        )

    def _foreign(self, arrays: Arrays, *, lags: bool) -> Foreign | None:
        """Return the UAVs of other clusters as the slot QP sees them, None if there are none."""
        others = arrays.foreign
        if not len(others.uav) and not len(others.hulls.keep_m):
            return None
        from_m, rest_m = others.previous_m if lags else others.position_m, others.position_m
        if self._change_m is not None:
            last_m = others.position_m - others.previous_m
            u_max_m = steps_of(self._u_max_m, others.uav)
            rest_m = Momentum(others.position_m, last_m, self._change_m[others.uav], u_max_m).rest_m
        return Foreign(others.uav, from_m, rest_m, others.r_m, others.hulls)
