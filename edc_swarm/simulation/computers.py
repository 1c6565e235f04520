"""The simulated computers: each has a disk, a clock, links, and a process that lives, freezes and dies.

A computer feeds the events of virtual time to its `UavNode` and carries out the effects, as `processes.uav.process`
does with real ones.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from random import Random

import msgspec

from edc_swarm.agent.mission_tables import MissionTables
from edc_swarm.agent.node import (
    Effect,
    Land,
    Listen,
    NodeEvent,
    Persist,
    PlannerReady,
    Publish,
    Tick,
    UavNode,
    WantPlanner,
)
from edc_swarm.agent.vehicle import Airframe, Promise, comes_too_late, first_airframe, first_promise
from edc_swarm.emulation.links import NS_PER_MS, LinkEmulator
from edc_swarm.mission.braking import change_of
from edc_swarm.mission.failsafe import LATE_FRACTION
from edc_swarm.mission.faults import Freeze, Kill, SlowSolver
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.planner.interface import Planner
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.keys import SESSION_LEASE_MS
from edc_swarm.protocol.messages import MissionMessage, Report
from edc_swarm.simulation.network import Network
from edc_swarm.simulation.schedule import Schedule

HINT_NS = 3_000_000
"""Time from a process's end to its peers' notice that its liveliness token is gone."""
MAX_BACKLOG = 100_000
"""Messages that are kept for a frozen process."""
FOREVER_NS = 1 << 62


@dataclass(frozen=True, slots=True)
class Motion:
    """A step that was accepted: `uav` flies the segment at some pace within slot `slot`.

    `late` is set when it was accepted so late that it cannot be over when the slot is.
    """

    slot: int
    uav: str
    from_m: tuple[float, float]
    to_m: tuple[float, float]
    late: bool = False


@dataclass(frozen=True)
class World:
    """The parts of a simulation that all its computers share.

    Attributes
    ----------
    random
        Draws the effect after which a `mid-step` fault stops a process.
    restarts_s
        Mission times at which the mission restarts each process.
    motions
        Every step that was accepted, in order.
    """

    mission: MissionMessage
    schedule: Schedule
    network: Network
    make_planner: Callable[[], Planner]
    random: Random
    restarts_s: Mapping[str, Sequence[float]]
    motions: list[Motion] = field(default_factory=list)

    @cached_property
    def tables(self) -> MissionTables[MissionMessage]:
        """Tables that all nodes share."""
        return MissionTables(self.mission)


@dataclass(slots=True)
class Clock:
    """A computer's clock, which may be ahead and may drift."""

    base_ns: int
    shown_ns: int
    rate: float = 1.0

    def read(self, now_ns: int) -> int:
        """Return the time that the clock shows at true time `now_ns`."""
        elapsed_ns = now_ns - self.base_ns
        return self.shown_ns + (elapsed_ns if self.rate == 1.0 else round(elapsed_ns * self.rate))

    def true_ns(self, clock_ns: int, now_ns: int) -> int:
        """Return the true time at which the clock will show `clock_ns`."""
        return now_ns + max(0, round((clock_ns - self.read(now_ns)) / self.rate))


@dataclass(slots=True)
class Process:
    """One life of a UAV's process.

    Attributes
    ----------
    backlog
        Events that wait until a frozen process goes on.
    stopped_effects
        Effects of a step that a freeze has broken off.
    stop_mid_step
        The fault that stops the process within its next step of several effects.
    busy_until_ns
        Time until which a slowed solver plans.
    plan_effects
        Effects of that plan, which the process carries out when it is ready.
    wake_ns
        Time of the wake-up that is scheduled, -1 for none.
    """

    node: UavNode
    frozen: bool = False
    frozen_until_ns: int = 0
    backlog: list[NodeEvent] = field(default_factory=list)
    stopped_effects: list[Effect] = field(default_factory=list)
    stop_mid_step: Kill | Freeze | None = None
    busy_until_ns: int = 0
    plan_effects: list[Effect] = field(default_factory=list)
    wake_ns: int = -1


class Disk:
    """A computer's files: the promise (None once it is lost) and the airframe."""

    def __init__(self, entry: RosterEntry, world: World) -> None:
        self._uav = entry.uav
        self._world = world
        self._stops_at_once = math.isinf(change_of(world.mission, entry))
        self.promise: Promise | None = first_promise(entry)
        self.airframe = first_airframe(entry)

    def write(self, promise: Promise | None, airframe: Airframe) -> None:
        """Write both files: the write accepts a step, which is flown from here on, whatever happens."""
        before, mission, schedule = self.airframe, self._world.mission, self._world.schedule
        # A braking step is no accepted step: it follows from the last one.
        brakes = not self._stops_at_once and before.stepped_slot == airframe.stepped_slot
        if not brakes and (before.x_m, before.y_m) != (airframe.x_m, airframe.y_m):
            slot = promise.slot if promise is not None else schedule.slot
            begun_ns = mission.epoch_ns + slot * mission.slot_ns
            late = schedule.now_ns - begun_ns > LATE_FRACTION * mission.slot_ns + schedule.duration_ns(mission.guard_s)
            here_m, there_m = (before.x_m, before.y_m), (airframe.x_m, airframe.y_m)
            if airframe.from_x_m is not None and airframe.from_y_m is not None:
                here_m = (airframe.from_x_m, airframe.from_y_m)
            self._world.motions.append(Motion(slot, self._uav, here_m, there_m, late))
        self.promise, self.airframe = promise, airframe


