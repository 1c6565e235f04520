"""Carries out the mission's faults on real processes, at their times."""

from __future__ import annotations

import heapq
import math
import signal
from collections.abc import Callable
from functools import partial
from itertools import count
from typing import Protocol

from edc_swarm.emulation.links import mission_s
from edc_swarm.mission.configuration import NS_PER_S, RECORDER, ROUTER
from edc_swarm.mission.faults import PROCESS_VERBS, Fault, parse_faults, resolve
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.messages import MissionMessage
from processes.operator.bus_client import Operator

ROUTER_OUTAGE_S = 1.0
"""A router that is restarted is away for this long."""
SETTLE_S = 0.05
"""From the event that tells of it to a fault that would swallow messages on their way.

A router must have handed the event on before it dies, and a process that froze in the burst at a
slot's start would hold messages that it has counted but not sent.
"""


class Processes(Protocol):
    """What the injector needs of the launcher."""

    @property
    def bus(self) -> Operator:
        """The operator's side of the bus."""

    def signal(self, name: str, number: int) -> None:
        """Send a signal to a process."""

    def restart(self, name: str, *, lose_memory: bool) -> None:
        """Start a process again, after its death."""


class Injector:
    """A heap of what is to be done when, filled from the mission's `fault` list.

    Faults before `from_s` of the mission are not injected: an operator before this one did.
    """

    def __init__(self, mission: MissionMessage, processes: Processes, from_s: float = 0.0) -> None:
        self._mission = mission
        self._processes = processes
        self._order = count()
        self._due: list[tuple[int, int, Callable[[], None]]] = []
        self._faults = parse_faults(mission)
        self._frozen_until_s: dict[str, float] = {}
        for fault in (fault for fault in self._faults if fault.at_s >= from_s):
            self._at(fault.at_s, partial(self._inject, fault))

    def next_in_s(self) -> float:
        """Real seconds until the next fault; infinite when there is none."""
        return (self._due[0][0] - self._now_ns()) / NS_PER_S if self._due else math.inf

    def _now_ns(self) -> int:
        return self._processes.bus.clock.now_ns()

    def will_restart(self, name: str) -> bool:
        """Whether a fault still to come starts `name` again."""
        now_s = mission_s(self._now_ns() - self._mission.epoch_ns, self._mission.time_scale)
        restarts = (fault.at_s if fault.verb == "restart" else fault.end_s for fault in self._faults_about(name))
        return any(now_s < at_s < math.inf for at_s in restarts)

    def _faults_about(self, name: str) -> list[Fault]:
        return [fault for fault in self._faults if fault.verb in {"kill", "restart"} and name in fault.left]

    def inject_due(self) -> None:
        """Do all that is due."""
        while self._due and self._due[0][0] <= self._now_ns():
            heapq.heappop(self._due)[2]()

    def _at(self, mission_s: float, action: Callable[[], None]) -> None:
        when_ns = self._mission.epoch_ns + round(mission_s * NS_PER_S / self._mission.time_scale)
        heapq.heappush(self._due, (when_ns, next(self._order), action))

    def _inject(self, fault: Fault) -> None:
        bus = self._processes.bus
        assert bus.monitor is not None
        roster = [entry.uav for entry in self._mission.roster]
        concrete = resolve(fault, bus.monitor.head, bus.monitor.standbys, roster)
        if concrete is None or (concrete.verb == "restart" and concrete.target == RECORDER):
            bus.publish_event(EventKind.FAULT_WITHOUT_TARGET, str(fault))
            return
        bus.publish_event(EventKind.FAULT, str(concrete))
        if concrete.verb == "freeze" or concrete.target == ROUTER:
            self._at(fault.at_s + SETTLE_S * self._mission.time_scale, partial(self._act, concrete))
        elif concrete.verb in PROCESS_VERBS:
            self._act(concrete)

    def _act(self, fault: Fault) -> None:
        getattr(self, f"_{fault.verb}")(fault)

    def _kill(self, fault: Fault) -> None:
        self._frozen_until_s.pop(fault.target, None)
        self._processes.signal(fault.target, signal.SIGKILL)
        if math.isfinite(fault.for_s):
            self._at(fault.end_s, partial(self._restart, fault))

    def _restart(self, fault: Fault) -> None:
        if fault.target == ROUTER and fault.verb == "restart":
            self._processes.signal(ROUTER, signal.SIGKILL)
            self._at(fault.at_s + SETTLE_S + ROUTER_OUTAGE_S, partial(self._restart, Fault("kill", (ROUTER,))))
        else:
            self._frozen_until_s.pop(fault.target, None)
            self._processes.restart(fault.target, lose_memory="lose-memory" in fault.flags)

    def _freeze(self, fault: Fault) -> None:
        self._processes.signal(fault.target, signal.SIGSTOP)
        self._frozen_until_s[fault.target] = max(self._frozen_until_s.get(fault.target, 0.0), fault.end_s)
        if math.isfinite(fault.for_s):
            self._at(fault.end_s, partial(self._thaw, fault))

    def _thaw(self, fault: Fault) -> None:
        """One freeze is over: go on unless another lasts."""
        if fault.end_s >= self._frozen_until_s.get(fault.target, math.inf):
            self._resume(fault)

    def _resume(self, fault: Fault) -> None:
        self._frozen_until_s.pop(fault.target, None)
        self._processes.signal(fault.target, signal.SIGCONT)
