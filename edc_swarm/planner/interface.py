"""What a planner is given and what it returns: the one interface that every planner implements.

A user adds a planner by writing one file with a class that is made as `Class(mission, stopwatch)` and has
`plan`, and naming it as `--planner package.module:Class` (docs/planner.md). Importing this module imports
no numpy.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, Protocol

from edc_swarm.mission.configuration import Mission

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Points = Sequence[tuple[float, float]] | NDArray[np.float64]
    Scalars = Sequence[float] | NDArray[np.float64]

Stopwatch = Callable[[], int]
"""Nanoseconds of a clock that only grows; constantly zero in the simulator."""

PlanStatus = Literal["planned", "no-qp-needed", "failed"]


def stopped() -> int:
    """Read a stopwatch that never runs."""
    return 0


@dataclass(frozen=True, slots=True)
class Hull:
    """Where an unheard UAV can be: all points within `radius_m` of the segment a-b.

    Attributes
    ----------
    uav
        Index in the roster.
    ax_m, ay_m, bx_m, by_m
        End points of the segment in metres (equal: a ball, or a point).
    radius_m
        Uncertainty about the segment in metres, 0 for a UAV known to be on it.
    r_m
        GPS error radius of that UAV, to be kept clear of in addition.
    """

    uav: int
    ax_m: float
    ay_m: float
    bx_m: float
    by_m: float
    radius_m: float
    r_m: float


@dataclass(frozen=True, slots=True)
class PlanRequest:
    """One slot to be planned. The n commanded UAVs come in roster order.

    Attributes
    ----------
    slot
        The slot that the steps are for.
    uav
        (n,) indices in the roster; they identify a UAV from slot to slot.
    position_m
        (n, 2) centres of the tracked discs at the start of the slot.
    target_m
        (n, 2) where each UAV must finally go.
    r_m
        (n,) GPS error radii.
    hulls
        Where every other UAV of the roster can be.
    previous_m
        (n, 2) centres one slot earlier when `lag_slots` is 1, else None.
    """

    slot: int
    uav: Sequence[int]
    position_m: Points
    target_m: Points
    r_m: Scalars
    hulls: Sequence[Hull] = ()
    previous_m: Points | None = None


@dataclass(frozen=True, slots=True)
class Plan:
    """The next waypoints, parallel to `PlanRequest.uav`, exactly as they are to be published.

    `status` is "no-qp-needed" when the guidance's steps were safe as they were, "failed" when the
    solver gave nothing usable and all hold; `problem` then says why, if there is something to say.
    `min_gap_m` is the least planned distance between two centres minus R. Times come from the injected
    stopwatch, in milliseconds; a user's planner may leave them and `min_gap_m` at 0, to be filled in.
    """

    waypoint_m: list[tuple[float, float]]
    status: PlanStatus
    min_gap_m: float = 0.0
    guidance_ms: float = 0.0
    assemble_ms: float = 0.0
    solve_ms: float = 0.0
    iterations: int = 0
    problem: str = ""


def timeless(plan: Plan) -> Plan:
    """Return the plan without its measured times, which no two runs have in common."""
    return replace(plan, guidance_ms=0.0, assemble_ms=0.0, solve_ms=0.0)


class Planner(Protocol):
    """Plans one slot at a time; may remember what it planned (tracks, duals), never needs to."""

    def plan(self, request: PlanRequest) -> Plan:
        """Next waypoints of the UAVs of `request`."""
        ...


PlannerFactory = Callable[[Mission, Stopwatch], Planner]
