"""Discs as the baseline planners see them: those that a plan moves, those that move by themselves, those that stand.

The planners `orca`, `bvc`, `cbf` and `priority` are published methods for discs in the plane. They plan for all UAVs
that a head hears, or for one UAV among neighbours (local control); a hull is a disc that stands, the smallest one
that contains it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from edc_swarm.geometry import Floats, length_m
from edc_swarm.mission.configuration import Mission
from edc_swarm.planner.interface import Neighbour, Plan, PlanRequest, PlanStatus
from edc_swarm.planner.request import Arrays, checked_arrays
from edc_swarm.planner.straight import least_end_gap_m
from edc_swarm.solver.certificate import limited_waypoints

CLEARANCE_M = 1e-3
"""Distance that the baselines keep beyond touching: pyrvo computes with 24 bits, solvers end near a limit."""


@dataclass(frozen=True, slots=True)
class Discs:
    """The discs of one slot, in metres and metres per slot.

    Attributes
    ----------
    slot
        The slot of the steps.
    uav
        (n,) roster indices of the UAVs to plan for.
    position_m, target_m, step_m, r_m, u_max_m
        (n, 2), (n, 2), (n, 2), (n,), (n,): where each is, its target, its last step, its radius, its longest step.
    other_m, other_step_m, other_r_m
        (m, 2), (m, 2), (m,): the neighbours, which plan for themselves; extrapolated.
    still_m, still_r_m
        (h, 2), (h,): the hulls.
    """

    slot: int
    uav: np.typing.NDArray[np.int64]
    position_m: Floats
    target_m: Floats
    step_m: Floats
    r_m: Floats
    u_max_m: Floats
    other_m: Floats
    other_step_m: Floats
    other_r_m: Floats
    still_m: Floats
    still_r_m: Floats

    @property
    def wish_m(self) -> Floats:
        """(n, 2) preferred steps: straight to the target at full speed, to stop exactly there."""
        return limited_waypoints(self.position_m, self.target_m, self.u_max_m) - self.position_m

    @property
    def moving(self) -> tuple[Floats, Floats, Floats]:
        """Positions, last steps and radii of the UAVs to plan for and of the neighbours, in this order."""
        return (
            np.concatenate([self.position_m, self.other_m]),
            np.concatenate([self.step_m, self.other_step_m]),
            np.concatenate([self.r_m, self.other_r_m]),
        )


class Sight:
    """Maker of the discs of each slot. It remembers where the UAVs were, since a request may not say it.

    Parameters
    ----------
    mission
        The mission as run.
    horizon_slots
        Slots for which a neighbour that is not heard is taken to go on at constant velocity; beyond, it is taken to
        stand where it was last heard, as an emulated vehicle does whose process is dead. 0 for a method that uses
        positions alone.
    """

    def __init__(self, mission: Mission, horizon_slots: float) -> None:
        self._u_max_m = np.array(mission.steps_m)
        self._horizon_slots = horizon_slots
        self._slot = -1
        self._place_m: dict[int, tuple[float, float]] = {}

    def discs(self, request: PlanRequest) -> Discs:
        """Return the discs of a request, which is checked."""
        arrays = checked_arrays(request)
        others = [self._extrapolated(other) for other in request.neighbours]
        other = np.array(others, dtype=np.float64).reshape(-1, 5)
        hulls = arrays.obstacles
        discs = Discs(
            slot=request.slot,
            uav=arrays.uav,
            position_m=arrays.position_m,
            target_m=arrays.target_m,
            step_m=self._steps_m(arrays),
            r_m=arrays.r_m,
            u_max_m=self._u_max_m[arrays.uav],
            other_m=other[:, 0:2],
            other_step_m=other[:, 2:4],
            other_r_m=other[:, 4],
            still_m=(hulls.a_m + hulls.b_m) / 2,
            still_r_m=length_m(hulls.b_m - hulls.a_m) / 2 + hulls.radius_m + hulls.keep_m,
        )
        self._slot = request.slot
        self._place_m = {k: (x, y) for k, (x, y) in zip(arrays.uav.tolist(), arrays.position_m.tolist(), strict=True)}
        return discs

    def _steps_m(self, arrays: Arrays) -> Floats:
        """Return the last step (n, 2) of each UAV in metres; 0 if nobody has told where it was one slot earlier."""
        if arrays.previous_m is not None:
            return arrays.position_m - arrays.previous_m
        known = self._place_m if arrays.slot == self._slot + 1 else {}
        here_m: list[tuple[float, float]] = [(x, y) for x, y in arrays.position_m.tolist()]
        before_m = [known.get(k, here) for k, here in zip(arrays.uav.tolist(), here_m, strict=True)]
        return arrays.position_m - np.array(before_m, dtype=np.float64).reshape(-1, 2)

    def _extrapolated(self, other: Neighbour) -> tuple[float, float, float, float, float]:
        """Return place, step and radius of a neighbour at the start of the slot to plan."""
        if other.age_slots > self._horizon_slots:
            return other.x_m, other.y_m, 0.0, 0.0, other.r_m
        x_m, y_m = other.x_m + other.age_slots * other.step_x_m, other.y_m + other.age_slots * other.step_y_m
        return x_m, y_m, other.step_x_m, other.step_y_m, other.r_m


def plan_of(discs: Discs, step_m: Floats, status: PlanStatus, plan_ms: float, iterations: int = 0) -> Plan:
    """Return the plan in which the UAVs fly these steps (n, 2), shortened to their longest ones."""
    waypoint_m = limited_waypoints(discs.position_m, discs.position_m + step_m, discs.u_max_m)
    return Plan(
        waypoint_m=[(x, y) for x, y in waypoint_m.tolist()],
        status=status,
        min_gap_m=least_end_gap_m(waypoint_m, discs.r_m),
        guidance_ms=plan_ms,
        iterations=iterations,
    )
