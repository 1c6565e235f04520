"""The simulated bus: it records every message, and hands it to the computers that subscribe to it, as the links say."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Protocol

import msgspec

from edc_swarm.agent.node import NodeEvent, PeerGone, Received
from edc_swarm.emulation.links import LinkEmulator, have_queues, have_range
from edc_swarm.mission.clusters import cluster_of
from edc_swarm.mission.faults import ChangeLink, parse_faults
from edc_swarm.mission.field_types import Point
from edc_swarm.mission.roles import OPERATOR
from edc_swarm.protocol.codec import encode
from edc_swarm.protocol.completion import MissionMonitor
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.goals import PendingGoals
from edc_swarm.protocol.keys import Keys
from edc_swarm.protocol.messages import Command, Event, Fix, Message, MissionMessage, Report, Truth
from edc_swarm.simulation.schedule import Schedule

TRANSIT_NS = 500_000
"""Time that the transport takes for a message when the link model adds nothing."""

GOAL_NS = 1_000_000
"""Time after the start of a slot at which the operator repeats goals: the fixes of the slot are out."""

Recorder = Callable[[str, Message, int], None]
"""Takes the key, the message and the time at which it was published."""


class Port(Protocol):
    """A computer as the bus sees it."""

    @property
    def uav(self) -> str:
        """Id of its UAV."""

    @property
    def links(self) -> LinkEmulator:
        """The links into it."""

    @property
    def process(self) -> object:
        """Its process, None if that is dead."""

    @property
    def subscribes_to_fixes(self) -> bool:
        """True if its process receives every fix."""

    def step(self, event: NodeEvent) -> None:
        """Hand an event to its process."""


class Network:
    """The bus, its router, and the operator that speaks on it.

    Attributes
    ----------
    monitor
        Progress of the mission, as the operator follows it.
    router_up_at_ns
        Time from which the router passes messages on.
    """

    def __init__(self, mission: MissionMessage, schedule: Schedule, record: Recorder) -> None:
        self._mission = mission
        self._schedule = schedule
        self._record = record
        self._keys = Keys(mission.name)
        self._have_range = have_range(mission)
        self._have_queues = have_queues(mission)
        self._have_rules = bool(mission.link) or any(isinstance(fault, ChangeLink) for fault in parse_faults(mission))
        self._ports: Mapping[str, Port] = {}
        self._cluster = cluster_of(mission)
        self._mates: dict[str, list[Port]] = {}
        self._near: dict[str, frozenset[str]] = {}
        self._listeners: dict[str, dict[str, Port]] = defaultdict(dict)
        self._operator_seq = 0
        self.monitor = MissionMonitor(mission)
        self._pending_goals = PendingGoals(mission)
        self._goal_seqs: dict[str, int] = {}
        self.router_up_at_ns = 0

    def connect(self, ports: Mapping[str, Port]) -> None:
        """Connect the computers, by id."""
        self._ports = ports
        mates: dict[str, list[Port]] = defaultdict(list)
        for port in ports.values():
            mates[self._cluster[port.uav]].append(port)
        self._mates = dict(mates)

    def listen(self, port: Port, near: frozenset[str]) -> None:
        """Let a computer hear the fixes of UAVs of other clusters, and the reports of their clusters; no others."""
        before, self._near[port.uav] = self._near.get(port.uav, frozenset()), near
        for uav in before - near:
            del self._listeners[uav][port.uav]
        for uav in near - before:
            self._listeners[uav][port.uav] = port

    @property
    def router_up(self) -> bool:
        """True if the router passes messages on."""
        return self._schedule.now_ns >= self.router_up_at_ns

    def publish(self, sender: str, message: Message) -> None:
        """Record the message of a UAV and send it to its receivers."""
        self._record(self._keys.of(message), message, self._schedule.now_ns)
        match message:
            case Fix():
                self.monitor.hear_fix(message)
                self._pending_goals.hear_fix(message)
                mates = [port for port in self._mates_of(sender) if port.subscribes_to_fixes]
                self._send(sender, message, [*mates, *_by_id(self._listeners.get(sender, {}))])
            case Command():
                self.monitor.hear_command(message)
                self._send(sender, message, [self._ports[message.uav]])
            case Report():
                self.monitor.hear_report(message)
                mates = self._mates_of(sender)
                others = {uav: port for mate in mates for uav, port in self._listeners.get(mate.uav, {}).items()}
                self._send(sender, message, [*mates, *_by_id(others)])
            case Event():
                self._pending_goals.hear_event(message)
            case Truth() if self._have_range:
                for port in self._ports.values():
                    port.links.place(message.uav, message.to_x_m, message.to_y_m)
            case _:
                pass

    def publish_mission(self, message: MissionMessage) -> None:
        """Record the mission message."""
        self._record(self._keys.mission, message, self._schedule.now_ns)

    def publish_event(self, kind: EventKind, detail: str) -> None:
        """Record an event of the operator."""
        event = Event(
            source=OPERATOR,
            instance=OPERATOR,
            seq=self._operator_seq,
            sent_ns=self._schedule.now_ns,
            slot=self._schedule.slot,
            kind=kind,
            detail=detail,
        )
        self._operator_seq += 1
        self._record(self._keys.of(event), event, self._schedule.now_ns)

    def give_goal(self, uav: str, route: list[Point]) -> None:
        """Send the operator's goal to a UAV, again in every slot until it answers."""
        self._pending_goals.give(uav, route, self._schedule.slot)
        self._send_goals()

    def _send_goals(self) -> None:
        slot = self._schedule.slot
        for answer in self._pending_goals.given_up(slot):
            self.publish_event(EventKind.GOAL_UNANSWERED, msgspec.json.encode(answer).decode())
        for goal in self._pending_goals.due(slot):
            key = self._keys.of(goal)
            self._goal_seqs[key] = seq = self._goal_seqs.get(key, -1) + 1
            sent_ns = self._schedule.now_ns
            said = msgspec.structs.replace(goal, instance=OPERATOR, seq=seq, sent_ns=sent_ns)
            self._record(key, said, sent_ns)
            port = self._ports[goal.uav]
            if self.router_up and port.process is not None:
                self._schedule.at(sent_ns + TRANSIT_NS, partial(port.step, Received(said)))
        if self._pending_goals.waits:
            self._schedule.at(self._schedule.ns_of((slot + 1) * self._mission.dt_s) + GOAL_NS, self._send_goals)

    @property
    def last_seqs(self) -> dict[str, int]:
        """The operator's last sequence numbers by key, the event that says them included."""
        return {self._keys.mission: 0, self._keys.event(OPERATOR): self._operator_seq, **self._goal_seqs}

    def announce_end(self, gone: Port) -> None:
        """Tell every peer that hears it that the liveliness token of `gone` has vanished, unless the router is down."""
        for port in self._mates_of(gone.uav):
            if port is not gone and self.router_up and not port.links.is_cut(gone.uav, self._schedule.mission_s):
                port.step(PeerGone(gone.uav))

    def _mates_of(self, uav: str) -> list[Port]:
        """Return the computers of a UAV's cluster."""
        return self._mates[self._cluster[uav]]

    def _send(self, sender: str, message: Message, receivers: Iterable[Port]) -> None:
        if not self.router_up:
            return
        event, at_s = Received(message), self._schedule.mission_s
        size_bytes = len(encode(message)) if self._have_queues else 0
        arrivals: dict[int, list[Port]] = {}
        for receiver in receivers:
            if receiver.uav == sender or receiver.process is None:
                continue
            links = receiver.links
            for delay_ns in (0,) if links.is_plain else links.arrivals_ns(sender, at_s, size_bytes):
                if self._have_rules:
                    links.log.arrive(sender, delay_ns)
                arrivals.setdefault(delay_ns, []).append(receiver)
        for delay_ns, there in arrivals.items():
            self._schedule.at(self._schedule.now_ns + TRANSIT_NS + delay_ns, partial(_deliver, event, there))


def _deliver(event: Received, receivers: Sequence[Port]) -> None:
    """Hand a message to those that it reaches at one time: one action for all costs less than one for each."""
    for receiver in receivers:
        receiver.step(event)


def _by_id(ports: Mapping[str, Port]) -> list[Port]:
    """Return computers in an order that does not depend on when they began to listen."""
    return [ports[uav] for uav in sorted(ports)]
