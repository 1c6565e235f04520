"""Planners by name, and what importing them costs."""

from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import replace
from itertools import count
from typing import Any

import numpy as np
import pytest

from edc_swarm.errors import MissionError
from edc_swarm.mission.configuration import Mission
from edc_swarm.planner.interface import Plan, PlanRequest, Stopwatch
from edc_swarm.planner.registry import check_planner, make_planner, warm_up


class Lazy:
    """A user's planner that moves nobody."""

    def __init__(self, mission: Mission, stopwatch: Stopwatch) -> None:
        self.made_for = (mission, stopwatch)

    def plan(self, request: PlanRequest) -> Plan:
        """Everyone stays."""
        return Plan(waypoint_m=[(float(x), float(y)) for x, y in request.position_m], status="planned")


def test_a_users_planner_is_found_by_module_and_class() -> None:
    """`package.module:Class` is imported and made with mission and stopwatch."""
    planner = make_planner(f"{__name__}:Lazy", Mission())
    plan = planner.plan(PlanRequest(0, [0], [(1.0, 2.0)], [(3.0, 4.0)], [5.0]))
    assert plan.waypoint_m == [(1.0, 2.0)]


@pytest.mark.parametrize("name", ["fastest", "no.such.module:Class", "math:NoSuchName", ":", "math:", ".:x"])
def test_unknown_planners_are_refused_with_what_is_allowed(name: str) -> None:
    """The error names the field, the value and the built-in planners."""
    with pytest.raises(MissionError, match="planner") as caught:
        make_planner(name, Mission())
    assert "edc" in caught.value.allowed
    with pytest.raises(MissionError):
        check_planner(Mission(planner=name))


@pytest.mark.parametrize("lag_slots", [0, 1])
@pytest.mark.parametrize("name", ["edc", "straight", "paper", "orca", "bvc", "cbf", "priority", f"{__name__}:Lazy"])
def test_planners_warm_up(name: str, lag_slots: int) -> None:
    """Warming up runs a tiny plan of the mission's own planner."""
    check_planner(Mission(planner=name, lag_slots=lag_slots))
    warm_up(Mission(planner=name, lag_slots=lag_slots))


class NoPlan:
    """Made, but plans nothing."""

    def __init__(self, mission: Mission, stopwatch: Stopwatch) -> None:
        pass


class Unmakable(Lazy):
    """Wants more than it is given."""

    def __init__(self, mission: Mission, stopwatch: Stopwatch, licence: str) -> None:
        super().__init__(mission, stopwatch)
        self.licence = licence


class Raises(Lazy):
    """Fails where it stands."""

    def plan(self, request: PlanRequest) -> Plan:
        """Fails where it stands."""
        raise ZeroDivisionError(f"nothing to divide {len(request.uav)} by")


class ReturnsPoints(Lazy):
    """Returns the points alone."""

    def plan(self, request: PlanRequest) -> Any:
        """Returns the points alone."""
        return list(request.position_m)


class TooFew(Lazy):
    """Forgets all but one."""

    def plan(self, request: PlanRequest) -> Plan:
        """Forgets all but one."""
        return Plan(super().plan(request).waypoint_m[:1], "planned")


class Nowhere(Lazy):
    """Sends everyone where no place is."""

    def plan(self, request: PlanRequest) -> Plan:
        """Sends everyone where no place is."""
        return Plan([(math.nan, 0.0)] * len(request.uav), "planned")


class OddStatus(Lazy):
    """Says a status that no report may carry."""

    def plan(self, request: PlanRequest) -> Plan:
        """Says a status that no report may carry."""
        return Plan(super().plan(request).waypoint_m, "fine")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("planner", "said"),
    [
        (NoPlan, "must be a class with a method plan"),
        (Unmakable, "must be made as Class(mission, stopwatch) (TypeError: "),
        (Raises, "(ZeroDivisionError: nothing to divide 2 by (test_planner_registry.py, line "),
        (ReturnsPoints, "plan() returned list, not Plan"),
        (TooFew, "waypoint_m has shape (1, 2), not (2, 2)"),
        (Nowhere, "waypoint_m[0] is (nan, 0.0)"),
        (OddStatus, "status is 'fine', not one of planned"),
    ],
)
def test_a_users_planner_that_cannot_plan_is_refused_in_one_line(planner: type, said: str) -> None:
    """Before anything is flown, with what is wrong and where."""
    with pytest.raises(MissionError, match="planner = ") as caught:
        check_planner(Mission(planner=f"{__name__}:{planner.__name__}"))
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


class Tiring(Lazy):
    """Flies straight at any speed at first, and knows no more later; keeps no time."""

    def plan(self, request: PlanRequest) -> Plan:
        """Straight to the target in one step."""
        if request.slot > 1:
            raise LookupError("no more ideas")
        return Plan(np.array(request.target_m), "planned")


REQUEST = PlanRequest(1, [0, 4], [(0.0, 0.0), (50.0, 0.0)], [(0.0, 9.0), (50.0, -1.0)], [5.0, 5.0])


def test_steps_are_cut_to_what_a_uav_flies() -> None:
    """Numpy arrays will do, steps beyond u_max are cut, and what is not told is filled in."""
    ticks = count(0, 2_000_000)
    plan = make_planner(f"{__name__}:Tiring", Mission(), lambda: next(ticks)).plan(REQUEST)
    assert plan.waypoint_m == [(0.0, pytest.approx(2.5)), (50.0, -1.0)]
    assert 2.5 - 1e-12 < plan.waypoint_m[0][1] <= 2.5
    assert {type(x) for point in plan.waypoint_m for x in point} == {float}
    assert (plan.guidance_ms, plan.min_gap_m) == (2.0, pytest.approx(math.hypot(50.0, 3.5) - 10.0))


def test_a_users_planner_that_fails_in_flight_makes_all_hold() -> None:
    """The plan says why, and where in the user's file."""
    plan = make_planner(f"{__name__}:Tiring", Mission()).plan(replace(REQUEST, slot=2))
    assert (plan.waypoint_m, plan.status) == ([(0.0, 0.0), (50.0, 0.0)], "failed")
    assert plan.problem.startswith("LookupError: no more ideas (test_planner_registry.py, line ")


def test_importing_the_interface_is_light() -> None:
    """A UAV that is no candidate imports the planner package without numpy, numba, scipy or osqp."""
    code = (
        "import sys, edc_swarm.planner, edc_swarm.planner.interface;"
        "print(*{'numpy', 'numba', 'scipy', 'osqp'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
