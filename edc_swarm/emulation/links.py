"""Emulated network: loss, delay and duplication on each directed link, seeded and without a clock.

The model runs in the receiving agent, above the real transport: the same object delays and drops
messages in the simulator and in the processes. The recorder is an observer outside it. Radio range is
about true positions, the emulator's ground truth, which the agents never see (`LinkEmulator.place`).

Gilbert-Elliott bursts follow E. N. Gilbert, "Capacity of a Burst-Noise Channel", Bell Syst. Tech. J.
39(5), 1960, and E. O. Elliott, "Estimates of Error Rates for Codes on Burst-Noise Channels", ibid.
42(5), 1963. `fading` has loss over distance, `channel` queues, `playback` measured networks.

A message first leaves the queue of its channel, if its rule has one. Then it may be lost, and its delays begin.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from random import Random
from typing import Protocol

from msgspec import Struct

from edc_swarm.emulation.channel import Channel, OpportunityChannel, RateChannel
from edc_swarm.emulation.delay_log import DelayLog
from edc_swarm.emulation.fading import RayleighGain, fading_loss, is_faded
from edc_swarm.emulation.playback import Playback
from edc_swarm.mission.configuration import NS_PER_S, Mission
from edc_swarm.mission.faults import ChangeLink, parse_faults
from edc_swarm.mission.field_types import MAX_FAULTS, MAX_LINKS
from edc_swarm.mission.link import Link
from edc_swarm.mission.plug_ins import called, made, number
from edc_swarm.mission.trace import Trace, unpack
from edc_swarm.mission.trace_schedule import Schedule

NS_PER_US = 1_000
NS_PER_MS = 1_000_000
ANYONE = "*"
MOST_MS = 1e9
"""Longest delay of a link model of the user, in milliseconds."""
CLIPPED_AT = 3.0
"""Limit of a normal jitter, in standard deviations."""

MAX_CHANGES = MAX_LINKS + MAX_FAULTS
"""Most changes to keep: as many as a mission's links and faults together."""

REORDER_SLOTS = 3
"""Longest additional delay of a reordered message, in slots, so that later messages overtake it."""


class DelayError(Struct, frozen=True):
    """Delay of a process beyond this model's delays when it delivered messages, in milliseconds."""

    messages: int
    p50_ms: float
    p99_ms: float
    max_ms: float


@dataclass(frozen=True, slots=True)
class Cut:
    """A partition: while it lasts no message passes from `senders` to `receivers`.

    Times are mission seconds; `end_s` is infinite for a partition that lasts until a fault heals it.
    """

    senders: frozenset[str]
    receivers: frozenset[str]
    start_s: float
    end_s: float = math.inf

    def blocks(self, sender: str, receiver: str, at_s: float) -> bool:
        """Return True if this partition blocks a message sent at mission time `at_s`."""
        return self.start_s <= at_s < self.end_s and sender in self.senders and receiver in self.receivers


@dataclass(frozen=True, slots=True)
class Passage:
    """A message on its way, as a link model of the user sees it.

    `wall_ms` is the wall time since the mission's epoch, `distance_m` that of the true positions where a link of the
    mission has a radio range, else that of the starts; `size_bytes` the size of the message.
    """

    sender: str
    receiver: str
    wall_ms: float
    size_bytes: int
    distance_m: float


class LinkModel(Protocol):
    """A link model of the user, made as `Class(link, random)` for each directed link."""

    def delay_ms(self, message: Passage) -> float | None:
        """Return the delay of a message in milliseconds of wall time, None if it is lost."""


