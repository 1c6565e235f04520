"""Carry out the mission's faults on real processes, at their times."""

from __future__ import annotations

import heapq
import math
import signal
from collections.abc import Callable, Sequence
from functools import partial
from itertools import count
from typing import Protocol

from edc_swarm.emulation.links import mission_s
from edc_swarm.mission.configuration import NS_PER_S
from edc_swarm.mission.fault_handlers import FaultHandlers
from edc_swarm.mission.fault_targets import resolve
from edc_swarm.mission.faults import (
    ROUTER_OUTAGE_S,
    Fault,
    Freeze,
    GiveGoal,
    Kill,
    ProcessFault,
    Restart,
    Resume,
    parse_faults,
    read_fault,
)
from edc_swarm.mission.roles import RECORDER, ROUTER
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.messages import Event, MissionMessage
from processes.operator.bus_client import Operator

FAULT_DELAY_S = 0.05
"""Time from the event of a fault to the fault itself, where the fault would swallow messages on their way.

A router must have forwarded the event before it dies, and a process that freezes in the burst at a
slot's start would hold messages that it has counted but not sent.
"""

HEARD_SLOTS = 2
"""Slots after which an operator that takes over has heard a report, if there is a head."""

TOLD_OF_FAULTS = frozenset({EventKind.FAULT, EventKind.FAULT_WITHOUT_TARGET, EventKind.HOST_REQUEST})
"""Kinds of the events that an injector publishes: one for each fault, and one for each request to another host."""


class Processes(Protocol):
    """The operations of the launcher that the injector needs."""

    @property
    def bus(self) -> Operator:
        """The operator's side of the bus."""

    def signal(self, name: str, number: int) -> None:
        """Send a signal to a process."""

    def restart(self, name: str, *, lose_memory: bool) -> None:
        """Start a process again, after its death."""


def untold(faults: Sequence[Fault], mission: MissionMessage, told: Sequence[Event]) -> list[Fault]:
    """Return the faults that no event tells. An event names UAVs where a fault may name a role, such as the head."""
    left, roster = list(faults), {entry.uav for entry in mission.roster}
    for event in told:
        before = read_fault(event.detail, mission.dt_s)
        if before is None:
            continue
        of_nobody, names = before.without_names(), set(before.names)
        alike = [
            each for each in left if each.without_names() == of_nobody and roster.intersection(each.names) <= names
        ]
        if alike:
            left.remove(before if before in alike else alike[0])
    return left


