"""Interface that every planner implements: `PlanRequest` in, `Plan` out.

To add a planner, a user writes one file with a class that has a constructor `Class(mission, stopwatch)` and a
method `plan`, and passes `--planner package.module:Class` (docs/planner.md). This module imports no numpy.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, Protocol

from edc_swarm.mission.configuration import Mission

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Points = Sequence[Sequence[float]] | NDArray[np.float64]
    Scalars = Sequence[float] | NDArray[np.float64]
    Numbers = Sequence[int] | NDArray[np.int64]

Stopwatch = Callable[[], int]
"""Nanoseconds of a clock that only grows; constantly zero in the simulator."""

PlanStatus = Literal["planned", "no-qp-needed", "failed"]


def stopped() -> int:
    """Return 0: a stopwatch that never runs."""
    return 0


@dataclass(frozen=True, slots=True)
class Hull:
    """Hull of an unheard UAV: all points within `radius_m` of the segment a-b, where the UAV can be.

    Attributes
    ----------
    uav
        Index in the roster.
    ax_m, ay_m, bx_m, by_m
        End points of the segment in metres (equal: a ball, or a point).
    radius_m
        Distance from the segment in metres, 0 for a UAV on it.
    r_m
        Radius of that UAV's disc, which a plan keeps in addition.
    """

    uav: int
    ax_m: float
    ay_m: float
    bx_m: float
    by_m: float
    radius_m: float
    r_m: float


@dataclass(frozen=True, slots=True)
class Neighbour:
    """Another UAV as a UAV that plans for itself alone knows it (local control).

    Attributes
    ----------
    uav
        Index in the roster.
    x_m, y_m
        Waypoint in its newest fix that has arrived; its start if none has.
    step_x_m, step_y_m
        Step that it flew in the slot of that fix.
    r_m
        Radius of its disc in metres.
    age_slots
        Slots from the end of that step to the start of the slot to plan, 0 for a fix of the slot before. The planner
        extrapolates as its method says.
    """

    uav: int
    x_m: float
    y_m: float
    step_x_m: float
    step_y_m: float
    r_m: float
    age_slots: int = 0


@dataclass(frozen=True, slots=True)
class ForeignUav:
    """A UAV of another cluster, by its fix of the slot before the one to plan.

    Attributes
    ----------
    uav
        Index in the roster.
    position_m, previous_m
        Centre of its tracked disc at the start of the slot to plan, and one slot earlier.
    target_m, rest_m
        Point that it flies to now, and the length of the way beyond.
    r_m
        Radius of its disc in metres.
    """

    uav: int
    position_m: tuple[float, float]
    previous_m: tuple[float, float]
    target_m: tuple[float, float]
    rest_m: float
    r_m: float


@dataclass(frozen=True, slots=True)
class PlanRequest:
    """Request for the plan of one slot. The n commanded UAVs come in roster order.

    Attributes
    ----------
    slot
        The slot of the steps.
    uav
        (n,) indices in the roster; they identify a UAV from slot to slot.
    position_m
        (n, 2) centres of the tracked discs at the start of the slot.
    target_m
        (n, 2) point that each UAV flies to now: its target, or a point of its route.
    r_m
        (n,) radii of the discs.
    hulls
        Hulls of the other UAVs of the cluster that are in the airspace, and of foreign UAVs that stray.
    previous_m
        (n, 2) centres one slot earlier when `lag_slots` is 1 or a vehicle has inertia, else None.
    rest_m
        (n,) length of the way beyond `target_m`, 0 for the last point of a route; None for 0 everywhere.
    neighbours
        UAVs that plan for themselves (local control); empty in the request of a head.
    foreign, foreign_hulls
        UAVs of other clusters, which heads of their own move: those whose fixes of the slot before have come, and the
        hulls of the others that are near when the slot to plan begins. Steps keep to their half of the gap
        (`solver.foreign_rows`).
    """

    slot: int
    uav: Numbers
    position_m: Points
    target_m: Points
    r_m: Scalars
    hulls: Sequence[Hull] = ()
    previous_m: Points | None = None
    rest_m: Scalars | None = None
    neighbours: Sequence[Neighbour] = ()
    foreign: Sequence[ForeignUav] = ()
    foreign_hulls: Sequence[Hull] = ()


@dataclass(frozen=True, slots=True)
class Plan:
    """The next waypoints, parallel to `PlanRequest.uav`, exactly as the head publishes them.

    `status` is "no-qp-needed" if the preferred steps were safe, "failed" if the
    solver has no usable result and all hold; `problem` then has the reason, if one is known.
    `min_gap_m` is the least planned distance between two centres minus R. Times come from the injected
    stopwatch, in milliseconds. A user's planner may leave times and `min_gap_m` at 0; the caller then fills them in,
    and makes tuples of its waypoints.
    """

    waypoint_m: Points
    status: PlanStatus
    min_gap_m: float = 0.0
    guidance_ms: float = 0.0
    assemble_ms: float = 0.0
    solve_ms: float = 0.0
    iterations: int = 0
    problem: str = ""


def plan_ms(plan: Plan) -> float:
    """Return the time that a plan took in all, in milliseconds."""
    return plan.guidance_ms + plan.assemble_ms + plan.solve_ms


def timeless(plan: Plan) -> Plan:
    """Return the plan without its measured times, which differ from run to run."""
    return replace(plan, guidance_ms=0.0, assemble_ms=0.0, solve_ms=0.0)


class Planner(Protocol):
    """Planner of one slot at a time; it may keep state between slots (tracks, duals), but must not need it."""

    def plan(self, request: PlanRequest) -> Plan:
        """Return the next waypoints of the UAVs of `request`."""
        ...


PlannerFactory = Callable[[Mission, Stopwatch], Planner]
