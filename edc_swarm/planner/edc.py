"""Planner "edc": guidance prefers steps, the slot QP makes them safe, the certificate checks them last."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from edc_swarm.emulation.energy import propulsion_power_w
from edc_swarm.geometry import Floats, point_segment_distance_m
from edc_swarm.mission.braking import changes_m
from edc_swarm.mission.configuration import Mission
from edc_swarm.planner import ways
from edc_swarm.planner.guidance import Guidance, Scene, Tuning
from edc_swarm.planner.interface import Plan, PlanRequest, Stopwatch
from edc_swarm.planner.pilot import momentum_of, slowed_m, step_changes
from edc_swarm.planner.request import Arrays, ForeignArrays, checked_arrays
from edc_swarm.planner.safe import SafeSteps, airspace_of
from edc_swarm.solver import certificate, slot_qp
from edc_swarm.solver.barrier_rows import barrier_rows
from edc_swarm.solver.hull_rows import Obstacles
from edc_swarm.solver.normals import DELTA_M

TOUCH_M = 1.5 * DELTA_M
"""Distance beyond D up to which a UAV touches a barrier."""
SMALL_HULL_SLOTS = 3
"""Steps up to which the radius of a foreign UAV's hull is small."""


def weights(mission: Mission, speed_mps: float) -> tuple[float, float]:
    """Return the prices (wt, wd) of a slot of time and of a full step of distance at `speed_mps`; wt + wd = 1.

    ==========  =========================================  ===================================================
    minimise    (wt, wd)                                   reason
    ==========  =========================================  ===================================================
    time        (1, 0)                                     earliest arrival
    distance    (1/2, 1/2)                                 with a higher wd UAVs wait for each other rather
                                                           than fly round, and missions stall
    energy      wt = min(P(0) / P(v_max), 1), wd = 1 - wt  a slot at full speed costs P(v_max), a hold P(0)
    ==========  =========================================  ===================================================
    """
    if mission.minimise == "distance":
        return 0.5, 0.5
    if mission.minimise == "time":
        return 1.0, 0.0
    hover_w = propulsion_power_w(0.0, mission.energy)
    cruise_w = propulsion_power_w(speed_mps, mission.energy)
    share = min(hover_w / cruise_w, 1.0)
    return share, 1.0 - share


