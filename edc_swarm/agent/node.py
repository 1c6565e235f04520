"""One UAV as a value: `UavNode.step(event, now_ns) -> effects`.

The same class flies in a real process (`processes.uav.process`) and in the simulator
(`edc_swarm.simulation.simulator`). It reads no clock, opens no file and blocks on nothing but the planner.
The shell carries out the effects in the order of the list; every `Persist` stands before the effects that
depend on it, so the write *is* the acceptance of a step.

A slot, from inside (the rules are named in ARCHITECTURE.md):

1. the slot begins: the UAV flies the pending command if it is valid, else it holds; it persists slot, grant
   and waypoint; it publishes truth and fix;
2. a head collects fixes until all are in, or until `tau_s` (later if the quorum is late); it plans the
   next slot once, publishes a command to each UAV heard, then the report;
3. a message may change the grant or the suspicion: the UAV then persists its promise and retransmits its fix
   within the slot. A UAV that expected a command for this slot and has none retransmits its fix once too, half of
   `tau_s` into the slot: its last fix may be lost, and a head without a quorum of fixes cannot plan.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import msgspec

from edc_swarm.agent.election import Election
from edc_swarm.agent.head import Head
from edc_swarm.agent.knowledge import Grant, Knowledge
from edc_swarm.agent.vehicle import LATE_FRACTION, Airframe, Promise, Situation, Vehicle, refusal
from edc_swarm.emulation.energy import compute_energy_j
from edc_swarm.geodesy import to_wgs84
from edc_swarm.mission.configuration import GpsModel, Mission
from edc_swarm.planner.interface import Planner
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.keys import Keys
from edc_swarm.protocol.messages import Command, Event, Fix, Message, MissionMessage, Report, Truth

MAX_PENDING = 4
"""Most commands that a UAV keeps for later slots."""


CLAIM_WAIT_FRACTION = 0.1
"""Fraction of a slot for which a new head waits for retransmitted fixes."""


@dataclass(frozen=True, slots=True)
class Tick:
    """Passage of time: the node reads `now_ns`."""


@dataclass(frozen=True, slots=True)
class Received:
    """A decoded message from the bus."""

    message: Message


@dataclass(frozen=True, slots=True)
class PeerGone:
    """Loss of a UAV's liveliness token while the own link to the router was up."""

    uav: str


@dataclass(frozen=True, slots=True)
class PlannerReady:
    """The planner that the node wanted, loaded and warm."""

    planner: Planner


@dataclass(frozen=True, slots=True)
class GpsChanged:
    """A fault that replaces the GPS error model."""

    model: GpsModel


NodeEvent = Tick | Received | PeerGone | PlannerReady | GpsChanged


@dataclass(frozen=True, slots=True)
class Persist:
    """Write the promise and the emulated body before the next effect."""

    promise: Promise | None
    airframe: Airframe


@dataclass(frozen=True, slots=True)
class Publish:
    """Publish a message on the bus; the shell sets `sent_ns` from its clock."""

    message: Message


@dataclass(frozen=True, slots=True)
class Listen:
    """Subscribe to all fixes, or unsubscribe."""

    all_fixes: bool


@dataclass(frozen=True, slots=True)
class WantPlanner:
    """Load the planner and return it with `PlannerReady`: this UAV may have to lead."""


@dataclass(frozen=True, slots=True)
class Stop:
    """End of this UAV: it stays at its waypoint as an obstacle."""


Effect = Persist | Publish | Listen | WantPlanner | Stop

M = TypeVar("M", bound=Message)


def startup_candidates(mission: Mission) -> set[str]:
    """Return the UAVs that may lead first: the best by energy, or all if the criterion is the response time."""
    if mission.elect == "response-time":
        return {entry.uav for entry in mission.roster}
    ranked = sorted(mission.roster, key=lambda entry: -entry.energy_j)
    return {entry.uav for entry in ranked[: 1 + mission.standbys]}


