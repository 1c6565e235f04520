"""Planner "paper": eq. 29-43 as printed, over the whole horizon.

    minimise   sum_k sum_t |p_k(t) - p_k(t-1)|^2                                  (29)
    subject to p_k(t) = p_k(t-1) + v_k(t) dt                                      (30, 31)
               p_k(0), p_k(F) given                                               (32-35)
               |v_k(t)| <= v_max                                                  (36)
               a_kl(t) <= x_k - x_l,  a_kl <= x_l - x_k                           (37, 38)
               b_kl(t) <= y_k - y_l,  b_kl <= y_l - y_k                           (39, 40)
               -a_kl - b_kl >= R^2,   -a_kl >= 1,   -b_kl >= 1                    (41-43)

Eq. 36 is a cone; OSQP takes linear rows, so the regular 16-gon inside the circle replaces it. The
horizon is F = 1.1 x longest straight flight / (v_max dt), rounded up; the 10 % leave every direction
feasible inside the polygon.

The model is vacuous: eq. 37-43 bound the dotted variables a, b above but not below,
and they are not in the objective, so a, b -> -infinity satisfies eq. 37-43 whatever the positions.
The optimum is the equally spaced straight line, and discs overlap exactly as without avoidance
(a test proves it). Eq. 41 moreover compares metres with square metres, and eq. 6 would ask for twice
the distance of eq. 16. For long sweeps `eliminate=True` (the default of the planner) leaves out the
dotted variables; a test shows that this does not change the optimum.
"""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import osqp
import scipy.sparse

from edc_swarm.geometry import Floats, by_libm, length_m
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster_entry import ARRIVED_M
from edc_swarm.planner.interface import Plan, PlanRequest, PlanStatus, Stopwatch
from edc_swarm.planner.request import Arrays, checked_arrays
from edc_swarm.planner.straight import least_end_gap_m
from edc_swarm.solver.certificate import limited_waypoints

SIDES = 16
HORIZON_SHARE = 1.1
MAX_HORIZON = 2000
OFF_PLAN_M = 0.01
SETTINGS: dict[str, Any] = {
    "verbose": False,
    "eps_abs": 1e-7,
    "eps_rel": 0.0,
    "max_iter": 20_000,
    "time_limit": 1e10,
    "adaptive_rho": 0,
    "check_dualgap": False,
    "polishing": False,
}
RHO = 2.0
"""OSQP's step size times F^2, since the objective's curvature along a chain of F equal steps falls as 1 / F^2."""
_SOLVED = {1, 2}


class Paper:
    """The paper's optimisation, solved when a head takes office and when a UAV is off its plan."""

    def __init__(self, mission: Mission, stopwatch: Stopwatch, *, eliminate: bool = True) -> None:
        self._u_max_m = np.array(mission.steps_m)
        self._stopwatch = stopwatch
        self._eliminate = eliminate
        self._uav: tuple[int, ...] = ()
        self._path_m: Floats = np.empty((0, 0, 2))
        self._first_slot = 0

    def plan(self, request: PlanRequest) -> Plan:
        """Return the next waypoints of the UAVs of `request`."""
        ticks_ns = [self._stopwatch()]
        arrays = checked_arrays(request)
        status: PlanStatus = "no-qp-needed"
        iterations, assembled_ns = 0, ticks_ns[0]
        if not self._on_plan(arrays):
            program = horizon_program(
                arrays.position_m, arrays.target_m, arrays.r_m, self._u_max_m[arrays.uav], eliminate=self._eliminate
            )
            assembled_ns = self._stopwatch()
            path_m, iterations = solve_horizon(program, arrays.position_m, arrays.target_m)
            status = "planned" if path_m is not None else "failed"
            self._adopt(arrays, path_m)
        waypoint_m = limited_waypoints(arrays.position_m, self._place_m(arrays.slot + 1), self._u_max_m[arrays.uav])
        return Plan(
            waypoint_m=[(x, y) for x, y in waypoint_m.tolist()],
            status=status,
            min_gap_m=least_end_gap_m(waypoint_m, arrays.r_m),
            assemble_ms=(assembled_ns - ticks_ns[0]) / 1e6,
            solve_ms=(self._stopwatch() - assembled_ns) / 1e6,
            iterations=iterations,
        )

    def _on_plan(self, arrays: Arrays) -> bool:
        """Return True if these UAVs have a plan, and each is at its planned position or has arrived."""
        if not self._uav or tuple(arrays.uav) != self._uav or arrays.slot < self._first_slot:
            return False
        off = length_m(arrays.position_m - self._place_m(arrays.slot)) > OFF_PLAN_M
        return not (off & (length_m(arrays.position_m - arrays.target_m) > ARRIVED_M)).any()

    def _adopt(self, arrays: Arrays, path_m: Floats | None) -> None:
        """Keep a plan; without one all UAVs hold in this slot and the next request solves again."""
        self._uav = tuple(arrays.uav) if path_m is not None else ()
        self._path_m = path_m if path_m is not None else arrays.position_m[None]
        self._first_slot = arrays.slot

    def _place_m(self, slot: int) -> Floats:
        """Return the planned positions (n, 2) at the start of a slot."""
        return np.asarray(self._path_m[min(slot - self._first_slot, len(self._path_m) - 1)])


