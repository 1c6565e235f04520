"""Plan times of simulations are thread time: to wait for the processor costs nothing."""

from __future__ import annotations

import time

import pytest

from edc_swarm.analysis.timings import Timing
from edc_swarm.planner.interface import Plan, PlanRequest
from edc_swarm.planner.straight import Straight
from processes.experiments.timed_planner import TimedPlanner
from tests.builders import mission, row


def test_a_planner_that_waits_takes_no_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """The clocks stand still while a planner sleeps, and count what it computes."""
    plan, wait_s = Straight.plan, 0.2

    def waits(self: Straight, request: PlanRequest) -> Plan:
        time.sleep(wait_s)
        found = plan(self, request)
        spent_ns = time.thread_time_ns() + 5_000_000
        while time.thread_time_ns() < spent_ns:
            pass
        return found

    monkeypatch.setattr(Straight, "plan", waits)
    timings = list[Timing]()
    planner = TimedPlanner(mission(row("ab", 20.0, 9.0), planner="straight"), timings)
    request = PlanRequest(slot=1, uav=[0, 1], position_m=[(0, 0), (20, 0)], target_m=[(0, 9), (20, 9)], r_m=[5, 5])
    planner.plan(request)
    (timing,) = timings
    assert 5.0 <= timing.plan_ms < 1000 * wait_s
