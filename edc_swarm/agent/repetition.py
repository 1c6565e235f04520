"""Repetition of messages within their slot, as often as the measured loss asks for.

A central head pays for loss twice: a UAV flies in a slot only if its fix reaches the head and the command reaches the
UAV. So a UAV repeats its fixes, and a head its commands, its reports while UAVs are unheard, and its claims.

- *Measured*: each receiver counts, by the sequence numbers, what it misses of each sender (`Hearing`). Head and UAV
  tell each other (`missed` in commands and fixes), so a link that loses one way only is known at both ends.
- *As often as needed*: so often that all copies are lost with a probability of at most `MISS`, within the mission's
  `resends`. Where nothing is missed nothing is repeated, and the messages are those of a mission without repetition.
- *Silence is loss*: a UAV that no command has reached for `lease_slots` + `SILENCE_SLOTS` slots cannot know how many
  of its fixes arrive. It sends 2, 4, 8 ... copies, slot by slot. Without that a swarm that has no head, and so hears
  nothing, would never elect one on a network that loses most messages.
- *In time*: copies are spread over the time that is left: those of fixes until the head plans, those of commands
  until their slot begins. When a slot begins all copies of the last one are dropped.
- *Acknowledged*: a fix that is repeated after the command has come says so (`next_slot`); the command then needs no
  further copy, and the fix neither.

A copy is the message itself with a new sequence number: it says nothing new, so it is a duplicate, which a network may
make as well. No rule of ARCHITECTURE.md depends on the number of copies.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import msgspec
from msgspec import UNSET

from edc_swarm.agent.slot_clock import SlotClock
from edc_swarm.protocol.messages import Command, Fix, Message, MissionMessage, Report

MISS = 0.02
"""Probability, with all its copies, that a message is lost."""
SILENCE_SLOTS = 2
"""Slots without a command, beyond the lease, after which a UAV takes silence for loss."""
WINDOW = 64
"""Newest sequence numbers of a stream that count."""
MOST_MISSED = 16
"""Most numbers that one gap counts: an outage that is over says little about the next message."""
WORST_LOSS = 0.99
"""Greatest loss that is reckoned with."""
FIX_SHARE = 0.9
"""Share of `tau_s` in which fixes are repeated, and of the time left in which commands are."""
_ALL = (1 << WINDOW) - 1


def repeats(loss: float, most: int) -> int:
    """Return how often a message is sent again, so that all copies are lost with a probability of at most `MISS`."""
    if loss <= MISS:
        return 0
    return min(math.ceil(math.log(MISS) / math.log(min(loss, WORST_LOSS))) - 1, most)


@dataclass(slots=True)
class Stream:
    """The newest sequence numbers of one publisher on one key, as bits: 1 for a number that came."""

    instance: str
    last: int
    bits: int = 1
    width: int = 1

    def hear(self, seq: int) -> None:
        """Count a number: the next one, one after a gap, or one that comes late or twice."""
        ahead = seq - self.last
        if ahead > 0:
            steps = min(ahead, MOST_MISSED + 1)
            self.bits = (self.bits << steps | 1) & _ALL
            self.width = min(self.width + steps, WINDOW)
            self.last = seq
        elif -ahead < self.width:
            self.bits |= 1 << -ahead


class Hearing:
    """What one UAV hears of the others, and what it misses."""

    def __init__(self) -> None:
        self._streams: dict[str, dict[type[Message], Stream]] = {}

    def hear(self, message: Fix | Command | Report) -> None:
        """Count a message; a publisher's new process begins anew."""
        sender = message.uav if isinstance(message, Fix) else message.head
        streams = self._streams.setdefault(sender, {})
        stream = streams.get(type(message))
        if stream is None or stream.instance != message.instance:
            streams[type(message)] = Stream(message.instance, message.seq)
        else:
            stream.hear(message.seq)

    def forget_fixes(self) -> None:
        """Begin anew with fixes: this UAV did not listen to them until now."""
        for streams in self._streams.values():
            streams.pop(Fix, None)

    def loss(self, senders: Iterable[str]) -> float:
        """Return the share of the newest messages of these UAVs that did not come, 0 if none is known."""
        streams = [stream for sender in senders for stream in self._streams.get(sender, {}).values()]
        width = sum(stream.width for stream in streams)
        return 1.0 - sum(stream.bits.bit_count() for stream in streams) / width if width else 0.0

    def mean_loss(self) -> float:
        """Return the share of the newest messages of all UAVs that did not come."""
        return self.loss(self._streams)


@dataclass(slots=True)
class Series:
    """Copies of one message that are still to be sent, `interval_ns` apart and none after `until_ns`."""

    message: Message
    left: int
    interval_ns: int
    next_ns: int
    until_ns: int

    def advance(self, now_ns: int) -> None:
        """Count a copy as sent; copies that a late process has missed are left out."""
        self.left -= 1
        self.next_ns = max(self.next_ns, now_ns) + self.interval_ns
        if self.next_ns > self.until_ns:
            self.left = 0


