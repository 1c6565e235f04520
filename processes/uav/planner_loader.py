"""Loading of a planner: at once if it is warm, else on a thread, so that the loop does not stop."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from edc_swarm.mission.braking import changes_m
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.routes import Course
from edc_swarm.planner.interface import Plan, Planner, PlanRequest
from processes.uav.compiling_helper import Helper

OWN_PLANNER = "edc"
"""The planner that is compiled."""
BESIDE_S = 0.005
"""Time for which the loop waits for the interpreter while the planner is loaded; Python's default."""
_warm_for: set[str] = set()
"""Planners that this process, or the process that forked it, has imported and warmed up."""


def _nobody(_: int) -> None:
    """Tell nobody."""


def warm_planner(mission: Mission, tell: Callable[[int], None] = _nobody, *, helped: bool = False) -> None:
    """Import and warm up the mission's planner once; processes forked later inherit it.

    `tell` is called with the number of functions compiled so far, at every one. With `helped` a second process compiles
    a share of them if there is anything to compile; it ends before the return.
    """
    if mission.planner in _warm_for:
        return
    from edc_swarm.planner.compiler import is_ready  # noqa: PLC0415  (imports numpy)
    from edc_swarm.planner.registry import warm_up  # noqa: PLC0415  (imports numpy: only a possible head needs it)

    if mission.planner != OWN_PLANNER or is_ready():
        warm_up(mission)
    else:
        from edc_swarm.planner.first_start import compile_search  # noqa: PLC0415  (imports numba)

        with Helper(mission, wanted=helped) as helper, _counted(tell, helper.begin):
            compile_search()
            helper.wait()
            warm_up(mission)
    _warm_for.add(mission.planner)


def load_planner(mission: Mission, ready: Callable[[Planner], None], *, rehearsed: bool) -> None:
    """Pass the planner, `rehearsed` or not, to `ready`: before the return if it is warm, else from a thread."""
    if mission.planner in _warm_for:
        ready(_new_planner(mission, rehearsed))
    else:
        threading.Thread(target=_load, args=(mission, ready, rehearsed), name="planner", daemon=True).start()


def _load(mission: Mission, ready: Callable[[Planner], None], rehearsed: bool) -> None:
    """Load the planner beside the loop, which takes the interpreter back whenever it has to work."""
    before_s = sys.getswitchinterval()
    sys.setswitchinterval(BESIDE_S)
    try:
        warm_planner(mission)
        planner = _new_planner(mission, rehearsed)
    finally:
        sys.setswitchinterval(before_s)
    ready(planner)


def _new_planner(mission: Mission, rehearsed: bool) -> Planner:
    from edc_swarm.planner.registry import BUILT_IN, make_planner  # noqa: PLC0415

    if rehearsed and mission.planner in BUILT_IN:
        make_planner(mission.planner, mission).plan(_from_the_mission(mission))
    return make_planner(mission.planner, mission, time.perf_counter_ns)


def _from_the_mission(mission: Mission) -> PlanRequest:
    """Return the request for the mission's first plan, which a planner rehearses before it may have to lead.

    A first plan may take three times as long as those that follow: a forked process then gets its own copy of each page
    of memory that it writes to, and new memory for the arrays of a swarm of this size.
    """
    start_m = [(entry.start_x_m, entry.start_y_m) for entry in mission.roster]
    aims = [
        Course().aim(e, here_m, mission.step_m(e), mission.dt_s)
        for e, here_m in zip(mission.roster, start_m, strict=True)
    ]
    return PlanRequest(
        slot=0,
        uav=range(len(mission.roster)),
        position_m=start_m,
        target_m=[aim_m for aim_m, _ in aims],
        rest_m=[rest_m for _, rest_m in aims],
        r_m=[entry.r_m for entry in mission.roster],
        previous_m=start_m if mission.lag_slots or changes_m(mission) is not None else None,
    )


class SlowPlanner:
    """A planner that a fault can slow down, as on a slower computer."""

    def __init__(self, planner: Planner) -> None:
        self._planner = planner
        self._by_s = 0.0
        self._until_s = 0.0

    def slow_down(self, by_s: float, for_s: float) -> None:
        """Lengthen every plan by `by_s` for the next `for_s` seconds."""
        self._by_s, self._until_s = by_s, time.monotonic() + for_s

    def plan(self, request: PlanRequest) -> Plan:
        """Return the planner's plan, later if the UAV is slowed down."""
        plan = self._planner.plan(request)
        if self._by_s and time.monotonic() < self._until_s:
            time.sleep(self._by_s)
        return plan


@contextmanager
def _counted(tell: Callable[[int], None], begins: Callable[[], None]) -> Iterator[None]:
    """Call `tell` with the number of functions compiled so far, whenever one more is, and `begins` at the first one."""
    from numba.core import event  # noqa: PLC0415  (planners of users need no numba)

    numba_event: Any = event  # It has no types.

    class Counter(numba_event.Listener):  # type: ignore[misc]
        done = 0

        def on_start(self, _: object) -> None:
            begins()
            tell(self.done)

        def on_end(self, _: object) -> None:
            self.done += 1
            tell(self.done)

    listener = Counter()
    numba_event.register("numba:compile", listener)
    try:
        yield
    finally:
        numba_event.unregister("numba:compile", listener)