class Injector:
    """A heap of actions by time, filled from the mission's `fault` list.

    An injector that takes over goes on after the events `told` by the operator before it. It carries out at once
    what is overdue: a fault that no event tells, and the end of a death or a freeze since the last event. A fault
    that would be over by now has no target any more, and one of a head waits for `HEARD_SLOTS` slots, until the
    operator has heard who leads. With None it does not know what was told, and takes every fault before now as
    carried out.
    """

    HANDLERS: FaultHandlers[Injector] = FaultHandlers()

    def __init__(self, mission: MissionMessage, processes: Processes, told: Sequence[Event] | None = ()) -> None:
        self._mission = mission
        self._processes = processes
        self._order = count()
        self._due: list[tuple[int, int, Callable[[], None]]] = []
        self._faults = parse_faults(mission)
        self._frozen_until_s: dict[str, float] = {}
        self._hears_until_s = self.now_s + HEARD_SLOTS * mission.dt_s if self.now_s > 0 else -math.inf
        until_s = max(map(self._told_s, told or ()), default=-math.inf)
        if told is None:
            to_come = [fault for fault in self._faults if fault.at_s > self.now_s]
        else:
            to_come = untold(self._faults, mission, told)
        for fault in to_come:
            self._at(fault.at_s, partial(self.inject if fault.end_s > self.now_s else self._leave_out, fault))
        for event in told or ():
            before = read_fault(event.detail, mission.dt_s) if event.kind == EventKind.FAULT else None
            if isinstance(before, Kill | Restart | Resume):
                self._frozen_until_s.pop(before.target, None)
            if isinstance(before, Kill | Freeze) and before.end_s > until_s:
                self._end_later(before)

    def next_in_s(self) -> float:
        """Return the real seconds until the next fault; infinite when there is none."""
        return (self._due[0][0] - self._now_ns()) / NS_PER_S if self._due else math.inf

    def _now_ns(self) -> int:
        return self._processes.bus.clock.now_ns()

    def will_restart(self, name: str) -> bool:
        """Return True if a fault still to come starts `name` again."""
        now_s = self.now_s
        kills_s = [fault.end_s for fault in self._faults if isinstance(fault, Kill) and fault.target == name]
        restarts_s = [fault.at_s for fault in self._faults if isinstance(fault, Restart) and fault.target == name]
        return any(now_s < at_s < math.inf for at_s in (*kills_s, *restarts_s))

    def inject_due(self) -> None:
        """Carry out every action that is due."""
        while self._due and self._due[0][0] <= self._now_ns():
            heapq.heappop(self._due)[2]()

    @property
    def now_s(self) -> float:
        """Mission time."""
        return mission_s(self._now_ns() - self._mission.epoch_ns, self._mission.time_scale)

    def _told_s(self, event: Event) -> float:
        return mission_s(event.sent_ns - self._mission.epoch_ns, self._mission.time_scale)

    def _at(self, mission_s: float, action: Callable[[], None]) -> None:
        when_ns = self._mission.epoch_ns + round(mission_s * NS_PER_S / self._mission.time_scale)
        heapq.heappush(self._due, (when_ns, next(self._order), action))

    def inject(self, fault: Fault) -> None:
        """Publish the event of a fault; carry it out here if it is about a process, the UAVs carry out the others."""
        bus = self._processes.bus
        assert bus.monitor is not None
        roster = [entry.uav for entry in self._mission.roster]
        concrete = resolve(fault, bus.monitor.head, bus.monitor.standbys, roster, bus.monitor.in_office)
        if concrete is None and self.now_s < self._hears_until_s:
            self._at(self._hears_until_s, partial(self.inject, fault))
            return
        if concrete is None or (isinstance(concrete, Restart) and concrete.target == RECORDER):
            self._leave_out(fault)
            return
        bus.publish_event(EventKind.FAULT, str(concrete))
        if not isinstance(concrete, ProcessFault):
            return
        act = partial(self.HANDLERS.carry_out, self, concrete)
        if isinstance(concrete, Freeze) or concrete.target == ROUTER:
            self._at(fault.at_s + FAULT_DELAY_S * self._mission.time_scale, act)
        else:
            act()

    def _leave_out(self, fault: Fault) -> None:
        self._processes.bus.publish_event(EventKind.FAULT_WITHOUT_TARGET, str(fault))

    def _end_later(self, fault: Kill | Freeze) -> None:
        """Start or thaw the process when the fault ends."""
        if isinstance(fault, Freeze):
            self._frozen_until_s[fault.target] = max(self._frozen_until_s.get(fault.target, 0.0), fault.end_s)
        if math.isfinite(fault.for_s):
            end = partial(self._start, fault.target) if isinstance(fault, Kill) else partial(self._thaw, fault)
            self._at(fault.end_s, end)

    @HANDLERS.of(Kill)
    def _kill(self, fault: Kill) -> None:
        self._frozen_until_s.pop(fault.target, None)
        self._processes.signal(fault.target, signal.SIGKILL)
        self._end_later(fault)

    @HANDLERS.of(Restart)
    def _restart(self, fault: Restart) -> None:
        if fault.target == ROUTER:
            self._processes.signal(ROUTER, signal.SIGKILL)
            self._at(fault.at_s + FAULT_DELAY_S + ROUTER_OUTAGE_S, partial(self._start, ROUTER))
        else:
            self._start(fault.target, lose_memory=fault.lose_memory)

    def _start(self, name: str, *, lose_memory: bool = False) -> None:
        self._frozen_until_s.pop(name, None)
        self._processes.restart(name, lose_memory=lose_memory)

    @HANDLERS.of(Freeze)
    def _freeze(self, fault: Freeze) -> None:
        self._processes.signal(fault.target, signal.SIGSTOP)
        self._end_later(fault)

    def _thaw(self, fault: Freeze) -> None:
        """End one freeze: go on unless another lasts."""
        if fault.end_s >= self._frozen_until_s.get(fault.target, math.inf):
            self._go_on(fault.target)

    @HANDLERS.of(GiveGoal)
    def _give_goal(self, fault: GiveGoal) -> None:
        self._processes.bus.give_goal(fault.target, list(fault.route))

    @HANDLERS.of(Resume)
    def _resume(self, fault: Resume) -> None:
        self._go_on(fault.target)

    def _go_on(self, name: str) -> None:
        self._frozen_until_s.pop(name, None)
        self._processes.signal(name, signal.SIGCONT)