class LinkEmulator:
    """All links into one receiver.

    Parameters
    ----------
    mission
        `link` has the rules (the last one that matches sender, receiver and time applies), `seed`
        the random streams: one generator per directed link.
    receiver
        Id of the UAV that receives.

    Attributes
    ----------
    receiver
        As given.
    log
        What the links did to messages; whoever delivers a message enters it.
    """

    def __init__(self, mission: Mission, receiver: str) -> None:
        self._seed = mission.seed
        self.receiver = receiver
        self._slot_ns = mission.slot_ns
        self.log = DelayLog()
        self._ns_per_s = NS_PER_S / mission.time_scale
        self._rules = [rule for rule in mission.link if rule.receiver in {ANYONE, receiver}]
        self._traces = {trace.name: trace for trace in mission.trace}
        self._cuts: list[Cut] = []
        self._random: dict[str, Random] = {}
        self._in_burst: dict[str, bool] = {}
        self._gains: dict[str, RayleighGain] = {}
        self._playbacks: dict[tuple[int, str], Playback] = {}
        self._own: dict[tuple[int, str], LinkModel] = {}
        self._channels: dict[int, Channel] = {}
        self._roster = mission.roster

    @cached_property
    def _place_m(self) -> dict[str, tuple[float, float]]:
        return {entry.uav: (entry.start_x_m, entry.start_y_m) for entry in self._roster}

    @property
    def is_plain(self) -> bool:
        """True if every message arrives at once: no rule and no partition is about a link into this receiver."""
        return not (self._rules or self._cuts)

    @property
    def has_rules(self) -> bool:
        """True if a rule is about a link into this receiver: then its log says something."""
        return bool(self._rules)

    def place(self, uav: str, x_m: float, y_m: float) -> None:
        """Set the true position of `uav`, for links with a radio range; before the first call it is the start."""
        self._place_m[uav] = (x_m, y_m)

    def add_rule(self, rule: Link) -> None:
        """Apply `rule` from now on to every link that it matches (a fault)."""
        if rule.receiver in {ANYONE, self.receiver} and len(self._rules) < MAX_CHANGES:
            self._rules.append(rule)

    def add_cut(self, cut: Cut) -> None:
        """Apply a partition (a fault)."""
        if self.receiver in cut.receivers and len(self._cuts) < MAX_CHANGES:
            self._cuts.append(cut)

    def heal(self) -> None:
        """End every partition."""
        self._cuts.clear()

    def is_cut(self, sender: str, at_s: float) -> bool:
        """Return True if a partition separates `sender` from this receiver at mission time `at_s`."""
        return any(cut.blocks(sender, self.receiver, at_s) for cut in self._cuts)

    def arrivals_ns(self, sender: str, at_s: float, size_bytes: int = 0) -> list[int]:
        """Return the delays of a message sent at `at_s`: none if it is lost, two if it is duplicated.

        Delays are wall nanoseconds, in addition to the delay of the real transport. Only queues take the size of the
        message into account (`have_queues`).
        """
        delays_ns = [] if self._cuts and self.is_cut(sender, at_s) else self._passed_ns(sender, at_s, size_bytes)
        if not delays_ns:
            self.log.lose(sender)
        return delays_ns

    def _passed_ns(self, sender: str, at_s: float, size_bytes: int) -> list[int]:
        """Return the delays of a message that no partition holds up."""
        rule = self._rule(sender, at_s)
        if rule is None:
            return [0]
        random = self._random.setdefault(sender, Random(f"{self._seed}/{sender}>{self.receiver}/link"))
        wall_ns = round(at_s * self._ns_per_s)
        waited_ns = self._waited_ns(rule, wall_ns, size_bytes)
        if waited_ns is None or self._lost(rule, sender, wall_ns, random):
            return []
        measured_ns = self._measured_ns(rule, sender, wall_ns + waited_ns)
        if measured_ns is None:
            return []
        own_ns = self._own_ns(rule, sender, wall_ns, size_bytes) if rule.model else 0
        if own_ns is None:
            return []
        copies = 2 if rule.duplicate and random.random() < rule.duplicate else 1
        return [waited_ns + measured_ns + own_ns + self._delay_ns(rule, random) for _ in range(copies)]

    def _rule(self, sender: str, at_s: float) -> Link | None:
        for rule in reversed(self._rules):
            if rule.sender in {ANYONE, sender} and rule.start_s <= at_s < rule.end_s:
                return rule
        return None

    def _waited_ns(self, rule: Link, wall_ns: int, size_bytes: int) -> int | None:
        """Return how long a message waits in the queue of its rule; None if the queue drops it."""
        trace = self._traces.get(rule.trace)
        opportune = trace is not None and trace.kind == "opportunities"
        if not opportune and not rule.rate_kbps:
            return 0
        channel = self._channels.get(id(rule))
        if channel is None:
            channel = self._channels[id(rule)] = self._channel(rule, trace if opportune else None)
        return channel.wait_ns(wall_ns, size_bytes)

    def _channel(self, rule: Link, trace: Trace | None) -> Channel:
        if trace is None:
            return RateChannel(rule.queue_bytes, rule.rate_kbps)
        schedule = Schedule.of(unpack(trace), rule, self._seed, self.receiver)
        return OpportunityChannel(rule.queue_bytes, schedule)

    def _measured_ns(self, rule: Link, sender: str, wall_ns: int) -> int | None:
        """Return the delay that a measured network adds; None if it loses the message."""
        trace = self._traces.get(rule.trace)
        if trace is None or trace.kind != "delays":
            return 0
        playback = self._playbacks.get((id(rule), sender))
        if playback is None:
            playback = Playback(Schedule.of(unpack(trace), rule, self._seed, sender))
            self._playbacks[id(rule), sender] = playback
        delay_us = playback.delay_us(wall_ns // NS_PER_US)
        return None if delay_us is None else delay_us * NS_PER_US

    def _own_ns(self, rule: Link, sender: str, wall_ns: int, size_bytes: int) -> int | None:
        """Return the delay that a link model of the user adds; None if it loses the message."""
        key, name = (id(rule), sender), rule.model
        if key not in self._own:
            stream = Random(f"{self._seed}/{sender}>{self.receiver}/{name}")
            self._own[key] = made("link.model", name, "delay_ms", rule, stream)
        near = {sender, self.receiver} <= self._place_m.keys()
        distance_m = self._distance_m(sender) if near else 0.0
        message = Passage(sender, self.receiver, wall_ns / NS_PER_MS, size_bytes, distance_m)
        delay_ms = called("link.model", name, lambda: self._own[key].delay_ms(message))
        if delay_ms is None:
            return None
        return round(max(0.0, min(number("link.model", name, delay_ms), MOST_MS)) * NS_PER_MS)

    def _lost(self, rule: Link, sender: str, wall_ns: int, random: Random) -> bool:
        if rule.fading == "rayleigh":
            return self._faded(rule, sender, wall_ns)
        burst = self._in_burst.get(sender, False)
        if rule.burst_enter:
            change = rule.burst_leave if burst else rule.burst_enter
            burst = burst != (random.random() < change)
            self._in_burst[sender] = burst
        loss = rule.burst_loss if burst and rule.burst_enter else rule.loss
        if loss and random.random() < loss:
            return True
        return rule.range_m > 0 and random.random() < fading_loss(self._distance_m(sender), rule)

    def _faded(self, rule: Link, sender: str, wall_ns: int) -> bool:
        """Return True if the gain is too low: below the thresholds of `loss` and of the distance together."""
        if sender not in self._gains:
            self._gains[sender] = RayleighGain(Random(f"{self._seed}/{sender}>{self.receiver}/fading"))
        power = self._gains[sender].power(wall_ns / NS_PER_MS, rule.coherence_ms)
        far = fading_loss(self._distance_m(sender), rule) if rule.range_m else 0.0
        return is_faded(power, 1.0 - (1.0 - rule.loss) * (1.0 - far))

    def _distance_m(self, sender: str) -> float:
        return math.dist(self._place_m[sender], self._place_m[self.receiver])

    def _delay_ns(self, rule: Link, random: Random) -> int:
        delay_ns = (rule.delay_ms + _jitter_ms(rule, random)) * NS_PER_MS
        if rule.reorder and random.random() < rule.reorder:
            delay_ns += random.random() * REORDER_SLOTS * self._slot_ns
        return round(delay_ns)


def have_queues(mission: Mission) -> bool:
    """Return True if a link of the mission has a queue: then the sizes of messages matter."""
    opportunities = {trace.name for trace in mission.trace if trace.kind == "opportunities"}
    return any(rule.rate_kbps > 0 or rule.model or rule.trace in opportunities for rule in mission.link)


def have_range(mission: Mission) -> bool:
    """Return True if a link of the mission has a radio range, at first or by a fault: then true positions matter."""
    by_fault = (fault.rule() for fault in parse_faults(mission) if isinstance(fault, ChangeLink))
    return any(rule.range_m > 0 for rule in (*mission.link, *by_fault))


def _jitter_ms(rule: Link, random: Random) -> float:
    jitter_ms = rule.jitter_ms
    if not jitter_ms:
        return 0.0
    match rule.distribution:
        case "constant":
            return 0.0
        case "uniform":
            return random.uniform(0.0, jitter_ms)
        case "normal":
            return min(abs(random.gauss(0.0, jitter_ms)), CLIPPED_AT * jitter_ms)
        case "lognormal":
            return 0.5 * jitter_ms * random.lognormvariate(0.0, 1.0)


def cut_pair(left: Collection[str], right: Collection[str], start_s: float, end_s: float, one_way: bool) -> list[Cut]:
    """Return the cuts that separate `left` from `right`; one way, only messages from `left` are cut off."""
    forth = Cut(frozenset(left), frozenset(right), start_s, end_s)
    back = Cut(frozenset(right), frozenset(left), start_s, end_s)
    return [forth] if one_way else [forth, back]


def mission_s(mission_ns: int, time_scale: float) -> float:
    """Return the mission seconds of a wall duration since the epoch."""
    return mission_ns / NS_PER_S * time_scale
