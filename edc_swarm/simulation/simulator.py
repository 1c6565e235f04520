"""A whole swarm in one process: virtual time, a seeded faulty network, the very same `UavNode`.

In the manner of deterministic simulation testing: production code, injected time, a fault
vocabulary (`edc_swarm.mission.faults`), and one seed that replays any run to the byte. What happens next is
decided by a heap ordered by (time, sequence) and by nothing else.

The simulator also sees what a recording cannot: every step that was accepted, also by a UAV that
died or froze before it could say so (`World.motions`).
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from itertools import count
from random import Random

import msgspec

from edc_swarm.agent.node import (
    Effect,
    GpsChanged,
    Land,
    Listen,
    NodeEvent,
    PeerGone,
    Persist,
    PlannerReady,
    Publish,
    Received,
    Tick,
    UavNode,
    WantPlanner,
)
from edc_swarm.agent.vehicle import LATE_FRACTION, Airframe, Promise, first_airframe, first_promise
from edc_swarm.emulation.links import LinkEmulator, cut_pair, have_range, mission_s
from edc_swarm.mission.configuration import NS_PER_S, OPERATOR, RECORDER, ROUTER
from edc_swarm.mission.faults import Fault, parse_faults, resolve
from edc_swarm.mission.prospect import COMPLETED, GIVEN_UP, NOBODY_LEFT, STALLED
from edc_swarm.planner.interface import Planner
from edc_swarm.protocol.completion import MissionMonitor
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.keys import Keys
from edc_swarm.protocol.messages import Command, Event, Fix, Message, MissionMessage, Report, Truth

TRANSIT_NS = 500_000
"""What the transport takes for a message when the link model adds nothing."""
HINT_NS = 3_000_000
"""From a process's end to its peers' notice that its liveliness token is gone."""
LEASE_NS = NS_PER_S
"""After this long a frozen process's session is closed by the router."""
ROUTER_OUTAGE_S = 1.0
"""A router that is restarted is away for this long."""
MAX_BACKLOG = 100_000
"""Messages kept for a frozen process."""


Recorder = Callable[[str, Message, int], None]
"""Takes the key, the message and the time at which it was published."""


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


@dataclass(slots=True)
class Computer:
    """One UAV's machine: its process (None when dead), its disk, its clock, its faults."""

    uav: str
    links: LinkEmulator
    promise: Promise | None
    airframe: Airframe
    node: UavNode | None = None
    lives: int = 0
    frozen: bool = False
    frozen_until_ns: int = 0
    backlog: list[NodeEvent] = field(default_factory=list)
    stopped_effects: list[Effect] = field(default_factory=list)
    stop_mid_step: Fault | None = None
    listening: bool = False
    busy_until_ns: int = 0
    slow_ms: float = 0.0
    slow_until_s: float = 0.0
    clock_base_ns: int = 0
    clock_ns: int = 0
    clock_rate: float = 1.0
    wake_ns: int = -1
    ended: bool = False

    def read_clock(self, now_ns: int) -> int:
        """What this computer's clock shows at true time `now_ns`."""
        elapsed_ns = now_ns - self.clock_base_ns
        return self.clock_ns + (elapsed_ns if self.clock_rate == 1.0 else round(elapsed_ns * self.clock_rate))

    def set_clock(self, now_ns: int, offset_ns: int, drift_ppm: float) -> None:
        """From now on the clock is `offset_ns` ahead and gains `drift_ppm`."""
        self.clock_base_ns, self.clock_ns = now_ns, now_ns + offset_ns
        self.clock_rate = 1.0 + drift_ppm * 1e-6

    def true_ns(self, clock_ns: int, now_ns: int) -> int:
        """True time at which the clock will show `clock_ns`."""
        return now_ns + max(0, round((clock_ns - self.read_clock(now_ns)) / self.clock_rate))


@dataclass(frozen=True, slots=True)
class SimulationEnd:
    """How a simulated mission ended, and why (a reason of `edc_swarm.mission.prospect`)."""

    completed: bool
    reason: str
    slots: int
    motions: list[Motion]


