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
   `tau_s` into the slot: its last fix may be lost, and a head without a quorum of fixes cannot plan. If its tick was
   later than a quarter of `tau_s` it does not: twice the fixes would keep an overloaded machine without commands.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import msgspec

from edc_swarm.agent.effects import (
    Disturbed,
    Effect,
    Land,
    Listen,
    NodeEvent,
    PeerGone,
    Persist,
    PlannerReady,
    Publish,
    Received,
    Strayed,
    Tick,
    WantPlanner,
)
from edc_swarm.agent.election import Election
from edc_swarm.agent.flight import MAX_PENDING, Flight
from edc_swarm.agent.foreign import Foreign
from edc_swarm.agent.goals import course_of, is_new
from edc_swarm.agent.knowledge import Grant, Knowledge
from edc_swarm.agent.leadership import Leadership, startup_candidates
from edc_swarm.agent.local import LocalControl, NoElection
from edc_swarm.agent.mission_tables import MissionTables
from edc_swarm.agent.outgoing import M, Outgoing
from edc_swarm.agent.repetition import Repetition
from edc_swarm.agent.slot_clock import SlotClock
from edc_swarm.agent.vehicle import Airframe, Promise, Vehicle
from edc_swarm.emulation.body import Body
from edc_swarm.emulation.energy import compute_energy_j
from edc_swarm.mission.faults import OrderLanding
from edc_swarm.planner.interface import Planner, plan_ms
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.goals import GoalAnswer
from edc_swarm.protocol.messages import Command, Fix, Goal, Message, MissionMessage, Report, Truth


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
    body
        The body that flies, None for an emulated one.
    tables
        Tables of the mission that several UAVs share.
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
        body: Body | None = None,
        tables: MissionTables[MissionMessage] | None = None,
    ) -> None:
        self._mission = mission
        self.uav = uav
        voter = promise is not None
        grant: Grant = promise.grant if promise is not None else (0, "")
        self.slot = promise.slot if promise is not None else -1
        self.ended = False
        self._strays = False
        tables = tables if tables is not None else MissionTables(mission)
        entry = tables.entries[uav]
        self._cluster = own = tables.of_cluster(entry.cluster)
        self._foreign = Foreign(mission, entry.cluster, tables)
        self._clock = SlotClock(mission)
        self._vehicle = Vehicle(mission, entry, promise, airframe, body)
        self._flight = Flight(self._vehicle, voter)
        self._knowledge = Knowledge(tables.members(entry.cluster), tables.index)
        self._election: Election | NoElection
        self._leadership: Leadership | LocalControl
        if mission.control == "local":
            self._election = NoElection(uav)
            self._leadership = LocalControl(mission, uav, self._knowledge, self._clock)
        else:
            self._election = election = Election(own, uav, grant, voter, self._knowledge)
            self._leadership = Leadership(own, uav, self._knowledge, election, self._clock, self._foreign)
        self._outgoing = Outgoing(own, uav, instance, voter, response_ms, cpu_s)
        self._repetition = Repetition(own, uav, self._clock)
        self._said: tuple[Grant, bool] | None = None
        self._listening: Listen | None = None
        self._again_ns: int | None = None
        self._refused_slot = -1
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
    def trusts(self) -> bool:
        """True if another UAV leads, and this one does not suspect it."""
        return self.grant[0] > 0 and not (self._election.leads or self._election.suspects)

    @property
    def is_awaited(self) -> bool:
        """True if all others wait for this UAV: it leads, or hears all fixes without a head and may have to claim.

        A UAV that strays has given up its office.
        """
        return not self._strays and (self._election.leads or (self._election.listens and self._election.suspects))

    @property
    def last_seqs(self) -> dict[str, int]:
        """Last sequence number on each key of this UAV, for the `closed` event."""
        return dict(self._outgoing.seqs)

    def wakeup_ns(self, now_ns: int) -> int:
        """Return the time of the next `Tick`, in nanoseconds of the clock of `step`."""
        leadership, clock = self._leadership, self._clock
        if self._strays or self.ended:
            return clock.start_ns(max(self.slot, clock.slot_at(now_ns)) + 1)
        if leadership.own_command is not None or leadership.plan_due(self.slot, now_ns):
            return now_ns
        due_ns = [clock.start_ns(clock.slot_at(now_ns) + 1)]
        if self._again_ns is not None:
            due_ns.append(max(self._again_ns, now_ns))
        if self._repetition.next_ns is not None:
            due_ns.append(max(self._repetition.next_ns, now_ns))
        if leadership.collects(self.slot) and now_ns < leadership.deadline_ns(self.slot):
            due_ns.append(leadership.deadline_ns(self.slot))
        return min(due_ns)

    def step(self, event: NodeEvent, now_ns: int) -> list[Effect]:
        """Process one event at `now_ns` (wall nanoseconds of the own clock) and return the effects in order.

        The node begins a due slot before it processes the event. So a message counts for a slot only if the node
        processes it before that slot begins, even after a freeze. Planning takes a step of its own, a `Tick` in
        which nothing else is due, so that no fix waits for a plan.
        """
        if self.ended:
            return []
        if self._strays:
            return self._stray(now_ns)
        own = self._leadership.take_own_command(self._clock.slot_at(now_ns))
        if own is not None:
            self._take_command(own)
        began = self._begin_slots(now_ns)
        match event:
            case Received(message) if self._foreign.hear(message, self.slot):
                if own is None and not began:
                    return []  # It changes neither grant nor wishes, and most of what a head hears may be such.
            case Received(message):
                self._receive(message, now_ns)
            case PeerGone(uav) if uav in self._knowledge.roster:
                self._leadership.gone.add(uav)
                self._election.peer_gone(uav)
            case PlannerReady(planner):
                self._leadership.planner = planner
            case Disturbed(OrderLanding()):
                self._flight.ordered_down = True
            case Disturbed(fault):
                self._vehicle.disturb(fault)
            case Strayed(why):
                self._out.append(self.event(EventKind.STRAYED, why))
                return self._begin_straying()
            case Tick() if not began:
                self._do_due(now_ns)
        self._settle(now_ns)
        self._tell_wishes()
        out, self._out = self._out, []
        return out

    def wishes(self) -> list[Effect]:
        """Return the effects by which this UAV prepares for its first slot: what it listens to, and a planner."""
        self._tell_wishes()
        out, self._out = self._out, []
        return out

    def _do_due(self, now_ns: int) -> None:
        planner = self._leadership.planner
        if planner is not None and self._leadership.plan_due(self.slot, now_ns):
            if isinstance(self._leadership, LocalControl):
                self._plan_own(self._leadership, planner)
            else:
                self._plan(self._leadership, planner, now_ns)
        elif self._again_ns is not None and now_ns >= self._again_ns:
            self._again_ns = None
            self._say(now_ns, with_truth=False)
        else:
            for copy in self._repetition.due(now_ns):
                self._publish(copy)

    def _begin_straying(self) -> list[Effect]:
        """Give up command, vote and office: the UAV is unheard from now on, and only says where it is."""
        self._strays, self._flight.voter, self._again_ns = True, False, None
        self._flight.discard()
        out, self._out = [*self._out, Listen(False)], []
        return out

    def _stray(self, now_ns: int) -> list[Effect]:
        """Say once a slot where the vehicle is, or how far it can be."""
        slot = self._clock.slot_at(now_ns)
        if slot > self.slot:
            slots, self.slot = slot - self.slot, slot
            self._flight.begin_slot(slot, slots, self.grant, self._clock.is_late(slot, now_ns))
            self._say_truth()
            self._publish(self._outgoing.fix(self.slot, self._vehicle, self._flight, self._election))
        out, self._out = self._out, []
        return out

    def event(self, kind: EventKind, detail: str = "") -> Publish:
        """Return a stamped event of this UAV, for facts that only the shell sees."""
        return Publish(self._outgoing.stamped(self._outgoing.event(self.slot, kind, detail)))

    # --- the slot begins ---------------------------------------------------------------------

    def _begin_slots(self, now_ns: int) -> bool:
        """Begin the current slot if it has not begun; count the slots missed since the last one as held."""
        slot = self._clock.slot_at(now_ns)
        if slot <= self.slot or slot < 0:
            return False
        if (missed := self._leadership.missed(self.slot)) is not None:
            self._publish(missed)
        slots, self.slot = slot - self.slot, slot
        self._flight.begin_slot(slot, slots, self.grant, self._clock.is_late(slot, now_ns))
        self._knowledge.begin_slot(slot)
        self._election.begin_slot(slot)
        self._look_around()
        self._repetition.begin_slot(slot)
        known = self._said is not None and self._said[0] == self.grant
        lacks_command = known and self.grant[0] > 0 and self._flight.flown is None
        again_ns = self._clock.start_ns(slot) + self._clock.tau_ns // 2
        in_time = again_ns - now_ns >= self._clock.tau_ns // 4
        self._again_ns = again_ns if lacks_command and in_time else None
        if self._vehicle.energy_j <= 0.0:
            self._end(EventKind.BATTERY_EMPTY)
        elif self._flight.ordered_down and self._vehicle.rests:
            self._end(EventKind.LANDED, "the operator ordered it to land")
        elif self._vehicle.must_land(slot):
            self._end(EventKind.LANDED, f"no accepted step since slot {self._vehicle.stepped_slot}")
        else:
            self._say(now_ns, with_truth=True)
        return True

    def ground(self, unsaid: Sequence[Effect]) -> list[Effect]:
        """End, since the vehicle landed before it could accept a step; `unsaid` are the effects that never happen."""
        self.ended = True
        self._outgoing.take_back([effect.message for effect in unsaid if isinstance(effect, Publish)])
        return [self.event(EventKind.LANDED, "a step came too late"), Land()]

    def _end(self, kind: EventKind, detail: str = "") -> None:
        """End with an empty battery, or by the failsafe: the UAV lands at its waypoint and never flies again."""
        self.ended, self._again_ns = True, None
        self._persist()
        self._say_truth()
        self._out.append(self.event(kind, detail))
        self._out.append(Land())

    # --- messages ----------------------------------------------------------------------------

    def _receive(self, message: Message, now_ns: int) -> None:
        self._repetition.hear(message)
        match message:
            case Fix() if message.uav != self.uav and message.uav in self._knowledge.roster:
                self._leadership.gone.discard(message.uav)
                if offset := self._clock.offset_of(message, now_ns):
                    self._out.append(self.event(EventKind.CLOCK_OFFSET, offset))
                self._knowledge.hear_fix(message, self.slot)
                self._election.hear_fix(message)
            case Command() if message.head != self.uav:
                self._take_command(message)
            case Report() if message.head != self.uav:
                self._take_report(message)
            case Goal() if message.uav == self.uav and self._said is not None:
                self._take_goal(message, now_ns)
            case _:
                pass

    def _look_around(self) -> None:
        """Find the UAVs of other clusters whose fixes this UAV needs as head, or soon may need."""
        if not (self._election.in_office and len(self._foreign)):
            self._foreign.look_around(self.slot, ())
            return
        self._foreign.begin_slot(self.slot)
        places = {entry.uav: (entry.start_x_m, entry.start_y_m) for entry in self._cluster.roster}
        fixes = self._knowledge.newest.values()
        places |= {fix.uav: (fix.waypoint_x_m, fix.waypoint_y_m) for fix in fixes}
        self._foreign.look_around(self.slot, places.values())

    def _take_command(self, command: Command) -> None:
        """Keep a command of the head granted for a later slot; ignore all others.

        There is one plan per term and slot, so the node keeps the first command of each slot.
        """
        if command.uav != self.uav or (command.term, command.head) != self.grant:
            return
        if command.slot >= self.slot:
            self._election.hear_command()
        if command.slot == self.slot:
            self._again_ns = None  # It comes too late: the head is slow, not deaf, and more fixes would slow it down.
        if command.slot > self.slot and self._flight.keep(command):
            self._repetition.take_command(command)
            self._outgoing.wgs84(self._vehicle.next_position_m)  # Half the work of a tick, done while there is time.

    def _take_report(self, report: Report) -> None:
        """Process a report; ignore a plan or a claim without the quorum that the mission asks for."""
        if report.status != "no-quorum" and not report.is_backed(self._knowledge.roster, self._cluster.quorum):
            return
        if report.has_quorum:
            self._knowledge.hear_report(report)
        self._election.hear_report(report)

    def _take_goal(self, goal: Goal, now_ns: int) -> None:
        """Fly a goal that is newer than the own one: persist it, then acknowledge it by a fix; or say why not."""
        if not is_new(goal, self._vehicle.course):
            return
        reason = self._vehicle.refusal_of(goal) if self._flight.voter else "it has lost its memory, and flies no more"
        if not reason:
            self._vehicle.course = course_of(goal)
            self._say(now_ns, with_truth=False)
        elif self._refused_slot < self.slot:
            self._refused_slot = self.slot
            answer = msgspec.json.encode(GoalAnswer(self.uav, goal.number, reason)).decode()
            self._out.append(self.event(EventKind.GOAL_REFUSED, answer))

    # --- the grant ---------------------------------------------------------------------------

    def _settle(self, now_ns: int) -> None:
        """Publish a changed grant or suspicion at once: persist, fix, then the claim if there is one."""
        if self.slot < 0 or self._said is None or self.ended:
            return
        if self._said != (self.grant, self._election.suspects):
            self._say(now_ns, with_truth=False)

    def _say(self, now_ns: int, *, with_truth: bool) -> None:
        """Persist the promise, then publish the truth if asked, the fix, and the claim that has no quorum yet.

        After a change of the grant the UAV first discards the pending commands, and takes office if it leads.
        """
        if self._said is None or self._said[0] != self.grant:
            self._flight.discard()
            self._repetition.drop()
            if self._leadership.take_office(self.slot, now_ns):
                self._out.append(self.event(EventKind.TAKES_OFFICE, f"term {self.grant[0]}"))
        self._persist()
        if with_truth:
            self._say_truth()
        made = self._outgoing.fix(self.slot, self._vehicle, self._flight, self._election)
        fix = self._publish(self._repetition.fix_with_missed(made))
        self._knowledge.hear_fix(fix, self.slot)
        self._said = (self.grant, self._election.suspects)
        if not self.leads and self._repetition.repeat_fix(fix, now_ns):
            self._again_ns = None
        if self._election.claim is not None:
            claim = self._publish(self._outgoing.claim(self.slot, self._election.claim))
            self._repetition.repeat_claim(claim, now_ns)

    def _say_truth(self) -> None:
        for truth in self._outgoing.truths(self.slot, self._vehicle):
            self._publish(truth)

    # --- the head ----------------------------------------------------------------------------

    def _plan_own(self, local: LocalControl, planner: Planner) -> None:
        """Plan the own step, with nobody's word but the fixes heard; the step is flown from the next event on."""
        plan = local.plan(self.slot, planner, self._vehicle)
        self._vehicle.spend(compute_energy_j(plan_ms(plan) / 1e3, self._mission.head))
        if local.is_new(plan.problem):
            self._out.append(self.event(EventKind.PLANNER_FAILED, plan.problem))

    def _plan(self, leadership: Leadership, planner: Planner, now_ns: int) -> None:
        outcome = leadership.head.plan(self.slot, planner)
        commands = [self._repetition.command_with_missed(command) for command in outcome.commands]
        for command in commands:
            stamped = self._publish(command)
            if command.uav == self.uav:
                leadership.own_command = stamped
        self._vehicle.spend(compute_energy_j(outcome.report.plan_ms / 1e3, self._mission.head))
        leadership.planned()
        report = self._publish(leadership.with_succession(outcome.report))
        self._election.hear_report(report)
        self._repetition.repeat_plan(commands, report, now_ns)
        if leadership.is_new(outcome.problem):
            self._out.append(self.event(EventKind.PLANNER_FAILED, outcome.problem))

    # --- effects -----------------------------------------------------------------------------

    def _tell_wishes(self) -> None:
        if self.ended:
            return
        before, listens, near = self._listening, self._election.listens, self._foreign.near
        if before is None or before.all_fixes != listens or before.near != near:
            self._listening = Listen(listens, near)
            if before is None or before.all_fixes != self._listening.all_fixes:
                self._repetition.begin_listening()
            self._out.append(self._listening)
        if self._leadership.wants_planner():
            self._out.append(WantPlanner(rehearsed=self.slot < 0 or not self.is_awaited))

    def _persist(self) -> None:
        self._out.append(Persist(self._flight.promise(self.slot, self.grant), self._vehicle.airframe))

    def _publish(self, message: M) -> M:
        stamped = self._outgoing.stamped(message)
        self._out.append(Publish(stamped))
        if not isinstance(message, Truth):
            self._vehicle.spend(self._mission.energy.radio_j_per_message)
        return stamped


__all__ = [
    "MAX_PENDING",
    "Disturbed",
    "Effect",
    "Land",
    "Listen",
    "NodeEvent",
    "PeerGone",
    "Persist",
    "PlannerReady",
    "Publish",
    "Received",
    "Strayed",
    "Tick",
    "UavNode",
    "WantPlanner",
    "startup_candidates",
]