class UavNode:
    """One UAV as a state machine; `step` is its only input.

    Parameters
    ----------
    mission
        The mission as run, with roster and epoch.
    uav
        The own id, one of the roster.
    instance
        Name of this run of the process; sequence numbers count per instance.
    promise
        The promise on disk, or None if it is lost: such a UAV never grants in this mission.
    airframe
        The emulated body, as last persisted.
    response_ms
        Measured time to solve the reference slot QP, 0 if it was not measured.
    cpu_s
        Function that returns the processor time used so far, for the fix.
    """

    def __init__(
        self,
        mission: MissionMessage,
        uav: str,
        instance: str,
        promise: Promise | None,
        airframe: Airframe,
        *,
        response_ms: float = 0.0,
        cpu_s: Callable[[], float] = lambda: 0.0,
    ) -> None:
        self._mission = mission
        self._roster = frozenset(entry.uav for entry in mission.roster)
        self._epoch_ns, self._slot_ns = mission.epoch_ns, mission.slot_ns
        self._tau_ns = round(mission.tau_s * 1e9 / mission.time_scale)
        self._keys = Keys(mission.name)
        self.uav = uav
        self._instance = instance
        self._voter = promise is not None
        entry = next(entry for entry in mission.roster if entry.uav == uav)
        self._vehicle = Vehicle(mission, entry, promise, airframe)
        grant: Grant = promise.grant if promise is not None else (0, "")
        self.slot = promise.slot if promise is not None else -1
        self._knowledge = Knowledge(mission.roster)
        self._election = Election(mission, uav, grant, self._voter, self._knowledge)
        self._head = Head(mission, uav, grant[0], self._knowledge)
        self._planner: Planner | None = None
        self._response_ms = response_ms
        self._cpu_s = cpu_s
        self._pending: dict[int, Command] = {}
        self._own: Command | None = None
        self._flown: Command | None = None
        self._gone: set[str] = set()
        self._said: tuple[Grant, bool] | None = None
        self._listening: bool | None = None
        self._planner_wanted = False
        self._candidate = grant[0] == 0 and uav in startup_candidates(mission)
        self._office_ns = 0
        self._again_ns: int | None = None
        self._held_slots = 0
        self._late_ticks = 0
        self._clock_reported: set[str] = set()
        self._problem = ""
        self._seq: dict[str, int] = {}
        self.ended = False
        self._out: list[Effect] = []

    @property
    def grant(self) -> Grant:
        """(term, head) that this UAV grants."""
        return self._election.grant

    @property
    def leads(self) -> bool:
        """True if this UAV grants itself."""
        return self._election.leads

    @property
    def last_seqs(self) -> dict[str, int]:
        """Last sequence number on each key of this UAV, for the `closed` event."""
        return dict(self._seq)

    def wakeup_ns(self, now_ns: int) -> int:
        """Return the time of the next `Tick`, in nanoseconds of the clock of `step`."""
        if self._own is not None or self._plan_due(now_ns):
            return now_ns
        due_ns = [self._start_ns(self._slot_at(now_ns) + 1)]
        if self._again_ns is not None:
            due_ns.append(max(self._again_ns, now_ns))
        if self._collecting() and now_ns < self._deadline_ns():
            due_ns.append(self._deadline_ns())
        return min(due_ns)

    def step(self, event: NodeEvent, now_ns: int) -> list[Effect]:
        """Process one event at `now_ns` (wall nanoseconds of the own clock) and return the effects in order.

        The node begins a due slot before it processes the event. So a message counts for a slot only if the node
        processes it before that slot begins, even after a freeze. Planning takes a step of its own, a `Tick` in
        which nothing else is due, so that no fix waits for a plan.
        """
        if self.ended:
            return []
        self._take_own_command(now_ns)
        began = self._begin_slots(now_ns)
        match event:
            case Received(message):
                self._receive(message, now_ns)
            case PeerGone(uav) if uav in self._roster:
                self._gone.add(uav)
                self._election.peer_gone(uav)
            case PlannerReady(planner):
                self._planner = planner
            case GpsChanged(model):
                self._vehicle.use_gps_model(model)
            case Tick() if not began:
                self._do_due(now_ns)
        self._settle(now_ns)
        self._tell_wishes()
        out, self._out = self._out, []
        return out

    def _do_due(self, now_ns: int) -> None:
        if self._planner is not None and self._plan_due(now_ns):
            self._plan(self._planner)
        elif self._again_ns is not None and now_ns >= self._again_ns:
            self._again_ns = None
            self._say(now_ns, with_truth=False)

    def event(self, kind: EventKind, detail: str = "") -> Publish:
        """Return a stamped event of this UAV, for facts that only the shell sees."""
        return Publish(self._stamped(Event(source=self.uav, slot=self.slot, kind=kind, detail=detail)))

    # --- the slot begins ---------------------------------------------------------------------

    def _begin_slots(self, now_ns: int) -> bool:
        """Begin the current slot if it has not begun; count the slots missed since the last one as held."""
        slot = self._slot_at(now_ns)
        if slot <= self.slot or slot < 0:
            return False
        self._report_missed_quorum()
        late = now_ns - self._start_ns(slot) > LATE_FRACTION * self._slot_ns
        self._late_ticks += late
        self._fly(slot, late)
        self._knowledge.begin_slot(slot)
        self._election.begin_slot(slot)
        exhausted = self._vehicle.energy_j <= 0.0
        again = self._lacks_command() and not exhausted
        self._again_ns = self._start_ns(slot) + self._tau_ns // 2 if again else None
        if exhausted:
            self._end()
        else:
            self._say(now_ns, with_truth=True)
        return True

    def _lacks_command(self) -> bool:
        """Return True if the head granted was known before this slot and this UAV has no command of it to fly."""
        known = self._said is not None and self._said[0] == self.grant
        return known and self.grant[0] > 0 and self._flown is None

    def _fly(self, slot: int, late: bool) -> None:
        """Fly the pending command of this slot if it is valid, else hold."""
        slots, self.slot = slot - self.slot, slot
        command = self._pending.pop(slot, None)
        if command is not None and refusal(command, self._situation(command, late)) is not None:
            command = None
        self._pending = {later: kept for later, kept in self._pending.items() if later > slot}
        self._vehicle.begin_slot(slots, command)
        self._flown = command
        self._held_slots += slots - 1 + (command is None)

    def _situation(self, command: Command, late: bool) -> Situation:
        length_m = math.dist((command.start_x_m, command.start_y_m), (command.target_x_m, command.target_y_m))
        return Situation(
            slot=self.slot,
            grant=self.grant if self._voter else (-1, ""),
            waypoint_m=self._vehicle.waypoint_m,
            u_max_m=self._mission.u_max_m,
            late_tick=late,
            energy_j=self._vehicle.energy_j,
            step_energy_j=self._vehicle.step_energy_j(length_m),
        )

    def _report_missed_quorum(self) -> None:
        if self._collecting():
            self._publish(self._head.powerless(self.slot))

    def _end(self) -> None:
        """End with an empty battery: the UAV lands at its waypoint and stays an obstacle."""
        self.ended = True
        self._persist()
        self._publish_truth()
        self._out.append(self.event(EventKind.BATTERY_EMPTY))
        self._out.append(Stop())

    # --- messages ----------------------------------------------------------------------------

    def _receive(self, message: Message, now_ns: int) -> None:
        match message:
            case Fix() if message.uav != self.uav and message.uav in self._roster:
                self._gone.discard(message.uav)
                self._compare_clocks(message, now_ns)
                self._knowledge.hear_fix(message, self.slot)
                self._election.hear_fix(message)
            case Command() if message.head != self.uav:
                self._take_command(message)
            case Report() if message.head != self.uav:
                self._take_report(message)
            case _:
                pass

    def _take_command(self, command: Command) -> None:
        """Keep a command of the head granted for a later slot; ignore all others.

        There is one plan per term and slot, so the node keeps the first command of each slot.
        """
        if command.uav != self.uav or (command.term, command.head) != self.grant:
            return
        if command.slot >= self.slot:
            self._election.hear_command()
        if command.slot > self.slot and len(self._pending) < MAX_PENDING:
            self._pending.setdefault(command.slot, command)
            self._wgs84(self._vehicle.next_position_m)  # Half the work of a tick, done while there is time.

    def _wgs84(self, position_m: tuple[float, float]) -> tuple[float, float]:
        return to_wgs84(*position_m, self._mission.origin_lat_deg, self._mission.origin_lon_deg)

    def _take_own_command(self, now_ns: int) -> None:
        """Receive the head's own command in the step after planning, since planning may have taken too long."""
        own, self._own = self._own, None
        if own is not None and self._slot_at(now_ns) < own.slot:
            self._take_command(own)

    def _take_report(self, report: Report) -> None:
        """Process a report; ignore a plan or a claim without the quorum that the mission asks for."""
        if report.status != "no-quorum" and not report.is_backed(self._roster, self._mission.quorum):
            return
        if report.has_quorum:
            self._knowledge.hear_report(report)
        if report.slot >= self.slot - 1 or report.term > self.grant[0]:
            self._election.hear_report(report)

    def _compare_clocks(self, fix: Fix, now_ns: int) -> None:
        """Publish an event, once per UAV, if a fix is from the future by more than the guard: a clock is off."""
        ahead_s = (fix.sent_ns - now_ns) / 1e9
        if ahead_s > max(self._mission.guard_s, 1e-3) and fix.uav not in self._clock_reported:
            self._clock_reported.add(fix.uav)
            self._out.append(self.event(EventKind.CLOCK_OFFSET, f"{fix.uav} is {ahead_s * 1e3:.1f} ms ahead or more"))

    # --- the grant ---------------------------------------------------------------------------

    def _settle(self, now_ns: int) -> None:
        """Publish a changed grant or suspicion at once: persist, fix, then the claim if there is one."""
        if self.slot < 0 or self._said is None or self.ended:
            return
        if self._said != (self.grant, self._election.suspects):
            self._say(now_ns, with_truth=False)

    def _say(self, now_ns: int, *, with_truth: bool) -> None:
        """Persist the promise, then publish the truth if asked, the fix, and the claim if there is one."""
        if self._said is None or self._said[0] != self.grant:
            self._change_grant(now_ns)
        self._persist()
        if with_truth:
            self._publish_truth()
        fix = self._publish(self._fix())
        self._knowledge.hear_fix(fix, self.slot)
        self._said = (self.grant, self._election.suspects)
        self._publish_claim()

    def _change_grant(self, now_ns: int) -> None:
        """Discard the pending commands of the old grant; take office if this UAV is the new head."""
        self._pending.clear()
        if self._election.leads:
            self._head.take_office(self.grant)
            self._office_ns = now_ns
            if self._head.may_plan(self.slot):
                self._out.append(self.event(EventKind.TAKES_OFFICE, f"term {self.grant[0]}"))

    def _publish_claim(self) -> None:
        claim, self._election.claim = self._election.claim, None
        if claim is None:
            return
        suspecting = list(claim.suspecting)
        self._publish(
            Report(
                head=self.uav,
                slot=self.slot,
                term=claim.term,
                planner=self._mission.planner,
                status="claim",
                grants=suspecting,
                quorum=self._mission.quorum,
            )
        )

    # --- the head ----------------------------------------------------------------------------

    def _collecting(self) -> bool:
        """Return True if this UAV is head and has not planned from this slot's fixes yet."""
        return (
            self._election.leads
            and self._head.office.grant == self.grant
            and self.slot >= 0
            and self._head.may_plan(self.slot)
        )

    def _deadline_ns(self) -> int:
        """Return the time until which the head waits for fixes; it is later in the slot in which it took office."""
        tau_ns = self._start_ns(self.slot) + self._tau_ns
        return max(tau_ns, self._office_ns + round(CLAIM_WAIT_FRACTION * self._slot_ns))

    def _plan_due(self, now_ns: int) -> bool:
        if self.ended or self._planner is None or not self._collecting() or not self._head.has_quorum(self.slot):
            return False
        return now_ns >= self._deadline_ns() or self._head.complete(self.slot, self._gone)

    def _plan(self, planner: Planner) -> None:
        outcome = self._head.plan(self.slot, planner)
        for command in outcome.commands:
            stamped = self._publish(command)
            if command.uav == self.uav:
                self._own = stamped
        self._vehicle.spend(compute_energy_j(outcome.report.plan_ms / 1e3, self._mission.head))
        self._election.planned()
        report = self._publish(self._with_succession(outcome.report))
        self._election.hear_report(report)
        self._tell_problem(outcome.problem)

    def _tell_problem(self, problem: str) -> None:
        """Publish why there was no plan, once until there is a plan again or another reason."""
        if problem and problem != self._problem:
            self._out.append(self.event(EventKind.PLANNER_FAILED, problem))
        self._problem = problem

    def _with_succession(self, report: Report) -> Report:
        """Return the report with the standbys, ranked anew, and with the successor if the head names one."""
        heard = [self._knowledge.newest[uav] for uav in report.heard]
        ranked = [uav for uav in self._election.ranked(heard) if uav != self.uav]
        next_term, successor = self._election.pick_successor(heard, not report.unheard) or (0, "")
        return msgspec.structs.replace(
            report, standby=ranked[: self._mission.standbys], successor=successor, next_term=next_term
        )

    # --- effects -----------------------------------------------------------------------------

    def _tell_wishes(self) -> None:
        if self.ended:
            return
        if self._listening != self._election.listens:
            self._listening = self._election.listens
            self._out.append(Listen(self._listening))
        may_lead = self._candidate or self._election.leads or self.uav in self._election.standbys
        if may_lead and not self._planner_wanted and self._planner is None:
            self._planner_wanted = True
            self._out.append(WantPlanner())

    def _persist(self) -> None:
        promise = None
        if self._voter:
            x_m, y_m = self._vehicle.waypoint_m
            term, head = self.grant
            promise = Promise(slot=self.slot, term=term, head=head, waypoint_x_m=x_m, waypoint_y_m=y_m)
        self._out.append(Persist(promise, self._vehicle.airframe))

    def _publish_truth(self) -> None:
        from_x_m, from_y_m, to_x_m, to_y_m = self._vehicle.truth_m
        self._publish(
            Truth(
                uav=self.uav,
                slot=self.slot,
                from_x_m=from_x_m,
                from_y_m=from_y_m,
                to_x_m=to_x_m,
                to_y_m=to_y_m,
            )
        )

    def _publish(self, message: M) -> M:
        stamped = self._stamped(message)
        self._out.append(Publish(stamped))
        if not isinstance(message, Truth):
            self._vehicle.spend(self._mission.energy.radio_j_per_message)
        return stamped

    def _stamped(self, message: M) -> M:
        key = self._keys.of(message)
        seq = self._seq.get(key, -1) + 1
        self._seq[key] = seq
        return msgspec.structs.replace(message, instance=self._instance, seq=seq)

    def _fix(self) -> Fix:
        vehicle, flown = self._vehicle, self._flown
        x_m, y_m = vehicle.position_m
        lat_deg, lon_deg = self._wgs84(vehicle.position_m)
        term, head = self.grant
        return Fix(
            uav=self.uav,
            slot=self.slot,
            x_m=x_m,
            y_m=y_m,
            lat_deg=lat_deg,
            lon_deg=lon_deg,
            r_m=vehicle.r_m,
            waypoint_x_m=vehicle.waypoint_m[0],
            waypoint_y_m=vehicle.waypoint_m[1],
            executing=flown is not None,
            command_term=flown.term if flown is not None else -1,
            command_seq=flown.seq if flown is not None else -1,
            arrived=vehicle.arrived,
            term=term,
            head=head,
            suspects=self._election.suspects,
            voter=self._voter,
            from_x_m=vehicle.from_m[0],
            from_y_m=vehicle.from_m[1],
            energy_j=vehicle.energy_j,
            response_ms=self._response_ms,
            held_slots=self._held_slots,
            late_ticks=self._late_ticks,
            cpu_s=self._cpu_s(),
        )

    # --- the clock ---------------------------------------------------------------------------

    def _slot_at(self, now_ns: int) -> int:
        return (now_ns - self._epoch_ns) // self._slot_ns

    def _start_ns(self, slot: int) -> int:
        return self._epoch_ns + slot * self._slot_ns