class Simulation:
    """One mission on a virtual clock.

    Parameters
    ----------
    mission
        As run: with roster, `tau_s` and `max_slots` filled in, `epoch_ns` set.
    make_planner
        Makes a planner for a UAV that may have to lead.
    record
        Called with every message published, in order.
    """

    def __init__(self, mission: MissionMessage, make_planner: Callable[[], Planner], record: Recorder) -> None:
        self.mission = mission
        self._make_planner = make_planner
        self._record = record
        self._keys = Keys(mission.name)
        self._roster = [entry.uav for entry in mission.roster]
        self._now_ns = mission.epoch_ns
        self._heap: list[tuple[int, int, Callable[[], None]]] = []
        self._order = count()
        self._operator_seq = 0
        self._random = Random(f"{mission.seed}/mid-step")
        self.monitor = MissionMonitor(mission)
        self.motions: list[Motion] = []
        self._router_up_at_ns = 0
        self._guard_ns = round(mission.guard_s * NS_PER_S / mission.time_scale)
        self._computers = {entry.uav: self._computer(index) for index, entry in enumerate(mission.roster)}
        self._faults = parse_faults(mission)
        self._have_range = have_range(mission)
        self._to_restart = [fault for fault in self._faults if fault.verb == "restart"]

    @property
    def slot(self) -> int:
        """The slot of true time."""
        return (self._now_ns - self.mission.epoch_ns) // self.mission.slot_ns

    def run(self) -> SimulationEnd:
        """Fly to the end: all there, nobody left, nothing that can change any more, or `max_slots` over."""
        for _ in self.slots():
            pass
        return self.end()

    def slots(self) -> Iterator[int]:
        """Fly, yielding each slot as it is over; ends with the mission."""
        self._begin()
        for slot in range(self.mission.max_slots):
            self._run_until(self.mission.epoch_ns + (slot + 1) * self.mission.slot_ns - 1)
            yield slot
            if self._reason(slot) != GIVEN_UP:
                break

    def end(self) -> SimulationEnd:
        """Close every publisher and tell how it went."""
        reason = self._reason(self.slot)
        for computer in self._computers.values():
            busy = computer.busy_until_ns > self._now_ns  # what it is about to say is numbered, but not said
            if computer.node is not None and not computer.frozen and not busy:
                self._close(computer, computer.node)
        self._publish_event(EventKind.END, reason)
        last = {self._keys.mission: 0, self._keys.event(OPERATOR): self._operator_seq}
        self._publish_event(EventKind.CLOSED, msgspec.json.encode(last).decode())
        self._heap.clear()  # What is left would tie this swarm, planners and all, into a cycle.
        return SimulationEnd(reason == COMPLETED, reason, self.slot + 1, self.motions)

    def _reason(self, slot: int) -> str:
        """Why the mission ends with `slot`: `GIVEN_UP` if it need not."""
        if self.monitor.complete(slot):
            return COMPLETED
        if all(computer.ended for computer in self._computers.values()):
            return NOBODY_LEFT
        return STALLED if self.monitor.stalled(slot) else GIVEN_UP

    # --- the mission's course ----------------------------------------------------------------

    def _begin(self) -> None:
        said = msgspec.structs.replace(self.mission, instance=OPERATOR, sent_ns=self._now_ns)
        self._record(self._keys.mission, said, self._now_ns)
        for computer in self._computers.values():
            self._start(computer)
        for fault in self._faults:
            self._at(self._ns_of(fault.at_s), partial(self._inject, fault))

    def _run_until(self, end_ns: int) -> None:
        while self._heap and self._heap[0][0] <= end_ns:
            self._now_ns, _, action = heapq.heappop(self._heap)
            action()
        self._now_ns = end_ns

    def _at(self, when_ns: int, action: Callable[[], None]) -> None:
        heapq.heappush(self._heap, (max(when_ns, self._now_ns), next(self._order), action))

    def _ns_of(self, at_s: float) -> int:
        return self.mission.epoch_ns + round(at_s * NS_PER_S / self.mission.time_scale)

    @property
    def _mission_s(self) -> float:
        return mission_s(self._now_ns - self.mission.epoch_ns, self.mission.time_scale)

    # --- processes ---------------------------------------------------------------------------

    def _computer(self, index: int) -> Computer:
        entry = self.mission.roster[index]
        computer = Computer(
            uav=entry.uav,
            links=LinkEmulator(self.mission, entry.uav),
            promise=first_promise(entry),
            airframe=first_airframe(entry),
        )
        computer.set_clock(self._now_ns, 0, 0.0)
        return computer

    def _start(self, computer: Computer) -> None:
        """Start a process from what is on its disk."""
        entry = self.mission.roster[self._roster.index(computer.uav)]
        computer.lives += 1
        computer.frozen, computer.listening, computer.busy_until_ns = False, False, 0
        computer.backlog, computer.stopped_effects, computer.stop_mid_step = [], [], None
        computer.wake_ns = -1
        computer.node = UavNode(
            self.mission,
            computer.uav,
            f"{computer.uav}-{computer.lives}",
            computer.promise,
            computer.airframe,
            response_ms=entry.compute_factor if self.mission.elect == "response-time" else 0.0,
        )
        self.monitor.revive(computer.uav)
        self._step(computer, Tick())

    def _kill(self, computer: Computer, fault: Fault) -> None:
        if computer.node is None:
            return
        computer.node = None
        computer.frozen, computer.backlog, computer.stopped_effects = False, [], []
        comes_back = any(f.at_s > self._mission_s and computer.uav in f.left for f in self._to_restart)
        if fault.for_s < float("inf"):
            again = Fault("restart", (computer.uav,))
            self._at(self._now_ns + self._ns_of(fault.for_s) - self.mission.epoch_ns, partial(self._do_restart, again))
        elif not comes_back:
            computer.ended = True
            self.monitor.end(computer.uav)
        self._at(self._now_ns + HINT_NS, partial(self._hint, computer, computer.lives))

    def _freeze(self, computer: Computer, fault: Fault) -> None:
        if computer.node is None:
            return
        until_ns = 1 << 62
        if fault.for_s < float("inf"):
            until_ns = self._now_ns + self._ns_of(fault.for_s) - self.mission.epoch_ns
            self._at(until_ns, partial(self._thaw, computer))
        if computer.frozen:
            computer.frozen_until_ns = max(computer.frozen_until_ns, until_ns)
            return
        computer.frozen, computer.frozen_until_ns = True, until_ns
        self._at(self._now_ns + LEASE_NS, partial(self._hint, computer, computer.lives))

    def _thaw(self, computer: Computer) -> None:
        """One freeze is over: go on unless another lasts."""
        if self._now_ns >= computer.frozen_until_ns:
            self._resume(computer)

    def _resume(self, computer: Computer) -> None:
        """Go on where it stopped: the rest of the broken-off step, then what has queued up."""
        if computer.node is None or not computer.frozen:
            return
        computer.frozen = False
        rest, computer.stopped_effects = computer.stopped_effects, []
        self._carry_out(computer, rest)
        backlog, computer.backlog = computer.backlog, []
        for event in [*backlog, Tick()]:
            self._step(computer, event)

    def _hint(self, gone: Computer, lives: int) -> None:
        """Tell the peers that the token of one life vanished, unless it was the router that did."""
        if gone.lives == lives and gone.node is not None and not gone.frozen and not gone.ended:
            return
        for computer in self._computers.values():
            if computer is not gone and self._router_up and not computer.links.is_cut(gone.uav, self._mission_s):
                self._step(computer, PeerGone(gone.uav))

    @property
    def _router_up(self) -> bool:
        return self._now_ns >= self._router_up_at_ns

    def _close(self, computer: Computer, node: UavNode) -> None:
        last = msgspec.json.encode(node.last_seqs).decode()
        self._carry_out(computer, [node.event(EventKind.CLOSED, last)])

    def _step(self, computer: Computer, event: NodeEvent) -> None:
        """Feed one event in, now or as soon as the process can take it."""
        if computer.node is None:
            return
        if computer.frozen:
            if len(computer.backlog) < MAX_BACKLOG:
                computer.backlog.append(event)
            return
        if self._now_ns < computer.busy_until_ns:
            self._at(computer.busy_until_ns, partial(self._step, computer, event))
            return
        effects = computer.node.step(event, computer.read_clock(self._now_ns))
        if computer.slow_ms and _planned(effects) and self._mission_s < computer.slow_until_s:
            computer.busy_until_ns = self._now_ns + round(computer.slow_ms * 1e6)
            self._at(computer.busy_until_ns, partial(self._carry_out_if, computer, computer.node, effects))
        else:
            self._carry_out(computer, effects)
        self._schedule_wakeup(computer)

    def _carry_out_if(self, computer: Computer, node: UavNode, effects: list[Effect]) -> None:
        if computer.node is not node:
            return
        if computer.frozen:
            computer.stopped_effects.extend(effects)
        else:
            self._carry_out(computer, effects)

    def _schedule_wakeup(self, computer: Computer) -> None:
        if computer.node is None or computer.frozen:
            return
        clock_ns = computer.read_clock(self._now_ns)
        wake_ns = computer.true_ns(computer.node.wakeup_ns(clock_ns), self._now_ns)
        wake_ns = max(wake_ns, computer.busy_until_ns)
        if wake_ns != computer.wake_ns or wake_ns == self._now_ns:
            computer.wake_ns = wake_ns
            self._at(wake_ns, partial(self._wake, computer, wake_ns))

    def _wake(self, computer: Computer, wake_ns: int) -> None:
        if computer.wake_ns == wake_ns:
            computer.wake_ns = -1
            self._step(computer, Tick())

    # --- effects -----------------------------------------------------------------------------

    def _carry_out(self, computer: Computer, effects: list[Effect]) -> None:
        if computer.stop_mid_step is not None and len(effects) > 1:
            self._break_off(computer, computer.stop_mid_step, effects)
            return
        for effect in effects:
            self._carry_out_one(computer, effect)

    def _break_off(self, computer: Computer, fault: Fault, effects: list[Effect]) -> None:
        """Die or freeze between two effects of one step, drawn at random."""
        computer.stop_mid_step = None
        after = self._random.randrange(1, len(effects))
        self._carry_out(computer, effects[:after])
        rest = effects[after:]
        if fault.verb == "kill":
            self._kill(computer, fault)
        else:
            computer.stopped_effects = rest
            self._freeze(computer, fault)

    def _carry_out_one(self, computer: Computer, effect: Effect) -> None:
        match effect:
            case Publish(message):
                self._publish(computer, message)
            case Persist(promise, airframe):
                self._persist(computer, promise, airframe)
            case Listen(all_fixes):
                computer.listening = all_fixes
            case WantPlanner():
                planner = self._make_planner()
                self._at(self._now_ns, partial(self._step, computer, PlannerReady(planner)))
            case Land():
                computer.ended = True
                self.monitor.end(computer.uav)
                self._at(self._now_ns + HINT_NS, partial(self._hint, computer, computer.lives))

    def _persist(self, computer: Computer, promise: Promise | None, airframe: Airframe) -> None:
        """The write is the acceptance of a step: from here on it is flown, whatever happens."""
        before = computer.airframe
        if (before.x_m, before.y_m) != (airframe.x_m, airframe.y_m):
            slot = promise.slot if promise is not None else self.slot
            begun_ns = self.mission.epoch_ns + slot * self.mission.slot_ns
            late = self._now_ns - begun_ns > LATE_FRACTION * self.mission.slot_ns + self._guard_ns
            here_m, there_m = (before.x_m, before.y_m), (airframe.x_m, airframe.y_m)
            self.motions.append(Motion(slot, computer.uav, here_m, there_m, late))
        computer.promise, computer.airframe = promise, airframe

    def _publish(self, computer: Computer, message: Message) -> None:
        message = msgspec.structs.replace(message, sent_ns=computer.read_clock(self._now_ns))
        self._record(self._keys.of(message), message, self._now_ns)
        match message:
            case Fix():
                self.monitor.hear_fix(message)
                self._send(computer.uav, message, [c for c in self._computers.values() if c.listening])
            case Command():
                self.monitor.hear_command(message)
                self._send(computer.uav, message, [self._computers[message.uav]])
            case Report():
                self.monitor.hear_report(message)
                self._send(computer.uav, message, list(self._computers.values()))
            case Truth() if self._have_range:
                for other in self._computers.values():
                    other.links.place(message.uav, message.to_x_m, message.to_y_m)
            case _:
                pass

    def _send(self, sender: str, message: Message, receivers: list[Computer]) -> None:
        if not self._router_up:
            return
        event, at_s = Received(message), self._mission_s
        for receiver in receivers:
            if receiver.uav == sender or receiver.node is None:
                continue
            for delay_ns in receiver.links.arrivals_ns(sender, at_s):
                when_ns = self._now_ns + TRANSIT_NS + delay_ns
                self._at(when_ns, partial(self._step, receiver, event))

    # --- faults ------------------------------------------------------------------------------

    def _inject(self, fault: Fault) -> None:
        concrete = resolve(fault, self.monitor.head, self.monitor.standbys, self._roster)
        if concrete is None or RECORDER in concrete.left:
            self._publish_event(EventKind.FAULT_WITHOUT_TARGET, str(fault))
            return
        self._publish_event(EventKind.FAULT, str(concrete))
        getattr(self, f"_do_{concrete.verb}")(concrete)

    def _publish_event(self, kind: EventKind, detail: str) -> None:
        event = Event(
            source=OPERATOR,
            instance=OPERATOR,
            seq=self._operator_seq,
            sent_ns=self._now_ns,
            slot=self.slot,
            kind=kind,
            detail=detail,
        )
        self._operator_seq += 1
        self._record(self._keys.of(event), event, self._now_ns)

    def _do_kill(self, fault: Fault) -> None:
        computer = self._computers.get(fault.target)
        if computer is not None and "mid-step" in fault.flags and not computer.frozen:
            computer.stop_mid_step = fault
        elif computer is not None:
            self._kill(computer, fault)
        elif fault.target == ROUTER:
            self._router_up_at_ns = self._ns_of(fault.end_s) if fault.for_s < float("inf") else 1 << 62

    def _do_restart(self, fault: Fault) -> None:
        computer = self._computers.get(fault.target)
        if computer is None:
            if fault.target == ROUTER:
                self._router_up_at_ns = self._now_ns + self._ns_of(ROUTER_OUTAGE_S) - self.mission.epoch_ns
            return
        if computer.ended and computer.node is not None:
            return
        self._kill(computer, fault)
        computer.ended = False
        if "lose-memory" in fault.flags:
            computer.promise = None
        self._start(computer)

    def _do_freeze(self, fault: Fault) -> None:
        computer = self._computers.get(fault.target)
        if computer is None:
            self._do_kill(fault)
        elif "mid-step" in fault.flags and not computer.frozen:
            computer.stop_mid_step = fault
        else:
            self._freeze(computer, fault)

    def _do_resume(self, fault: Fault) -> None:
        if (computer := self._computers.get(fault.target)) is not None:
            self._resume(computer)
        elif fault.target == ROUTER:
            self._router_up_at_ns = self._now_ns

    def _do_partition(self, fault: Fault) -> None:
        cuts = cut_pair(
            fault.left, fault.right, self._mission_s, self._mission_s + fault.for_s, "one-way" in fault.flags
        )
        for computer in self._computers.values():
            for cut in cuts:
                computer.links.add_cut(cut)

    def _do_heal(self, fault: Fault) -> None:
        del fault
        for computer in self._computers.values():
            computer.links.heal()

    def _do_link(self, fault: Fault) -> None:
        for computer in self._computers.values():
            computer.links.add_rule(fault.link())

    def _do_clock(self, fault: Fault) -> None:
        if (computer := self._computers.get(fault.target)) is not None:
            offset_ns = round(fault.number("offset_ms") * 1e6)
            computer.set_clock(self._now_ns, offset_ns, fault.number("drift_ppm"))
            self._step(computer, Tick())

    def _do_gps(self, fault: Fault) -> None:
        if (computer := self._computers.get(fault.target)) is not None:
            self._step(computer, GpsChanged(fault.flags[0]))  # type: ignore[arg-type]

    def _do_slow(self, fault: Fault) -> None:
        if (computer := self._computers.get(fault.target)) is not None:
            computer.slow_ms, computer.slow_until_s = fault.number("by_ms"), fault.end_s


def _planned(effects: list[Effect]) -> bool:
    return any(isinstance(e, Publish) and isinstance(e.message, Report) and e.message.has_quorum for e in effects)