class HorizonProgram:
    """min 1/2 x'Px + q'x subject to l <= Ax <= u, with x = (positions, velocities, dotted).

    `horizon` F slots and `count` UAVs; positions and steps are ordered [t][k][axis], t = 1..F.
    Steps v dt stand for velocities, in metres.
    """

    def __init__(self, horizon: int, count: int) -> None:
        self.horizon, self.count = horizon, count
        self.blocks: list[Any] = []
        self.lower: list[Floats] = []
        self.upper: list[Floats] = []

    def add(self, block: Any, lower: Floats, upper: Floats) -> None:
        """Append rows."""
        self.blocks.append(block)
        self.lower.append(lower)
        self.upper.append(upper)


def horizon_slots(position_m: Floats, target_m: Floats, u_max_m: Floats | float) -> int:
    """Return F, the slots from here to the targets, at least 1; `u_max_m` is (n,), or one for all."""
    longest = float((HORIZON_SHARE * length_m(target_m - position_m) / u_max_m).max(initial=0.0))
    return min(max(math.ceil(longest), 1), MAX_HORIZON)


def horizon_program(
    position_m: Floats, target_m: Floats, r_m: Floats, u_max_m: Floats | float, *, eliminate: bool
) -> HorizonProgram:
    """Return eq. 30-43 as rows; `eliminate` leaves out the dotted variables with eq. 37-43."""
    count, horizon = len(position_m), horizon_slots(position_m, target_m, u_max_m)
    program = HorizonProgram(horizon, count)
    size = 2 * count * horizon
    identity = scipy.sparse.identity(size, format="csc")
    before = scipy.sparse.eye(size, k=-2 * count, format="csc")
    start = np.zeros(size)
    start[: 2 * count] = position_m.ravel()
    program.add(scipy.sparse.hstack([identity - before, -identity]), start, start)
    last = scipy.sparse.eye(2 * count, size, k=size - 2 * count, format="csc")
    program.add(scipy.sparse.hstack([last, _zeros(2 * count, size)]), target_m.ravel(), target_m.ravel())
    polygon, limit_m = _polygon(np.tile(np.broadcast_to(u_max_m, (count,)), horizon))
    program.add(scipy.sparse.hstack([_zeros(polygon.shape[0], size), polygon]), -limit_m, limit_m)
    if not eliminate:
        _add_dotted(program, r_m)
    return program


