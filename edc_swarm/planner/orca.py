"""Planner "orca": optimal reciprocal collision avoidance, by the RVO2 library.

Source: J. van den Berg, S. J. Guy, M. Lin, D. Manocha, "Reciprocal n-body collision avoidance", ISRR 2011. The linear
programs are those of the authors' library RVO2, in the wheel `pyrvo` (extra `baselines`).

Each UAV takes half of the change of the relative velocity that keeps a pair apart for `HORIZON_S`. A neighbour is taken
to keep its velocity: so the method assumes at every step, and so a neighbour whose fixes are missing is extrapolated,
for at most the horizon. Hulls are static obstacles, which UAVs avoid alone. As in the example `Circle` of
the library, a tiny disturbance of the preferred velocity breaks perfect symmetry.

Nothing is proved for steps that a UAV flies unevenly, or not at all: G3 says what was measured.
"""

from __future__ import annotations

import math
from random import Random
from typing import Any

import numpy as np

from edc_swarm.extras import check_planner_extra
from edc_swarm.geometry import Floats
from edc_swarm.mission.configuration import Mission
from edc_swarm.planner.discs import CLEARANCE_M, Discs, Sight, plan_of
from edc_swarm.planner.interface import Plan, PlanRequest, Stopwatch

HORIZON_S = 5.0
"""Time for which a pair stays apart at the chosen velocities; at least two slots."""
DISTURBANCE = 1e-4
"""Length of the disturbance of a preferred step, as a share of the longest step."""
HULL_SIDES = 8
"""Corners of the polygon about a hull's disc."""


class Orca:
    """Planner of ORCA velocities, for all UAVs or for one among its neighbours."""

    def __init__(self, mission: Mission, stopwatch: Stopwatch) -> None:
        check_planner_extra("orca")
        import pyrvo  # noqa: PLC0415  (an extra)

        self._pyrvo = pyrvo
        self._stopwatch = stopwatch
        self._seed = mission.seed
        self._horizon_slots = max(2.0, HORIZON_S / mission.dt_s)
        self._sight = Sight(mission, self._horizon_slots)

    def plan(self, request: PlanRequest) -> Plan:
        """Return the next waypoints of the UAVs of `request`."""
        started_ns = self._stopwatch()
        discs = self._sight.discs(request)
        step_m = self._steps_m(discs)
        return plan_of(discs, step_m, "planned", (self._stopwatch() - started_ns) / 1e6)

    def _steps_m(self, discs: Discs) -> Floats:
        """Return the ORCA steps (n, 2); the unit of the library's time is a slot."""
        count = len(discs.uav)
        wish_m = discs.wish_m
        if not count:
            return wish_m
        middle_m = discs.position_m.mean(axis=0)
        simulator = self._pyrvo.RVOSimulator()
        simulator.set_time_step(1.0)
        self._add_moving(simulator, discs, middle_m)
        for k, (x_m, y_m) in enumerate((wish_m + self._disturbances_m(discs)).tolist()):
            simulator.set_agent_pref_velocity(k, (x_m, y_m))
        for (x_m, y_m), r_m in zip((discs.still_m - middle_m).tolist(), discs.still_r_m.tolist(), strict=True):
            simulator.add_obstacle(_polygon_m(x_m, y_m, r_m))
        simulator.process_obstacles()
        simulator.do_step()
        step_m = np.array([simulator.get_agent_velocity(k).to_tuple() for k in range(count)])
        # 24 bits of precision must not keep a UAV away from its target.
        free = np.abs(step_m - wish_m).max(axis=1) <= 2 * DISTURBANCE * discs.u_max_m
        return np.where(free[:, None], wish_m, step_m)

    def _add_moving(self, simulator: Any, discs: Discs, middle_m: Floats) -> None:
        """Add the UAVs to plan for, then the neighbours, which choose no velocity and so look at nobody."""
        position_m, step_m, r_m = discs.moving
        count, most = len(discs.uav), len(r_m) - 1
        fastest_m = max(float(discs.u_max_m.max()), float(np.hypot(*step_m.T).max(initial=0.0)))
        reach_m = 2 * float(r_m.max()) + 2 * fastest_m * self._horizon_slots
        for k, ((x_m, y_m), (sx_m, sy_m), r) in enumerate(
            zip((position_m - middle_m).tolist(), step_m.tolist(), r_m.tolist(), strict=True)
        ):
            own = k < count
            simulator.add_agent(
                (x_m, y_m),
                reach_m,
                most if own else 0,
                self._horizon_slots,
                self._horizon_slots,
                r + CLEARANCE_M,
                float(discs.u_max_m[k]) if own else fastest_m,
                (sx_m, sy_m),
            )

    def _disturbances_m(self, discs: Discs) -> Floats:
        """Return disturbances (n, 2) that depend on seed, slot and UAV alone."""
        found = []
        for k, u_max_m in zip(discs.uav.tolist(), discs.u_max_m.tolist(), strict=True):
            random = Random(f"{self._seed}/orca/{discs.slot}/{k}")
            angle, length_m = random.uniform(0, math.tau), random.uniform(0, DISTURBANCE * u_max_m)
            found.append((length_m * math.cos(angle), length_m * math.sin(angle)))
        return np.array(found)


def _polygon_m(x_m: float, y_m: float, r_m: float) -> list[tuple[float, float]]:
    """Return the corners, counter-clockwise, of the regular polygon about a disc."""
    far_m = r_m / math.cos(math.pi / HULL_SIDES)
    angles = (math.tau * i / HULL_SIDES for i in range(HULL_SIDES))
    return [(x_m + far_m * math.cos(angle), y_m + far_m * math.sin(angle)) for angle in angles]
