"""Guard of a user's planner: its head continues after any failure of it, and reports the error.

If the planner raises, or returns no valid plan, all UAVs hold (with inertia: brake) in that slot and the plan has the
reason. The guard shortens steps longer than u_max, bends those that a UAV with inertia cannot fly, and changes
nothing else in a valid plan. It does not make steps safe: a planner
may send two UAVs to one place, and `edc-swarm check` then reports the collision.
"""

from __future__ import annotations

import traceback
from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np

from edc_swarm.geometry import Floats
from edc_swarm.mission.configuration import Mission
from edc_swarm.planner.interface import Plan, Planner, PlanRequest, PlanStatus, Stopwatch
from edc_swarm.planner.pilot import momentum_of, step_changes
from edc_swarm.planner.request import checked_arrays
from edc_swarm.planner.straight import least_end_gap_m
from edc_swarm.solver.certificate import limited_waypoints

MAX_PROBLEM = 400


class Guarded:
    """A user's `planner`, as a planner that always returns a plan."""

    def __init__(self, planner: Planner, mission: Mission, stopwatch: Stopwatch) -> None:
        self._planner = planner
        self._u_max_m = np.array(mission.steps_m)
        self._change_m = step_changes(mission)
        self._stopwatch = stopwatch

    def plan(self, request: PlanRequest) -> Plan:
        """Return the next waypoints of the UAVs of `request`; if the planner has none, all hold."""
        started_ns = self._stopwatch()
        try:
            plan = self._checked(self._planner.plan(request), request)
        except Exception as error:  # noqa: BLE001  (user code may raise anything, and the head continues)
            plan = self._all_hold(request, described(error, type(self._planner).__module__))
        if plan.guidance_ms + plan.assemble_ms + plan.solve_ms > 0.0:
            return plan
        return replace(plan, guidance_ms=(self._stopwatch() - started_ns) / 1e6)

    def _checked(self, plan: object, request: PlanRequest) -> Plan:
        if not isinstance(plan, Plan):
            raise TypeError(f"plan() returned {type(plan).__name__}, not Plan")
        if plan.status not in get_args(PlanStatus):
            raise ValueError(f"status is {plan.status!r}, not one of {', '.join(get_args(PlanStatus))}")
        wish_m = _points(plan.waypoint_m, len(request.uav))
        position_m = np.asarray(request.position_m, np.float64).reshape(-1, 2)
        waypoint_m = limited_waypoints(position_m, wish_m, self._u_max_m[np.asarray(request.uav, np.int64)])
        waypoint_m = self._flyable_m(request, waypoint_m)
        gap_m = plan.min_gap_m or least_end_gap_m(waypoint_m, np.asarray(request.r_m, np.float64))
        return replace(plan, waypoint_m=[(x, y) for x, y in waypoint_m.tolist()], min_gap_m=float(gap_m))

    def _all_hold(self, request: PlanRequest, problem: str) -> Plan:
        """Return the plan in which all UAVs hold, or brake."""
        waypoint_m = self._flyable_m(request, np.asarray(request.position_m, np.float64).reshape(-1, 2))
        return Plan([(x, y) for x, y in waypoint_m.tolist()], "failed", problem=problem)

    def _flyable_m(self, request: PlanRequest, waypoint_m: Floats) -> Floats:
        """Return the waypoints nearest to these that UAVs with inertia can fly to."""
        momentum = momentum_of(checked_arrays(request), self._u_max_m, self._change_m)
        return waypoint_m if momentum is None else momentum.towards_m(waypoint_m)


def described(error: BaseException, module: str) -> str:
    """Return the error's type and text, with the last line of `module` in its traceback if there is one."""
    frames = traceback.walk_tb(error.__traceback__)
    lines = [(frame.f_code.co_filename, line) for frame, line in frames if frame.f_globals.get("__name__") == module]
    where = f" ({Path(lines[-1][0]).name}, line {lines[-1][1]})" if lines else ""
    return f"{type(error).__name__}: {' '.join(str(error).split())[:MAX_PROBLEM]}{where}"


def _points(values: object, count: int) -> Floats:
    points_m = np.asarray(values, np.float64)
    if points_m.shape != (count, 2):
        raise ValueError(f"waypoint_m has shape {points_m.shape}, not {(count, 2)}: a point for every UAV asked for")
    if not np.isfinite(points_m).all():
        index = int(np.flatnonzero(~np.isfinite(points_m).all(axis=1))[0])
        raise ValueError(f"waypoint_m[{index}] is {tuple(points_m[index].tolist())}, which is no place")
    return points_m
