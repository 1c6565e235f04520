"""Loading a planner: at once where it is imported and warm already, else without stopping the loop."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from edc_swarm.mission.configuration import Mission
from edc_swarm.planner.interface import Plan, Planner, PlanRequest

_warm_for: set[str] = set()
"""Planners that this process, or the one it was forked from, has imported and warmed up."""


def warm_planner(mission: Mission) -> None:
    """Import and warm up the mission's planner, once; everything forked from here on has it."""
    if mission.planner in _warm_for:
        return
    from edc_swarm.planner.registry import warm_up  # noqa: PLC0415  (imports numpy: only who may lead pays for it)

    warm_up(mission)
    _warm_for.add(mission.planner)


def load_planner(mission: Mission, ready: Callable[[Planner], None]) -> None:
    """Hand the planner to `ready`: before returning when it is warm, else from a thread."""
    if mission.planner in _warm_for:
        ready(_made(mission))
    else:
        threading.Thread(target=_load, args=(mission, ready), name="planner", daemon=True).start()


def _load(mission: Mission, ready: Callable[[Planner], None]) -> None:
    warm_planner(mission)
    ready(_made(mission))


def _made(mission: Mission) -> Planner:
    from edc_swarm.planner.registry import make_planner  # noqa: PLC0415

    return make_planner(mission.planner, mission, time.perf_counter_ns)


class SlowPlanner:
    """A planner that a fault can slow down, as a slower computer would be."""

    def __init__(self, planner: Planner) -> None:
        self._planner = planner
        self._by_s = 0.0
        self._until_s = 0.0

    def slow_down(self, by_s: float, for_s: float) -> None:
        """Let every plan take `by_s` longer, for the next `for_s` seconds."""
        self._by_s, self._until_s = by_s, time.monotonic() + for_s

    def plan(self, request: PlanRequest) -> Plan:
        """Plan, and take longer about it."""
        plan = self._planner.plan(request)
        if self._by_s and time.monotonic() < self._until_s:
            time.sleep(self._by_s)
        return plan
