"""Planners by name, and what importing them costs."""

from __future__ import annotations

import subprocess
import sys

import pytest

from edc_swarm.config import Mission
from edc_swarm.errors import MissionError
from edc_swarm.planner import Plan, PlanRequest, Stopwatch, check_planner, make_planner, warm_up


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
        check_planner(name)


@pytest.mark.parametrize("name", ["edc", "straight", "paper"])
def test_built_in_planners_warm_up(name: str) -> None:
    """Warming up runs a tiny plan of the mission's own planner."""
    check_planner(name)
    warm_up(Mission(planner=name))


def test_importing_the_interface_is_light() -> None:
    """A UAV that is no candidate imports the planner package without numpy, numba, scipy or osqp."""
    code = (
        "import sys, edc_swarm.planner, edc_swarm.planner.interface;"
        "print(*{'numpy', 'numba', 'scipy', 'osqp'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
