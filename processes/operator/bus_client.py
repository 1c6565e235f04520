"""The operator's side of the bus: it publishes the mission, the faults and the end, and follows the mission."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial

import msgspec
import zenoh

from edc_swarm.mission.faults import ProcessFault, declaration_of
from edc_swarm.mission.field_types import Point
from edc_swarm.mission.roles import OPERATOR
from edc_swarm.protocol.codec import encode
from edc_swarm.protocol.completion import MissionMonitor
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.goals import PendingGoals
from edc_swarm.protocol.ground_orders import GroundOrder, order_in
from edc_swarm.protocol.keys import Keys
from edc_swarm.protocol.messages import Command, Event, Fix, Goal, MissionMessage, Report
from edc_swarm.story.teller import Storyteller
from processes.bus.event_source import EventSource
from processes.bus.outbox import Outbox
from processes.bus.session import hand_over, subscribe
from processes.bus.subscriptions import MAX_TOKENS, Gate, Heard, Token, heard_from
from processes.operator.registration import Registration
from processes.runtime.clock import MissionClock
from processes.runtime.inbox import Inbox

ENDS_OF_FLIGHT = frozenset({EventKind.LANDED, EventKind.BATTERY_EMPTY})
"""Events of UAVs that fly no more and end by themselves."""
MAX_ORDERED = 1000
"""Most orders from the ground that wait; of more the oldest ones are dropped."""


@dataclass(slots=True)
class Seen:
    """Firsts and lasts of the mission that the operator has received.

    Attributes
    ----------
    heard
        UAVs that have published a fix.
    first_flown_slot
        First slot in which any UAV executed a command, -1 before it.
    closed
        Publishers that have published their last sequence numbers.
    landed
        UAVs that have said that they have landed, or that their battery is empty: their processes end.
    """

    heard: set[str] = field(default_factory=set)
    first_flown_slot: int = -1
    closed: set[str] = field(default_factory=set)
    landed: set[str] = field(default_factory=set)

    def hear_fix(self, fix: Fix) -> None:
        """Note a fix."""
        self.heard.add(fix.uav)
        if fix.executing and self.first_flown_slot < 0:
            self.first_flown_slot = fix.slot


class Operator:
    """The operator's session: it publishes mission and events, answers queries, and follows fixes, reports and events.

    Attributes
    ----------
    clock
        The mission's clock of this host.
    monitor
        Progress of the mission: its head, the UAVs that have arrived; None before the mission.
    teller
        The story of the mission; None before it.
    seen
        Firsts and lasts of the mission that the operator has received.
    ordered
        Orders from the ground that have not been carried out yet.
    """

    def __init__(
        self, session: zenoh.Session, registration: Registration, inbox: Inbox[object], clock: MissionClock
    ) -> None:
        self.ordered: deque[GroundOrder] = deque(maxlen=MAX_ORDERED)
        self._keys = Keys(registration.mission.name)
        self._registration = registration
        self._inbox = inbox
        self.clock = clock
        self._events = EventSource(OPERATOR, clock)
        self._mission: MissionMessage | None = None
        self._in_force: list[bytes] = []
        self._goals: PendingGoals | None = None
        self._goal_seqs: dict[str, int] = {}
        self._tokens: set[tuple[str, str]] = set()
        self._gate = Gate(partial(self.publish_event, EventKind.MALFORMED))
        self.seen = Seen()
        self.monitor: MissionMonitor | None = None
        self.teller: Storyteller | None = None
        self._session = session
        self._outbox = Outbox(self._session, self._keys.again(OPERATOR, self._events.instance), inbox)
        self._declare()
        self._token = session.liveliness().declare_token(self._keys.alive(OPERATOR, self._events.instance))

    def _declare(self) -> None:
        keys, session = self._keys, self._session
        for key in (keys.all_fixes, keys.all_reports, keys.command("*", "*"), keys.event("*")):
            subscribe(session, key, self._take)
        for key in (keys.mission, keys.event(OPERATOR)):
            session.declare_queryable(key, hand_over(self._inbox.put))
        self._registration.declare(session, self._inbox)
        session.liveliness().declare_subscriber(keys.all_alive, hand_over(self._take_token), history=True)

    def publish_mission(self, mission: MissionMessage) -> None:
        """Start the mission; from now on no claimant receives an id."""
        claims = self._registration.claims
        claims.begin()
        self._mission = msgspec.structs.replace(
            mission,
            claimants=claims.claimants([entry.uav for entry in mission.roster]),
            instance=self._events.instance,
            sent_ns=self.clock.now_ns(),
        )
        self.monitor, self._goals = MissionMonitor(mission), PendingGoals(mission)
        self.teller = Storyteller(self._mission)
        self._gate.know(self._mission)
        self._say(self._keys.mission, encode(self._mission), self._mission.seq)

    def take_over(self, mission: MissionMessage, in_force: Sequence[Event], goals: Sequence[Goal]) -> None:
        """Continue a mission of an earlier operator, with its faults in force and its goals without an answer."""
        self._mission = mission
        self._in_force = [encode(event) for event in in_force]
        self._gate.know(mission)
        uavs = (entry.uav for entry in mission.roster)
        self._registration.claims.resume(dict(zip(uavs, mission.claimants, strict=False)))
        self.monitor, self._goals = MissionMonitor(mission), PendingGoals(mission)
        for goal in goals:
            self._goals.resume(goal, self.slot_now())
        self.teller = Storyteller(mission, max(1, self.slot_now()))

    def give_goal(self, uav: str, route: list[Point]) -> None:
        """Give a UAV a new route; `flush` sends it once a slot until the UAV answers."""
        assert self._goals is not None, "a goal is given in a mission"
        self._goals.give(uav, route, self.slot_now())
        self._send_goals(self._goals)

    def _send_goals(self, goals: PendingGoals) -> None:
        slot = self.slot_now()
        for answer in goals.given_up(slot):
            self.publish_event(EventKind.GOAL_UNANSWERED, msgspec.json.encode(answer).decode())
        for goal in goals.due(slot):
            key = self._keys.of(goal)
            seq = self._goal_seqs[key] = self._goal_seqs.get(key, -1) + 1
            said = msgspec.structs.replace(goal, instance=self._events.instance, seq=seq, sent_ns=self.clock.now_ns())
            self._say(key, encode(said), seq)

    def publish_event(self, kind: EventKind, detail: str = "") -> None:
        """Publish an event, for the swarm and the recording."""
        event = self._events.event(kind, detail, self.slot_now())
        payload = encode(event)
        if self.teller is not None:
            self.teller.hear(event)
        if is_in_force(event):
            self._in_force.append(payload)
        self._say(self._keys.event(OPERATOR), payload, event.seq)

    def close(self) -> None:
        """Publish the last sequence numbers; the recorder ends with this."""
        started = self._mission is not None and self._mission.instance == self._events.instance
        last = {self._keys.event(OPERATOR): self._events.last_seq, self._keys.mission: 0 if started else -1}
        known = {key: seq for key, seq in {**last, **self._goal_seqs}.items() if seq >= 0}
        self.publish_event(EventKind.CLOSED, msgspec.json.encode(known).decode())

    def flush(self) -> None:
        """Send the messages that waited for a router and goals without an answer; publish a jump of the wall clock."""
        if self._goals is not None:
            self._send_goals(self._goals)
        if self._mission is not None and (jump := self.clock.jump()) is not None:
            self.publish_event(EventKind.CLOCK_JUMP, jump)
        self._outbox.flush()

    def disconnect(self) -> None:
        """Leave the bus."""
        self._session.close()

    def slot_now(self) -> int:
        """Return the slot by the clock, -1 before the mission."""
        if self._mission is None:
            return -1
        return max(-1, (self.clock.now_ns() - self._mission.epoch_ns) // self._mission.slot_ns)

    @property
    def alive(self) -> set[str]:
        """Ids (UAVs, the recorder) with a liveliness token."""
        return {uav for uav, _ in self._tokens}

    @property
    def hosts(self) -> dict[str, str]:
        """Name of the host or container of each UAV that others fly, where they say it."""
        return self._registration.hosts

    @property
    def claimed(self) -> set[str]:
        """Ids that claimants hold."""
        return self._registration.claims.held

    def take(self, item: object) -> None:
        """Handle an item of the bus: a message, a liveliness token or a query."""
        match item:
            case Heard(key, payload):
                self._hear(key, payload)
            case Token():
                self._see(item)
            case zenoh.Query():
                if self._outbox.hear(item):
                    self._outbox.answer()
                else:
                    self._answer(item)

    def _see(self, token: Token) -> None:
        """Register a liveliness token that appeared or vanished."""
        if not token.alive:
            self._tokens.discard((token.uav, token.instance))
        elif len(self._tokens) < MAX_TOKENS:
            self._tokens.add((token.uav, token.instance))
        self._registration.see(token)

    def _say(self, key: str, payload: bytes, seq: int) -> None:
        self._outbox.put(key, payload, seq)
        self._outbox.flush()

    def _hear(self, key: str, payload: bytes) -> None:
        if self.monitor is None or self._goals is None:
            return
        message = self._gate.admit(Heard(key, payload))
        if message is not None and self.teller is not None:
            self.teller.hear(message)
        match message:
            case Fix() as fix:
                self.seen.hear_fix(fix)
                self.monitor.hear_fix(fix)
                self._goals.hear_fix(fix)
            case Command() as command:
                self.monitor.hear_command(command)
            case Report() as report:
                self.monitor.hear_report(report)
            case Event(kind=EventKind.CLOSED, source=source):
                self.seen.closed.add(source)
            case Event(kind=kind, source=source) if kind in ENDS_OF_FLIGHT:
                self.seen.landed.add(source)
            case Event(kind=EventKind.GROUND_COMMAND, source="ground") as event:
                if (order := order_in(event)) is not None:
                    self.ordered.append(order)
            case Event() as event:
                self._goals.hear_event(event)

    def _answer(self, query: zenoh.Query) -> None:
        """Answer a query: with the mission or the faults in force for a late UAV, with ids or orders for a claimant."""
        key = str(query.key_expr)
        if key == self._keys.event(OPERATOR):
            answers = self._in_force
        elif key == self._keys.mission and self._mission is not None:
            answers = [encode(self._mission)]
        else:
            answers = self._registration.answers(query)
        for payload in answers:
            query.reply(key, payload)
        query.drop()

    def _take(self, sample: zenoh.Sample) -> None:
        heard = heard_from(sample)
        self._inbox.put(heard, len(heard.payload))

    def _take_token(self, sample: zenoh.Sample) -> None:
        uav, instance = str(sample.key_expr).split("/")[-2:]
        self._inbox.put_always(Token(uav, instance, sample.kind == zenoh.SampleKind.PUT))


def is_in_force(event: Event) -> bool:
    """Return True for an operator's event that a UAV which starts later must receive too: a fault of UAVs' machines."""
    declaration = declaration_of(event.detail) if event.kind == EventKind.FAULT else None
    return declaration is not None and not issubclass(declaration.kind, ProcessFault)
