"""Subscriptions of a UAV, the gate that rejects false messages, and the postbox that applies the link model.

Callbacks only put bytes into the inbox; the loop decodes, drops and delays.
"""

from __future__ import annotations

import heapq
import time
from collections.abc import Callable, Set
from dataclasses import dataclass
from functools import partial
from itertools import count

import zenoh

from edc_swarm.emulation.links import DelayError, LinkEmulator
from edc_swarm.errors import MessageError
from edc_swarm.mission.clusters import cluster_of, of_cluster
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roles import OPERATOR
from edc_swarm.protocol.admission import Admission
from edc_swarm.protocol.codec import MAX_MESSAGE_BYTES, MAX_MISSION_BYTES, decode, limit_bytes
from edc_swarm.protocol.keys import Keys
from edc_swarm.protocol.messages import Command, Fix, Message, MissionMessage, Report
from processes.bus.session import ask_for, hand_over, subscribe
from processes.runtime.inbox import Inbox

MAX_POSTPONED = 100_000
MAX_COUNTED_KEYS = 1000
MAX_MEASURED = 100_000
"""Most postponed messages whose lateness is measured."""
_TOO_LARGE = {limit: bytes(limit + 1) for limit in (MAX_MESSAGE_BYTES, MAX_MISSION_BYTES)}
"""Replacement for every payload that is too large, by the limit, so that a flood of them fills no memory."""
MAX_QUERIES = 2
"""Most queries for liveliness tokens in a slot: a UAV's head and its duty may change once each."""
MAX_TOKENS = 40_000
"""Most liveliness tokens that are remembered: a few instances of every UAV of the largest mission."""


@dataclass(frozen=True, slots=True)
class Heard:
    """Key and bytes of a message from the bus."""

    key: str
    payload: bytes
    at_ns: int = 0
    """Time of arrival, on the monotonic clock."""


@dataclass(frozen=True, slots=True)
class Token:
    """A liveliness token that has appeared or vanished."""

    uav: str
    instance: str
    alive: bool


Item = Heard | Token | object


class UavSubscriptions:
    """Subscriptions of one UAV; samples and tokens go to `inbox`."""

    def __init__(self, session: zenoh.Session, keys: Keys, uav: str, inbox: Inbox[Item]) -> None:
        self._session = session
        self._keys = keys
        self._inbox = inbox
        self._fixes: list[zenoh.Subscriber[None]] = []
        self._mates: tuple[str, ...] = ("*",)
        self._near: dict[str, zenoh.Subscriber[None]] = {}
        for key in (keys.mission, keys.all_reports, keys.event(OPERATOR), keys.goal("*", uav)):
            self._subscribe(key)
        self._subscribe(keys.commands_to(uav), inbox.put_quietly)
        self._tokens: zenoh.Subscriber[None] | None = None
        self._watched = ""
        self._queries = (-1, 0)
        self._hears_truths = False

    @property
    def hears_fixes(self) -> bool:
        """True if the UAV subscribes to the fixes of all UAVs of its cluster."""
        return bool(self._fixes)

    @property
    def hears_swarm(self) -> bool:
        """True if messages of all UAVs come in: fixes, or truths for the emulated radio."""
        return self.hears_fixes or self._hears_truths

    def ask_for_mission(self) -> None:
        """Query the messages that a late joiner has missed: the mission, and the faults in force."""
        for key in (self._keys.mission, self._keys.event(OPERATOR)):
            ask_for(self._session, key, partial(self._take_sample, self._inbox.put))

    def join_cluster(self, mission: Mission, uav: str) -> None:
        """Let "all fixes" mean those of the UAV's own cluster."""
        own = of_cluster(mission, cluster_of(mission)[uav])
        if own is not mission:
            self._mates = tuple(entry.uav for entry in own.roster)

    def listen_to_fixes(self, wanted: bool, near: Set[str] = frozenset()) -> None:
        """Subscribe to the fixes of all UAVs of the cluster if `wanted`, and to those of the UAVs `near` of others."""
        if wanted and not self._fixes:
            self._fixes = [self._subscribe(self._keys.fix(mate), self._inbox.put_quietly) for mate in self._mates]
        elif not wanted and self._fixes:
            for fixes in self._fixes:
                fixes.undeclare()
            self._fixes = []
        for uav in self._near.keys() - near:
            self._near.pop(uav).undeclare()
        for uav in sorted(near - self._near.keys()):
            self._near[uav] = self._subscribe(self._keys.fix(uav), self._inbox.put_quietly)

    def watch(self, head: str, slot: int) -> bool:
        """Watch the liveliness tokens of all UAVs if this one hears all fixes, else of its head; return True if new.

        If everybody watched everybody, a swarm of K would deliver K^2 tokens at its start. Each change is a query at
        the router, so what changes more than `MAX_QUERIES` times in a slot waits for the next one: tokens are hints.
        """
        key = self._keys.all_alive if self.hears_fixes else self._keys.alive(head, "*") if head else ""
        made = self._queries[1] if self._queries[0] == slot else 0
        if key == self._watched or made == MAX_QUERIES:
            return False
        self._watched, self._queries = key, (slot, made + 1)
        if self._tokens is not None:
            self._tokens.undeclare()
        liveliness, take = self._session.liveliness(), hand_over(self._take_token)
        self._tokens = liveliness.declare_subscriber(key, take, history=True) if key else None
        return True

    def listen_to_truths(self) -> None:
        """Subscribe to the true positions of all UAVs: for the emulated radio, never for the agent."""
        self._subscribe(self._keys.all_truths)
        self._hears_truths = True

    def _subscribe(self, key: str, put: Callable[[Item, int], None] | None = None) -> zenoh.Subscriber[None]:
        return subscribe(self._session, key, partial(self._take_sample, put or self._inbox.put))

    def _take_sample(self, put: Callable[[Item, int], None], sample: zenoh.Sample) -> None:
        heard = heard_from(sample)
        put(heard, len(heard.payload))

    def _take_token(self, sample: zenoh.Sample) -> None:
        uav, instance = str(sample.key_expr).split("/")[-2:]
        self._inbox.put(Token(uav, instance, sample.kind == zenoh.SampleKind.PUT))


