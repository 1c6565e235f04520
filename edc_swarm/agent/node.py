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
3. a message may change the grant or the suspicion: the UAV then persists its promise and sends its fix again within
   the slot. A UAV that expected a command for this slot and has none sends its fix once more too (`announcer`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import msgspec

from edc_swarm.agent.announcer import Announcer
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
from edc_swarm.agent.flight import Flight
from edc_swarm.agent.foreign import Foreign, places_m
from edc_swarm.agent.goals import course_of, is_new
from edc_swarm.agent.knowledge import Grant, Knowledge
from edc_swarm.agent.leadership import Leadership
from edc_swarm.agent.local import LocalControl, NoElection
from edc_swarm.agent.mission_tables import MissionTables
from edc_swarm.agent.outgoing import Outgoing
from edc_swarm.agent.repetition import Repetition
from edc_swarm.agent.slot_clock import SlotClock
from edc_swarm.agent.vehicle import Airframe, Promise, Vehicle
from edc_swarm.emulation.body import Body
from edc_swarm.emulation.energy import compute_energy_j
from edc_swarm.planner.interface import Planner, plan_ms
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.goals import GoalAnswer
from edc_swarm.protocol.messages import Command, Fix, Goal, Message, MissionMessage, Report


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
        Processor time in which this machine plans a reference slot, 0 if it was not measured.
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
        self._announcer = Announcer(
            self._outgoing,
            self._vehicle,
            self._flight,
            self._knowledge,
            self._election,
            self._leadership,
            self._repetition,
            self._clock,
            radio_j=mission.energy.radio_j_per_message,
        )
        self._listening: Listen | None = None
        self._refused_slot = -1

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
        again_ns = (self._announcer.again_ns, self._repetition.next_ns)
        due_ns += [max(at_ns, now_ns) for at_ns in again_ns if at_ns is not None]
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
            case Disturbed(fault):
                self._flight.disturb(fault)
            case Strayed(why):
                self._announcer.say_event(self.slot, EventKind.STRAYED, why)
                self._strays = True
                self._flight.give_up()
                return [*self._announcer.take_effects(), Listen(False)]
            case Tick() if not began:
                self._do_due(now_ns)
        if not self.ended:
            self._announcer.say_change(self.slot, now_ns)
        return [*self._announcer.take_effects(), *self.wishes()]

    def wishes(self) -> list[Effect]:
        """Return what this UAV asks of its shell from now on: other messages to listen to, and a planner."""
        wishes: list[Effect] = []
        if self.ended:
            return wishes
        before, listens, near = self._listening, self._election.listens, self._foreign.near
        if before is None or before.all_fixes != listens or before.near != near:
            self._listening = Listen(listens, near)
            if before is None or before.all_fixes != listens:
                self._repetition.begin_listening()
            wishes.append(self._listening)
        if self._leadership.wants_planner():
            wishes.append(WantPlanner(rehearsed=self.slot < 0 or not self.is_awaited))
        return wishes

    def _do_due(self, now_ns: int) -> None:
        planner = self._leadership.planner
        if planner is not None and self._leadership.plan_due(self.slot, now_ns):
            if isinstance(self._leadership, LocalControl):
                self._plan_own(self._leadership, planner)
            else:
                self._plan(self._leadership, planner, now_ns)
        elif self._announcer.again_ns is not None and now_ns >= self._announcer.again_ns:
            self._announcer.again_ns = None
            self._announcer.say(self.slot, now_ns, with_truth=False)
        else:
            for copy in self._repetition.due(now_ns):
                self._announcer.publish(copy)

    def _stray(self, now_ns: int) -> list[Effect]:
        """Say once a slot where the vehicle is, or how far it can be."""
        slot = self._clock.slot_at(now_ns)
        if slot > self.slot:
            slots, self.slot = slot - self.slot, slot
            self._flight.begin_slot(slot, slots, self.grant, self._clock.is_late(slot, now_ns))
            self._announcer.say_stray(slot)
        return self._announcer.take_effects()

    def event(self, kind: EventKind, detail: str = "") -> Publish:
        """Return a stamped event of this UAV, for facts that only the shell sees."""
        return self._announcer.event(self.slot, kind, detail)

    # --- the slot begins ---------------------------------------------------------------------

    def _begin_slots(self, now_ns: int) -> bool:
        """Begin the current slot if it has not begun; count the slots missed since the last one as held."""
        slot = self._clock.slot_at(now_ns)
        if slot <= self.slot or slot < 0:
            return False
        if (missed := self._leadership.missed(self.slot)) is not None:
            self._announcer.publish(missed)
        slots, self.slot = slot - self.slot, slot
        self._flight.begin_slot(slot, slots, self.grant, self._clock.is_late(slot, now_ns))
        self._knowledge.begin_slot(slot)
        self._election.begin_slot(slot)
        if self._election.in_office and len(self._foreign):
            self._foreign.begin_slot(slot)
            self._foreign.look_around(slot, places_m(self._cluster, self._knowledge))
        else:
            self._foreign.look_around(slot, ())
        self._repetition.begin_slot(slot)
        self._announcer.begin_slot(slot, now_ns)
        if (ending := self._flight.ending(slot)) is not None:
            self.ended = True
            self._announcer.say_end(slot, *ending)
        else:
            self._announcer.say(slot, now_ns, with_truth=True)
        return True

    def ground(self, unsaid: Sequence[Effect]) -> list[Effect]:
        """End, since the vehicle landed before it could accept a step; `unsaid` are the effects that never happen."""
        self.ended = True
        self._outgoing.take_back([effect.message for effect in unsaid if isinstance(effect, Publish)])
        return [self.event(EventKind.LANDED, "a step came too late"), Land()]

    # --- messages ----------------------------------------------------------------------------

    def _receive(self, message: Message, now_ns: int) -> None:
        self._repetition.hear(message)
        match message:
            case Fix() if message.uav != self.uav and message.uav in self._knowledge.roster:
                self._leadership.gone.discard(message.uav)
                if offset := self._clock.offset_of(message, now_ns):
                    self._announcer.say_event(self.slot, EventKind.CLOCK_OFFSET, offset)
                self._knowledge.hear_fix(message, self.slot)
                self._election.hear_fix(message)
            case Command() if message.head != self.uav:
                self._take_command(message)
            case Report() if message.head != self.uav:
                self._take_report(message)
            case Goal() if message.uav == self.uav and self._announcer.has_begun:
                self._take_goal(message, now_ns)
            case _:
                pass

    def _take_command(self, command: Command) -> None:
        """Keep a command of the head granted for a later slot; ignore all others.

        There is one plan per term and slot, so the node keeps the first command of each slot.
        """
        if command.uav != self.uav or (command.term, command.head) != self.grant:
            return
        if command.slot >= self.slot:
            self._election.renew_lease()
        if command.slot == self.slot:
            # It comes too late: the head is slow, not deaf, and more fixes would slow it down.
            self._announcer.again_ns = None
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
            self._announcer.say(self.slot, now_ns, with_truth=False)
        elif self._refused_slot < self.slot:
            self._refused_slot = self.slot
            answer = msgspec.json.encode(GoalAnswer(self.uav, goal.number, reason)).decode()
            self._announcer.say_event(self.slot, EventKind.GOAL_REFUSED, answer)

    # --- the head ----------------------------------------------------------------------------

    def _plan_own(self, local: LocalControl, planner: Planner) -> None:
        """Plan the own step, with nobody's word but the fixes heard; the step is flown from the next event on."""
        plan = local.plan(self.slot, planner, self._vehicle)
        self._vehicle.spend(compute_energy_j(plan_ms(plan) / 1e3, self._mission.head))
        if local.is_new(plan.problem):
            self._announcer.say_event(self.slot, EventKind.PLANNER_FAILED, plan.problem)

    def _plan(self, leadership: Leadership, planner: Planner, now_ns: int) -> None:
        outcome = leadership.head.plan(self.slot, planner)
        commands = [self._repetition.command_with_missed(command) for command in outcome.commands]
        for command in commands:
            stamped = self._announcer.publish(command)
            if command.uav == self.uav:
                leadership.own_command = stamped
        self._vehicle.spend(compute_energy_j(outcome.report.plan_ms / 1e3, self._mission.head))
        leadership.planned()
        report = self._announcer.publish(leadership.with_succession(outcome.report))
        self._election.hear_report(report)
        self._repetition.repeat_plan(commands, report, now_ns)
        if leadership.is_new(outcome.problem):
            self._announcer.say_event(self.slot, EventKind.PLANNER_FAILED, outcome.problem)


__all__ = [
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
]