class Edc:
    """The project's own planner: its missions complete, and its steps are free of overlaps in every execution."""

    def __init__(self, mission: Mission, stopwatch: Stopwatch, tuning: Tuning | None = None) -> None:
        self._u_max_m = np.array(mission.steps_m)
        self._start_m = np.array([(entry.start_x_m, entry.start_y_m) for entry in mission.roster])
        self._stopwatch = stopwatch
        self._airspace = airspace_of(mission)
        prices = np.array([weights(mission, speed_mps) for speed_mps in mission.speeds_mps])
        tuning = tuning or Tuning(responses=mission.responses)
        self._guidance = Guidance(self._u_max_m, prices, mission.seed, tuning, self._airspace)
        self._change_m = step_changes(mission)
        self._safe = SafeSteps(
            mission.steps_m, stopwatch, self._airspace, changes_m(mission), lags=mission.lag_slots > 0
        )

    @property
    def priced_steps(self) -> int:
        """Steps that guidance has priced for the last plan."""
        return self._guidance.priced_steps

    def plan(self, request: PlanRequest) -> Plan:
        """Return the next waypoints of the UAVs of `request`."""
        started_ns = self._stopwatch()
        arrays = checked_arrays(request)
        wish_m = self._wishes(arrays)
        momentum = momentum_of(arrays, self._u_max_m, self._change_m)
        if momentum is not None:
            wish_m = slowed_m(momentum, wish_m, arrays.target_m)
        return self._safe.plan(arrays, wish_m, guidance_ms=(self._stopwatch() - started_ns) / 1e6)

    def _wishes(self, arrays: Arrays) -> Floats:
        """Return the preferred waypoints: those of guidance, but for UAVs that must first fly away from a hull."""
        free, obstacles = ~self._held(arrays), self._with_foreign_hulls(arrays)
        if not free.all():
            # A plan for a UAV that cannot move would only keep others from going where it never goes.
            still_m, still_r_m = arrays.position_m[~free], arrays.r_m[~free]
            obstacles = obstacles.followed_by(Obstacles(still_m, still_m, np.zeros(len(still_m)), still_r_m))
        position_m, r_m = arrays.position_m[free], arrays.r_m[free]
        goal_m = ways.free_goals(arrays.target_m[free], r_m, obstacles, self._airspace)
        wish_m = arrays.position_m.copy()
        scene = Scene(arrays.slot, arrays.uav[free], position_m, goal_m, r_m, obstacles, arrays.rest_m[free])
        scene = with_foreign(scene, arrays.foreign)
        wish_m[free] = self._guidance.wishes(scene, in_flight=self._in_flight(arrays))[: len(position_m)]
        if len(arrays.obstacles.keep_m) and len(arrays.uav):
            self._leave(arrays, wish_m)
        return wish_m

    def _in_flight(self, arrays: Arrays) -> bool:
        """Return True if a UAV has left its start; a planner that is given no roster knows none."""
        return bool(len(self._start_m)) and bool((arrays.position_m != self._start_m[arrays.uav]).any())

    def _with_foreign_hulls(self, arrays: Arrays) -> Obstacles:
        """Return the hulls with those of foreign UAVs that are small: such a UAV is dead, or unheard for a few slots.

        A large hull tells nothing of where its UAV goes, and would be no way round.
        """
        hulls, obstacles = arrays.foreign.hulls, arrays.obstacles
        small = hulls.radius_m <= SMALL_HULL_SLOTS * float(self._u_max_m.max(initial=0.0))
        return obstacles.followed_by(hulls.chosen(small)) if small.any() else obstacles

    def _held(self, arrays: Arrays) -> NDArray[np.bool_]:
        """(n,) UAVs within a hull, or nearer than R to hulls without a step that leads away from all of them.

        No step leads towards a barrier that the UAV touches (`protocol.hindrance` has the same rule).
        """
        if not len(arrays.obstacles.keep_m):
            return np.zeros(len(arrays.uav), dtype=bool)
        u_max_m = self._u_max_m[arrays.uav]
        alone = slot_qp.slot_problem(arrays.position_m, arrays.position_m, arrays.r_m, u_max_m, arrays.obstacles)
        held = alone.frozen.copy()
        near = np.unique(alone.row_uav[alone.row_room_m == 0])
        here_m = arrays.position_m[near]
        walled, wall_normal, room_m, _ = barrier_rows(here_m, here_m, arrays.r_m[near], u_max_m[near], self._airspace)
        for row, k in enumerate(near.tolist()):
            normal = alone.row_normal[(alone.row_uav == k) & (alone.row_room_m == 0)]
            walls = wall_normal[(walled == row) & (room_m < TOUCH_M)]
            held[k] |= not ways.clearest(np.concatenate([normal, walls])).any()
        return held

    def _leave(self, arrays: Arrays, wish_m: Floats) -> None:
        """Send UAVs nearer than R to a hull away from it, if their preferred and allowed steps hardly do.

        Nearer than R a UAV may fly only steps that come nearer to no point of the hull. It flies the one
        farthest from the bounds of these steps.
        """
        u_max_m = self._u_max_m[arrays.uav]
        alone = slot_qp.slot_problem(arrays.position_m, wish_m, arrays.r_m, u_max_m, arrays.obstacles)
        lack_m = self._lack_m(arrays, arrays.position_m)
        for k in np.flatnonzero((lack_m > 0).any(axis=1) & ~alone.frozen).tolist():
            inner = (alone.row_uav == k) & (alone.row_room_m == 0)
            normal = alone.row_normal[inner]
            step_m = certificate.nearest_step_m(alone.wish_step_m[k], normal, np.zeros(len(normal)))
            gained_m = lack_m[k] - self._lack_m(arrays, arrays.position_m[k] + step_m, k)
            must_m = np.minimum(lack_m[k] + DELTA_M, u_max_m[k])[lack_m[k] > 0]
            if (gained_m[lack_m[k] > 0] < must_m / 2).any():
                far_m = min(float(lack_m[k].max()) + 2 * DELTA_M, u_max_m[k])
                wish_m[k] = arrays.position_m[k] + far_m * ways.clearest(normal)

    def _lack_m(self, arrays: Arrays, point_m: Floats, k: int | None = None) -> Floats:
        """Return R minus the distance of the points from each hull, (n, m), or (m,) for one point of UAV `k`."""
        obstacles = arrays.obstacles
        r_m = arrays.r_m[:, None] if k is None else arrays.r_m[k]
        away_m = point_segment_distance_m(point_m[..., None, :], obstacles.a_m, obstacles.b_m)
        return np.asarray(r_m + obstacles.keep_m + obstacles.radius_m - away_m)


def with_foreign(scene: Scene, foreign: ForeignArrays) -> Scene:
    """Return the scene with the UAVs of other clusters behind the own ones.

    Guidance plans for both, with the same rules of right of way, which are those of the other heads too.
    """
    if not len(foreign.uav):
        return scene
    return Scene(
        scene.slot,
        np.concatenate([scene.uav, foreign.uav]),
        np.concatenate([scene.position_m, foreign.position_m]),
        np.concatenate([scene.goal_m, foreign.target_m]),
        np.concatenate([scene.r_m, foreign.r_m]),
        scene.obstacles,
        np.concatenate([np.broadcast_to(scene.rest_m, len(scene.uav)), foreign.rest_m]),
        len(foreign.uav),
    )