class Malformed:
    """Counter of malformed messages by key, which selects those that are worth an event.

    These are the first, second, fourth, eighth ... (2^n) of a key: a flood of garbage makes no flood
    of events.
    """

    def __init__(self) -> None:
        self._counts: dict[str, int] = {}

    def count(self, error: MessageError) -> str | None:
        """Count a malformed message; return the detail of an event if it is worth one, else None."""
        key = error.key if error.key in self._counts or len(self._counts) < MAX_COUNTED_KEYS else "others"
        number = self._counts[key] = self._counts.get(key, 0) + 1
        return f"{number} on {key[:200]}: {error.reason[:200]}" if number & (number - 1) == 0 else None


class Gate:
    """Filter that admits a message if it decodes and, once the mission is known, can be true in it.

    It calls `tell` with a detail for the rejected messages that `Malformed` selects.
    """

    def __init__(self, tell: Callable[[str], None]) -> None:
        self._tell = tell
        self._malformed = Malformed()
        self._admission: Admission | None = None

    def know(self, mission: MissionMessage) -> None:
        """Judge messages by this mission from now on; a second mission never replaces the first."""
        if self._admission is None:
            self._admission = Admission(mission)

    def admit(self, heard: Heard) -> Message | None:
        """Return the message in `heard`, or None if it is rejected."""
        try:
            message = decode(heard.key, heard.payload)
            if self._admission is not None:
                self._admission.check(heard.key, message)
        except MessageError as error:
            detail = self._malformed.count(error)
            if detail is not None:
                self._tell(detail)
            return None
        return message


class Postbox:
    """Received messages of the swarm, which the link model drops, delivers now or delivers later."""

    def __init__(self, links: LinkEmulator) -> None:
        self.links = links
        self._later: list[tuple[int, int, Message, int]] = []
        self._order = count()
        self._late_ns: list[int] = []

    def arrive(self, message: Message, now_ns: int, at_s: float, size_bytes: int = 0) -> bool:
        """Take in a message of the swarm that came at `now_ns`, mission time `at_s`; return True to deliver it now."""
        at_once, sender = False, sender_of(message)
        for delay_ns in self.links.arrivals_ns(sender, at_s, size_bytes):
            if delay_ns == 0 and not at_once:
                at_once = True
                self.links.log.arrive(sender, 0)
            elif len(self._later) < MAX_POSTPONED:
                heapq.heappush(self._later, (now_ns + delay_ns, next(self._order), message, now_ns))
        return at_once

    @property
    def next_ns(self) -> int | None:
        """Time of the next postponed message, None if there is none."""
        return self._later[0][0] if self._later else None

    def take_due(self, now_ns: int) -> Message | None:
        """Return one postponed message that is due, None if there is none."""
        if not self._later or self._later[0][0] > now_ns:
            return None
        due_ns, _, message, came_ns = heapq.heappop(self._later)
        self.links.log.arrive(sender_of(message), now_ns - came_ns)
        if len(self._late_ns) < MAX_MEASURED:
            self._late_ns.append(now_ns - due_ns)
        return message

    @property
    def delay_error(self) -> DelayError | None:
        """Lateness of the postponed messages at their delivery; None if there were none."""
        if not self._late_ns:
            return None
        late_ms = [late_ns / 1e6 for late_ns in sorted(self._late_ns)]
        at = [late_ms[round(share * (len(late_ms) - 1))] for share in (0.5, 0.99, 1.0)]
        return DelayError(len(late_ms), *at)


def sender_of(message: Message) -> str:
    """Return the id of the UAV that sent a message of the swarm, "" for any other message."""
    match message:
        case Fix():
            return message.uav
        case Command() | Report():
            return message.head
        case _:
            return ""


def heard_from(sample: zenoh.Sample) -> Heard:
    """Return key and bytes of a sample; a fixed payload that the codec rejects replaces one that is too large."""
    key, size_bytes = str(sample.key_expr), len(sample.payload)
    fits = size_bytes <= MAX_MESSAGE_BYTES or size_bytes <= limit_bytes(key)
    return Heard(key, sample.payload.to_bytes() if fits else _TOO_LARGE[limit_bytes(key)], time.monotonic_ns())
