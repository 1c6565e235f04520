"""Announcer of one UAV: it persists the promise, then publishes truth, fix and claim.

Rule kept here (named as in ARCHITECTURE.md): *fix sent again*. A UAV that expected a command for this slot and has none
sends its fix once more, half of `tau_s` into the slot: its last fix may be lost, and a head without a quorum of fixes
cannot plan. If its tick was later than a quarter of `tau_s` it does not: twice the fixes would keep an overloaded
machine without commands.
"""

from __future__ import annotations

from edc_swarm.agent.effects import Effect, Land, Persist, Publish
from edc_swarm.agent.election import Election
from edc_swarm.agent.flight import Flight
from edc_swarm.agent.knowledge import Grant, Knowledge
from edc_swarm.agent.leadership import Leadership
from edc_swarm.agent.local import LocalControl, NoElection
from edc_swarm.agent.outgoing import M, Outgoing
from edc_swarm.agent.repetition import Repetition
from edc_swarm.agent.slot_clock import SlotClock
from edc_swarm.agent.vehicle import Vehicle
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.messages import Truth


class Announcer:
    """What one UAV says and writes, as the effects of the step under way.

    Attributes
    ----------
    again_ns
        Time at which the UAV sends the fix of this slot again, None if it does not.
    """

    def __init__(
        self,
        outgoing: Outgoing,
        vehicle: Vehicle,
        flight: Flight,
        knowledge: Knowledge,
        election: Election | NoElection,
        leadership: Leadership | LocalControl,
        repetition: Repetition,
        clock: SlotClock,
        *,
        radio_j: float,
    ) -> None:
        """Take the parts whose state it tells; each message but a truth costs `radio_j` of the battery."""
        self._outgoing = outgoing
        self._vehicle = vehicle
        self._flight = flight
        self._knowledge = knowledge
        self._election = election
        self._leadership = leadership
        self._repetition = repetition
        self._clock = clock
        self._radio_j = radio_j
        self._said: tuple[Grant, bool] | None = None
        self._effects: list[Effect] = []
        self.again_ns: int | None = None

    @property
    def has_begun(self) -> bool:
        """True if the UAV has published a fix."""
        return self._said is not None

    def take_effects(self) -> list[Effect]:
        """Return the effects since the last call, in the order in which they are carried out."""
        effects, self._effects = self._effects, []
        return effects

    def begin_slot(self, slot: int, now_ns: int) -> None:
        """Decide whether the fix of this slot is sent again; the flight has begun the slot, with a command or not."""
        known = self._said is not None and self._said[0] == self._election.grant
        lacks_command = known and self._election.grant[0] > 0 and self._flight.flown is None
        again_ns = self._clock.start_ns(slot) + self._clock.tau_ns // 2
        in_time = again_ns - now_ns >= self._clock.tau_ns // 4
        self.again_ns = again_ns if lacks_command and in_time else None

    def say(self, slot: int, now_ns: int, *, with_truth: bool) -> None:
        """Persist the promise, then publish the truth if asked, the fix, and the claim that has no quorum yet.

        After a change of the grant the UAV first discards the pending commands, and takes office if it leads.
        """
        grant = self._election.grant
        if self._said is None or self._said[0] != grant:
            self._flight.discard()
            self._repetition.drop()
            if self._leadership.take_office(slot, now_ns):
                self.say_event(slot, EventKind.TAKES_OFFICE, f"term {grant[0]}")
        self.persist(slot)
        if with_truth:
            self.say_truth(slot)
        made = self._outgoing.fix(slot, self._vehicle, self._flight, self._election)
        fix = self.publish(self._repetition.fix_with_missed(made))
        self._knowledge.hear_fix(fix, slot)
        self._said = (grant, self._election.suspects)
        if not self._election.leads and self._repetition.repeat_fix(fix, now_ns):
            self.again_ns = None
        if self._election.claim is not None:
            claim = self.publish(self._outgoing.claim(slot, self._election.claim))
            self._repetition.repeat_claim(claim, now_ns)

    def say_change(self, slot: int, now_ns: int) -> None:
        """Say at once that the grant or the suspicion has changed, if so; the first tick says both anyway."""
        if self._said is not None and self._said != (self._election.grant, self._election.suspects):
            self.say(slot, now_ns, with_truth=False)

    def say_truth(self, slot: int) -> None:
        """Publish the true motion of a slot, or of the slots that an autopilot has reported."""
        for truth in self._outgoing.truths(slot, self._vehicle):
            self.publish(truth)

    def say_stray(self, slot: int) -> None:
        """Publish the truth and the fix of a UAV that strays, which promises nothing."""
        self.say_truth(slot)
        self.publish(self._outgoing.fix(slot, self._vehicle, self._flight, self._election))

    def say_end(self, slot: int, kind: EventKind, detail: str) -> None:
        """Say why this UAV lands at its waypoint, and that it never flies again."""
        self.again_ns = None
        self.persist(slot)
        self.say_truth(slot)
        self.say_event(slot, kind, detail)
        self._effects.append(Land())

    def say_event(self, slot: int, kind: EventKind, detail: str = "") -> None:
        """Publish an event, which costs no energy."""
        self._effects.append(self.event(slot, kind, detail))

    def event(self, slot: int, kind: EventKind, detail: str = "") -> Publish:
        """Return a stamped event."""
        return Publish(self._outgoing.stamped(self._outgoing.event(slot, kind, detail)))

    def persist(self, slot: int) -> None:
        """Write the promise and the airframe."""
        self._effects.append(Persist(self._flight.promise(slot, self._election.grant), self._vehicle.airframe))

    def publish(self, message: M) -> M:
        """Publish a message, and return it with its sequence number."""
        stamped = self._outgoing.stamped(message)
        self._effects.append(Publish(stamped))
        if not isinstance(message, Truth):
            self._vehicle.spend(self._radio_j)
        return stamped
