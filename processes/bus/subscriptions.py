"""A UAV's ears: what it subscribes to, and what of it gets through its links.

Callbacks only hand bytes over to the inbox; decoding, loss and delay happen in the loop.
"""

from __future__ import annotations

import heapq
import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import count

import zenoh

from edc_swarm.emulation.links import DelayError, LinkEmulator
from edc_swarm.errors import MessageError
from edc_swarm.mission.configuration import OPERATOR
from edc_swarm.protocol.admission import Admission
from edc_swarm.protocol.codec import MAX_MESSAGE_BYTES, decode
from edc_swarm.protocol.keys import Keys
from edc_swarm.protocol.messages import Command, Fix, Message, MissionMessage, Report
from processes.bus.session import hand_over
from processes.runtime.inbox import Inbox

MAX_POSTPONED = 100_000
MAX_COUNTED_KEYS = 1000
MAX_MEASURED = 100_000
"""Postponed messages whose lateness is kept."""
_TOO_LARGE = bytes(MAX_MESSAGE_BYTES + 1)
"""Stands for every payload that is too large, so that a flood of them fills no memory."""
MAX_TOKENS = 10_000
"""Liveliness tokens that are remembered: a few lives of every UAV of the largest mission."""


@dataclass(frozen=True, slots=True)
class Heard:
    """Bytes from the bus."""

    key: str
    payload: bytes
    at_ns: int = 0
    """When, on the monotonic clock."""


@dataclass(frozen=True, slots=True)
class Token:
    """A liveliness token has appeared or vanished."""

    uav: str
    instance: str
    alive: bool


Item = Heard | Token | object


class Ears:
    """Subscriptions of one UAV. Samples and tokens go to `inbox`."""

    def __init__(self, session: zenoh.Session, keys: Keys, uav: str, inbox: Inbox[Item]) -> None:
        self._session = session
        self._keys = keys
        self._inbox = inbox
        self._fixes: zenoh.Subscriber[None] | None = None
        for key in (keys.mission, keys.commands_to(uav), keys.all_reports, keys.event(OPERATOR)):
            self._subscribe(key)
        session.liveliness().declare_subscriber(keys.all_alive, hand_over(self._take_token), history=True)

    @property
    def hears_fixes(self) -> bool:
        """Whether it hears every UAV's fixes."""
        return self._fixes is not None

    def ask_for_mission(self) -> None:
        """Ask for what a late joiner has missed: the mission, and the faults in force."""
        for key in (self._keys.mission, self._keys.event(OPERATOR)):
            self._session.get(key, hand_over(self._take_reply), consolidation=zenoh.ConsolidationMode.NONE)

    def listen_to_fixes(self, wanted: bool) -> None:
        """Subscribe to every UAV's fixes, or no longer."""
        if wanted and self._fixes is None:
            self._fixes = self._subscribe(self._keys.all_fixes)
        elif not wanted and self._fixes is not None:
            self._fixes.undeclare()
            self._fixes = None

    def listen_to_truths(self) -> None:
        """Hear where every UAV truly is: for the emulated radio, never for the agent."""
        self._subscribe(self._keys.all_truths)

    def _subscribe(self, key: str) -> zenoh.Subscriber[None]:
        handler = hand_over(self._take_sample)
        return self._session.declare_subscriber(key, handler, allowed_origin=zenoh.Locality.REMOTE)

    def _take_sample(self, sample: zenoh.Sample) -> None:
        heard = heard_from(sample)
        self._inbox.put(heard, len(heard.payload))

    def _take_reply(self, reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            self._take_sample(reply.ok)

    def _take_token(self, sample: zenoh.Sample) -> None:
        uav, instance = str(sample.key_expr).split("/")[-2:]
        self._inbox.put(Token(uav, instance, sample.kind == zenoh.SampleKind.PUT))


class Malformed:
    """Counts bytes that are no message, by key, and says when that is worth telling.

    Told are the first, second, fourth, eighth ... of a key: a flood of garbage makes no flood of
    events.
    """

    def __init__(self) -> None:
        self._counts: dict[str, int] = {}

    def count(self, error: MessageError) -> str | None:
        """Count one, and return what to tell about it, if anything."""
        key = error.key if error.key in self._counts or len(self._counts) < MAX_COUNTED_KEYS else "others"
        number = self._counts[key] = self._counts.get(key, 0) + 1
        return f"{number} on {key[:200]}: {error.reason[:200]}" if number & (number - 1) == 0 else None


class Gate:
    """Lets in messages that decode and, once the mission is known, that can be true in it.

    `tell` is told, now and then, of what is refused.
    """

    def __init__(self, tell: Callable[[str], None]) -> None:
        self._tell = tell
        self._malformed = Malformed()
        self._admission: Admission | None = None

    def know(self, mission: MissionMessage) -> None:
        """Judge by this mission from now on; it is never replaced by another."""
        if self._admission is None:
            self._admission = Admission(mission)

    def admit(self, heard: Heard) -> Message | None:
        """The message in `heard`, or None where there is none to be believed."""
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
    """Messages that the link model lets through now or later."""

    def __init__(self, links: LinkEmulator) -> None:
        self.links = links
        self._later: list[tuple[int, int, Message]] = []
        self._order = count()
        self._late_ns: list[int] = []

    def arrive(self, message: Message, now_ns: int, at_s: float) -> bool:
        """Take in a swarm message that came at `now_ns`, mission time `at_s`; whether it has no delay at all."""
        at_once = False
        for delay_ns in self.links.arrivals_ns(sender_of(message), at_s):
            if delay_ns == 0 and not at_once:
                at_once = True
            elif len(self._later) < MAX_POSTPONED:
                heapq.heappush(self._later, (now_ns + delay_ns, next(self._order), message))
        return at_once

    @property
    def next_ns(self) -> int | None:
        """When the next postponed message is due."""
        return self._later[0][0] if self._later else None

    def take_due(self, now_ns: int) -> Message | None:
        """Hand out one postponed message that is due."""
        if not self._later or self._later[0][0] > now_ns:
            return None
        due_ns, _, message = heapq.heappop(self._later)
        if len(self._late_ns) < MAX_MEASURED:
            self._late_ns.append(now_ns - due_ns)
        return message

    @property
    def delay_error(self) -> DelayError | None:
        """How late postponed messages were handed out; None where there were none."""
        if not self._late_ns:
            return None
        late_ms = [late_ns / 1e6 for late_ns in sorted(self._late_ns)]
        at = [late_ms[round(share * (len(late_ms) - 1))] for share in (0.5, 0.99, 1.0)]
        return DelayError(len(late_ms), *at)


def sender_of(message: Message) -> str:
    """Id of the UAV that sent a swarm message, "" for all others."""
    match message:
        case Fix():
            return message.uav
        case Command() | Report():
            return message.head
        case _:
            return ""


def heard_from(sample: zenoh.Sample) -> Heard:
    """The bytes of a sample; in place of a payload that is too large, one that the codec refuses as too large."""
    fits = len(sample.payload) <= MAX_MESSAGE_BYTES
    return Heard(str(sample.key_expr), sample.payload.to_bytes() if fits else _TOO_LARGE, time.monotonic_ns())