class Repetition:
    """The copies that one UAV still has to send in its slot.

    Parameters
    ----------
    mission
        Has `resends`, of which fixes and commands have half each; 0: nothing is ever repeated.
    uav
        The own id.
    clock
        The slots.
    """

    def __init__(self, mission: MissionMessage, uav: str, clock: SlotClock) -> None:
        self._uav = uav
        self._clock = clock
        self._most = math.ceil(mission.resends / 2)
        self._patience_slots = mission.lease_slots + SILENCE_SLOTS
        self._hearing = Hearing()
        self._told: dict[str, float] = {}
        self._series: dict[str, Series] = {}
        self._answered_slot = -1
        self._slot = -1
        self.next_ns: int | None = None

    @property
    def is_on(self) -> bool:
        """True if the mission allows copies."""
        return self._most > 0

    def begin_slot(self, slot: int) -> None:
        """Drop all copies: they say what held in the slot before."""
        if not self.is_on:
            return
        if self._slot < 0:
            self._answered_slot = slot - 1
        self._slot = slot
        self.drop()

    def drop(self) -> None:
        """Drop all copies, such as those of a grant that has changed."""
        self._series.clear()
        self.next_ns = None

    # --- what comes in -----------------------------------------------------------------------

    def hear(self, message: Message) -> None:
        """Count what came, and note what the sender says that it misses or has."""
        if not self.is_on or not isinstance(message, Fix | Command | Report):
            return
        self._hearing.hear(message)
        if isinstance(message, Report):
            return
        if isinstance(message, Fix):
            self._told[message.uav] = message.missed or 0.0
            if message.next_slot is not UNSET and message.next_slot > self._slot:
                self._stop(message.uav)
        else:
            self._told[message.head] = message.missed or 0.0

    def begin_listening(self) -> None:
        """Begin to count the fixes of all UAVs."""
        self._hearing.forget_fixes()

    def take_command(self, command: Command) -> None:
        """Note that the head hears this UAV; the next copy of its fix acknowledges the command, and is the last."""
        self._answered_slot = max(self._answered_slot, command.slot - 1)
        own = self._series.get(self._uav)
        if own is not None and isinstance(own.message, Fix):
            own.message = msgspec.structs.replace(own.message, next_slot=command.slot)
            own.left = min(own.left, 1)

    # --- what goes out -----------------------------------------------------------------------

    def fix_with_missed(self, fix: Fix) -> Fix:
        """Return the fix with the share of the head's messages that this UAV misses, if there is one."""
        missed = round(self._hearing.loss([fix.head]), 2) if self.is_on else 0.0
        return msgspec.structs.replace(fix, missed=missed) if missed else fix

    def command_with_missed(self, command: Command) -> Command:
        """Return the command with the share of the UAV's fixes that this head misses, if there is one."""
        missed = round(self._hearing.loss([command.uav]), 2) if self.is_on else 0.0
        return msgspec.structs.replace(command, missed=missed) if missed else command

    def repeat_fix(self, fix: Fix, now_ns: int) -> bool:
        """Repeat the own fix; return True if it is repeated at all."""
        if not self.is_on:
            return False
        loss = max(self._hearing.loss([fix.head]), self._told.get(fix.head, 0.0))
        count = max(repeats(loss, self._most), self._by_silence())
        self._repeat(self._uav, fix, count, now_ns, self._fixes_until_ns(now_ns))
        return count > 0

    def repeat_claim(self, claim: Report, now_ns: int) -> None:
        """Repeat a claim to all UAVs, few of which this one may have heard."""
        if self.is_on:
            count = max(repeats(self._hearing.mean_loss(), self._most), self._by_silence())
            self._repeat("report", claim, count, now_ns, self._end_ns(now_ns))

    def repeat_plan(self, commands: Iterable[Command], report: Report, now_ns: int) -> None:
        """Repeat the commands of a plan, and its report if it has UAVs unheard: they may not know of this head."""
        if not self.is_on:
            return
        until_ns = self._end_ns(now_ns)
        self._answered_slot = self._slot
        for command in commands:
            if command.uav != self._uav:
                loss = max(self._hearing.loss([command.uav]), self._told.get(command.uav, 0.0))
                self._repeat(command.uav, command, repeats(loss, self._most), now_ns, until_ns)
        astray = len(report.unheard) > len(report.landed)
        self._series.pop(self._uav, None)
        self._repeat(
            "report", report, repeats(self._hearing.mean_loss(), self._most) if astray else 0, now_ns, until_ns
        )

    def due(self, now_ns: int) -> Iterator[Message]:
        """Yield the copies that are due, one of each message."""
        for series in self._series.values():
            if series.next_ns <= now_ns:
                series.advance(now_ns)
                yield series.message
        self._series = {name: series for name, series in self._series.items() if series.left > 0}
        self._note_next()

    def _by_silence(self) -> int:
        """Return the repeats of a UAV that no command has reached for long: 2, 4, 8 ... copies, slot by slot."""
        silent_slots = self._slot - self._answered_slot - self._patience_slots
        return min((1 << min(silent_slots, 20)) - 1, self._most) if silent_slots > 0 else 0

    def _fixes_until_ns(self, now_ns: int) -> int:
        """Return until when fixes are repeated: until the head plans, or if it is late for that, until the end."""
        until_ns = self._clock.start_ns(self._slot) + round(FIX_SHARE * self._clock.tau_ns)
        return until_ns if now_ns < until_ns - self._clock.tau_ns // 2 else self._end_ns(now_ns)

    def _end_ns(self, now_ns: int) -> int:
        """Return a time shortly before the slot ends."""
        end_ns = self._clock.start_ns(self._slot + 1)
        return now_ns + round(FIX_SHARE * max(end_ns - now_ns, 0))

    def _repeat(self, name: str, message: Message, count: int, now_ns: int, until_ns: int) -> None:
        self._series.pop(name, None)
        if count > 0 and until_ns > now_ns:
            interval_ns = max((until_ns - now_ns) // count, 1)
            self._series[name] = Series(message, count, interval_ns, now_ns + interval_ns, until_ns)
        self._note_next()

    def _stop(self, uav: str) -> None:
        if self._series.pop(uav, None) is not None:
            self._note_next()

    def _note_next(self) -> None:
        self.next_ns = min((series.next_ns for series in self._series.values()), default=None)