def solve_horizon(program: HorizonProgram, position_m: Floats, target_m: Floats) -> tuple[Floats | None, int]:
    """Return positions (F + 1, n, 2) from now to the targets, or None; and OSQP's iterations.

    The unit of length is the longest flight, which suits the solver's tolerances.
    """
    count, horizon = program.count, program.horizon
    if not count:
        return position_m[None], 0
    scale_m = max(float(length_m(target_m - position_m).max()), 1e-6)
    matrix = scipy.sparse.vstack(
        [_widened(block, program.blocks[-1].shape[1]) for block in program.blocks], format="csc"
    )
    size = 2 * count * horizon
    weight = np.zeros(matrix.shape[1])
    weight[size : 2 * size] = 2.0
    origin_m = position_m.mean(axis=0)
    shift = np.zeros(matrix.shape[1])
    shift[:size] = np.tile(origin_m, count * horizon)
    moved = matrix @ shift
    lower, upper = ((np.concatenate(bounds) - moved) / scale_m for bounds in (program.lower, program.upper))
    solver = osqp.OSQP(algebra="builtin")
    solver.setup(
        scipy.sparse.csc_matrix(scipy.sparse.diags(weight)),
        np.zeros(matrix.shape[1]), scipy.sparse.csc_matrix(matrix), lower, upper, rho=RHO / horizon**2, **SETTINGS,
    )  # fmt: skip
    result = solver.solve(raise_error=False)
    if result.info.status_val not in _SOLVED or not np.isfinite(result.x).all():
        return None, int(result.info.iter)
    path_m = result.x[:size].reshape(horizon, count, 2) * scale_m + origin_m
    path_m[-1] = target_m
    return np.concatenate([position_m[None], path_m]), int(result.info.iter)


def _polygon(radius_m: Floats) -> tuple[Any, Floats]:
    """Return rows |n.v| <= apothem over half the normals of the 16-gons inscribed in circles (v,) (eq. 36)."""
    angle = np.arange(SIDES // 2) * 2 * np.pi / SIDES
    normals = np.stack([by_libm(math.cos, angle), by_libm(math.sin, angle)], axis=-1)
    rows = scipy.sparse.kron(scipy.sparse.identity(len(radius_m)), normals, format="csc")
    return rows, np.repeat(radius_m * math.cos(math.pi / SIDES), SIDES // 2)


def _add_dotted(program: HorizonProgram, r_m: Floats) -> None:
    """Add eq. 37-43 with a dotted pair of variables for every ordered pair of UAVs and every slot."""
    count, horizon = program.count, program.horizon
    pairs = list(itertools.permutations(range(count), 2))
    if not pairs:
        return
    rows = np.arange(len(pairs))
    first, second = np.array(pairs).T
    difference = scipy.sparse.csc_matrix(
        (np.concatenate([np.ones(len(pairs)), -np.ones(len(pairs))]), (np.tile(rows, 2), np.r_[first, second])),
        shape=(len(pairs), count),
    )
    axes = scipy.sparse.kron(difference, scipy.sparse.identity(2))
    apart = scipy.sparse.kron(scipy.sparse.identity(horizon), axes)
    dotted = scipy.sparse.identity(apart.shape[0])
    none = _zeros(apart.shape[0], 2 * count * horizon)
    free = np.full(apart.shape[0], np.inf)
    for sign in (1, -1):
        program.add(scipy.sparse.hstack([-sign * apart, none, dotted]), -free, np.zeros(len(free)))
    both = scipy.sparse.kron(scipy.sparse.identity(apart.shape[0] // 2), np.ones((1, 2)))
    nothing = _zeros(both.shape[0], 4 * count * horizon)
    squared = np.tile((r_m[first] + r_m[second]) ** 2, horizon)
    program.add(scipy.sparse.hstack([nothing, both]), np.full(len(squared), -np.inf), -squared)
    program.add(scipy.sparse.hstack([none, none, dotted]), -free, -np.ones(len(free)))


def _zeros(rows: int, columns: int) -> Any:
    return scipy.sparse.csc_matrix((rows, columns))


def _widened(block: Any, columns: int) -> Any:
    missing = columns - block.shape[1]
    return scipy.sparse.hstack([block, _zeros(block.shape[0], missing)]) if missing else block