class Computer:
    """One UAV's machine.

    Attributes
    ----------
    disk
        Promise and airframe, which outlive the process.
    slow
        The fault that slows its solver, None if none does.
    process
        The process that runs, None if it is dead.
    subscribes_to_fixes
        True if its process receives every fix.
    ended
        True if the UAV flies no more: its battery is empty, or it died and nothing starts it again.
    """

    def __init__(self, entry: RosterEntry, world: World) -> None:
        self._entry = entry
        self._world = world
        self._schedule = world.schedule
        self._lives = 0
        self.uav = entry.uav
        self.links = LinkEmulator(world.mission, entry.uav)
        self.disk = Disk(entry, world)
        self.clock = Clock(world.schedule.now_ns, world.schedule.now_ns)
        self.slow: SlowSolver | None = None
        self.process: Process | None = None
        self.subscribes_to_fixes = False
        self.ended = False

    # --- life of the process -----------------------------------------------------------------

    def start(self) -> None:
        """Start a process from what is on the disk."""
        mission = self._world.mission
        self._lives += 1
        self.subscribes_to_fixes = False
        self._world.network.listen(self, frozenset())
        self.process = Process(
            UavNode(
                mission,
                self.uav,
                f"{self.uav}-{self._lives}",
                self.disk.promise,
                self.disk.airframe,
                response_ms=self._entry.compute_factor if mission.elect == "response-time" else 0.0,
                tables=self._world.tables,
            )
        )
        self._world.network.monitor.revive(self.uav)
        self._carry_out(self.process, self.process.node.wishes())
        self._schedule.at(self._schedule.now_ns, partial(self.step, Tick()))

    def kill(self, for_s: float = math.inf) -> None:
        """End the process, and start one again after `for_s` seconds of mission time."""
        if self.process is None:
            return
        self.process = None
        if math.isfinite(for_s):
            self._schedule.at(self._schedule.now_ns + self._schedule.duration_ns(for_s), self.restart)
        elif not any(at_s > self._schedule.mission_s for at_s in self._world.restarts_s.get(self.uav, ())):
            self.ended = True
            self._world.network.monitor.end(self.uav)
        self._announce_end_after(HINT_NS)

    def restart(self, *, lose_memory: bool = False) -> None:
        """Start a process anew, unless the battery is empty."""
        if self.ended and self.process is not None:
            return
        self.kill()
        self.ended = False
        if lose_memory:
            self.disk.promise = None
        self.start()

    def freeze(self, for_s: float = math.inf) -> None:
        """Stop the process for `for_s` seconds of mission time; of several freezes the longest counts."""
        if self.process is None:
            return
        until_ns = FOREVER_NS
        if math.isfinite(for_s):
            until_ns = self._schedule.now_ns + self._schedule.duration_ns(for_s)
            self._schedule.at(until_ns, self._thaw)
        if self.process.frozen:
            self.process.frozen_until_ns = max(self.process.frozen_until_ns, until_ns)
            return
        self.process.frozen, self.process.frozen_until_ns = True, until_ns
        self._announce_end_after(SESSION_LEASE_MS * NS_PER_MS)

    def _thaw(self) -> None:
        """End one freeze: go on unless another lasts."""
        if self.process is not None and self._schedule.now_ns >= self.process.frozen_until_ns:
            self.resume()

    def resume(self) -> None:
        """Go on after a freeze: with the rest of the step that it broke off, then with the backlog."""
        process = self.process
        if process is None or not process.frozen:
            return
        process.frozen = False
        rest, process.stopped_effects = process.stopped_effects, []
        self._carry_out(process, rest)
        backlog, process.backlog = process.backlog, []
        for event in [*backlog, Tick()]:
            self.step(event)

    def close(self) -> None:
        """Publish a plan that is not ready yet, then what its links did and the last sequence numbers, if it can.

        A dead or frozen process does neither.

        A real process that is told to end in the middle of a plan finishes that plan first, too.
        """
        if self.process is not None:
            self._carry_out_plan(self.process)
        process = self.process
        if process is not None and not process.frozen:
            if self.links.has_rules:
                told = msgspec.json.encode(self.links.log.told()).decode()
                self._carry_out(process, [process.node.event(EventKind.LINK_DELAYS, told)])
            last = msgspec.json.encode(process.node.last_seqs).decode()
            self._carry_out(process, [process.node.event(EventKind.CLOSED, last)])

    def _announce_end_after(self, after_ns: int) -> None:
        self._schedule.at(self._schedule.now_ns + after_ns, partial(self._announce_end, self._lives))

    def _announce_end(self, life: int) -> None:
        """Announce that the token of one life has vanished, if that life is over, frozen or has ended its flight."""
        if self._lives == life and self.process is not None and not self.process.frozen and not self.ended:
            return
        self._world.network.announce_end(self)

    # --- steps and effects -------------------------------------------------------------------

    def step(self, event: NodeEvent) -> None:
        """Feed one event to the process, now or as soon as it can take it."""
        process, now_ns = self.process, self._schedule.now_ns
        if process is None:
            return
        if process.frozen:
            if len(process.backlog) < MAX_BACKLOG:
                process.backlog.append(event)
            return
        if now_ns < process.busy_until_ns:
            self._schedule.at(process.busy_until_ns, partial(self.step, event))
            return
        effects = process.node.step(event, self.clock.read(now_ns))
        slow = self.slow
        if slow is not None and slow.by_ms and _planned(effects) and self._schedule.mission_s < slow.end_s:
            process.busy_until_ns = now_ns + round(slow.by_ms * 1e6)
            process.plan_effects = effects
            self._schedule.at(process.busy_until_ns, partial(self._carry_out_plan, process))
        else:
            self._carry_out(process, effects)
        self._schedule_wakeup()

    def _carry_out_plan(self, process: Process) -> None:
        """Carry out the effects of a plan that took long, if its process is still the one that runs."""
        if self.process is not process:
            return
        effects, process.plan_effects = process.plan_effects, []
        if process.frozen:
            process.stopped_effects.extend(effects)
        else:
            self._carry_out(process, effects)

    def _schedule_wakeup(self) -> None:
        process, now_ns = self.process, self._schedule.now_ns
        if process is None or process.frozen:
            return
        wake_ns = self.clock.true_ns(process.node.wakeup_ns(self.clock.read(now_ns)), now_ns)
        wake_ns = max(wake_ns, process.busy_until_ns)
        if wake_ns != process.wake_ns or wake_ns == now_ns:
            process.wake_ns = wake_ns
            self._schedule.at(wake_ns, partial(self._wake, wake_ns))

    def _wake(self, wake_ns: int) -> None:
        if self.process is not None and self.process.wake_ns == wake_ns:
            self.process.wake_ns = -1
            self.step(Tick())

    def _carry_out(self, process: Process, effects: list[Effect]) -> None:
        if process.stop_mid_step is not None and len(effects) > 1:
            self._break_off(process, process.stop_mid_step, effects)
            return
        for done, effect in enumerate(effects):
            if isinstance(effect, Persist) and self._comes_too_late(effect):
                self._carry_out(process, process.node.ground(effects[done:]))
                return
            self._carry_out_one(effect)

    def _comes_too_late(self, effect: Persist) -> bool:
        now_ns = self.clock.read(self._schedule.now_ns)
        return comes_too_late(effect.airframe, self.disk.airframe, self._world.mission, now_ns)

    def _break_off(self, process: Process, fault: Kill | Freeze, effects: list[Effect]) -> None:
        """Die or freeze between two effects of one step, drawn at random."""
        process.stop_mid_step = None
        after = self._world.random.randrange(1, len(effects))
        self._carry_out(process, effects[:after])
        if isinstance(fault, Kill):
            self.kill(fault.for_s)
        else:
            process.stopped_effects = effects[after:]
            self.freeze(fault.for_s)

    def _carry_out_one(self, effect: Effect) -> None:
        match effect:
            case Publish(message):
                sent_ns = self.clock.read(self._schedule.now_ns)
                self._world.network.publish(self.uav, msgspec.structs.replace(message, sent_ns=sent_ns))
            case Persist(promise, airframe):
                self.disk.write(promise, airframe)
            case Listen(all_fixes, near):
                self.subscribes_to_fixes = all_fixes
                self._world.network.listen(self, near)
            case WantPlanner():
                planner = self._world.make_planner()
                self._schedule.at(self._schedule.now_ns, partial(self.step, PlannerReady(planner)))
            case Land():
                self.ended = True
                self._world.network.monitor.end(self.uav)
                self._announce_end_after(HINT_NS)


def _planned(effects: list[Effect]) -> bool:
    return any(isinstance(e, Publish) and isinstance(e.message, Report) and e.message.has_quorum for e in effects)
