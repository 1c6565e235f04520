"""Who leads: the election over the fixes, as a pure state machine. All transitions are in this file.

Safety rests on the promise alone (a UAV grants one head per term for ever, terms only grow);
whatever this module does, it only decides *when* to grant *what*, so that a swarm has one head soon
and keeps it while nothing is wrong.

State: the grant (term, head); `suspects`, that the head is no longer heard; whether all fixes must
be listened to. Transitions, in the order in which they are tried:

==================  ====================================================  ============================
event               condition                                             action
==================  ====================================================  ============================
report or command   from the head granted, with a quorum                  renew the lease, trust again
report              proves a quorum for a higher term                     grant it
report              from the head granted, names a successor              grant it in the next slot
report (claim)      shows a quorum of suspicions, I suspect, term higher  grant it
fix                 I suspect, and it carries a higher term               grant the same
fix                 a quorum of fixes carries one higher grant            grant the same
fix, peer gone      I am the next standby, a quorum suspects              claim the next term
peer gone           it is the head                                        suspect (a hint, never proof)
slot begins         nothing from the head for `lease_slots` slots         suspect
slot begins         suspicion for another lease, a quorum suspects        grant the best candidate
==================  ====================================================  ============================

A *quorum of suspicions* before any move (pre-vote) is why one lossy link, or a UAV that comes back,
disturbs nobody, and why a minority never raises its term. A standby claims later where a better one
lives (a lease each) or where the head may be back (a whole slot): after an outage nothing has happened to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from edc_swarm.agent.knowledge import Grant, Knowledge
from edc_swarm.mission.configuration import Mission
from edc_swarm.protocol.messages import NO_ONE, Fix, Report


@dataclass(frozen=True, slots=True)
class Claim:
    """A standby's claim of `term`, with the UAVs that suspect the old head."""

    term: int
    suspecting: tuple[str, ...]


class Election:
    """One UAV's part in the election.

    Parameters
    ----------
    mission
        Roster, lease, number of standbys, criterion.
    uav
        The own id.
    grant
        The grant on disk, (0, "") for a new UAV.
    voter
        False for a UAV that lost its promise: it never grants in this mission.
    knowledge
        The newest fixes, the own one among them.
    """

    def __init__(self, mission: Mission, uav: str, grant: Grant, voter: bool, knowledge: Knowledge) -> None:
        self._mission = mission
        self._uav = uav
        self._voter = voter
        self._knowledge = knowledge
        self._order = {entry.uav: index for index, entry in enumerate(mission.roster)}
        self.term, self.head = grant
        self.slot = -1
        self.suspects = True
        self.standbys: tuple[str, ...] = ()
        self._in_vain: set[str] = set()
        self._was_led = True
        self._lease_until = -1
        self._suspects_since = -1
        self._granted_slot = 0
        self._successor: tuple[int, Grant] | None = None
        self.claim: Claim | None = None
        self._claimable_since: int | None = None
        self._head_gone = False
        self._cut_off = False

    @property
    def grant(self) -> Grant:
        """(term, head)."""
        return (self.term, self.head)

    @property
    def leads(self) -> bool:
        """Whether this UAV grants itself."""
        return self.head == self._uav

    @property
    def listens(self) -> bool:
        """Whether all fixes are needed: the head, its standbys, and whoever has no head."""
        return self.leads or self._uav in self.standbys or self.suspects

    def begin_slot(self, slot: int) -> None:
        """Let time pass; the fix of this slot then carries the result.

        Called after the slot's command has begun, so a planned handover costs no slot.
        """
        if self.slot < 0:
            self._suspects_since = slot
        self.slot = slot
        self._cut_off = sum(1 for _ in self._knowledge.recent(slot - 1)) < self._mission.quorum
        if self._successor is not None and slot > self._successor[0]:
            self._adopt(self._successor[1])
        if slot > self._lease_until:
            self._suspect()
        if self.suspects and self._fallback_due():
            self._grant_best_candidate()

    def hear_fix(self, fix: Fix) -> None:
        """Take in another UAV's fix, which the knowledge holds already."""
        if fix.uav == self.head and fix.slot >= self.slot:
            self._head_gone = False
        if fix.term > self.term and fix.head != NO_ONE:
            theirs = (fix.term, fix.head)
            if self.suspects or self._count(theirs) >= self._mission.quorum:
                self._adopt(theirs)
        self._claim_if_next()

    def hear_command(self) -> None:
        """Note a sign of life of the head granted, for this UAV."""
        self._renew()

    def hear_report(self, report: Report) -> None:
        """Take in a slot report: sign of life, proof of a newer term, claim or handover."""
        theirs = (report.term, report.head)
        if report.status == "claim":
            self._hear_claim(report, theirs)
        elif report.has_quorum and report.term > self.term:
            self._adopt(theirs)
        if report.has_quorum and theirs == self.grant:
            self._renew()
            self.standbys = tuple(report.standby)
            self._hear_successor(report)

    def peer_gone(self, uav: str) -> None:
        """Take in the hint that `uav` vanished from the bus while the own link was up."""
        if uav == self.head and uav != self._uav:
            self._head_gone = True
            self._suspect()
        self._claim_if_next()

    def planned(self) -> None:
        """Note that the own quorum is complete: a head renews its own lease by leading."""
        self._renew()

    def ranked(self, among: Sequence[Fix]) -> list[str]:
        """Ids of voters by the mission's criterion, best first, ties in roster order.

        Those who suspect their head, and so may not hear, come last.
        """
        voters = [fix for fix in among if fix.voter]
        key = _CRITERIA[self._mission.elect]
        return [fix.uav for fix in sorted(voters, key=lambda fix: (fix.suspects, key(fix), self._order[fix.uav]))]

    def pick_successor(self, heard: Sequence[Fix], everyone_heard: bool) -> Grant | None:
        """The grant that the head's next report asks for, or None to stay.

        A UAV whose promise keeps it from joining this term (it came back with a newer one, or took
        part in a split vote) makes the head succeed itself above that. Else the best standby
        succeeds it, at most every `HANDOVER_SLOTS` slots and with nobody unheard, when the own
        criterion has fallen behind by `handover_margin`.
        """
        astray = [fix.term for fix in self._knowledge.recent(self.slot - 2) if self._cannot_join(fix)]
        if astray:
            return (max(astray) + 1, self._uav)
        if not everyone_heard or self.slot - self._granted_slot < HANDOVER_SLOTS:
            return None
        return self._better_head(heard)

    def _cannot_join(self, fix: Fix) -> bool:
        """Whether a UAV has promised this term to another head, or is in a newer one already."""
        return fix.term > self.term or (fix.term == self.term and fix.head != self.head)

    def _better_head(self, heard: Sequence[Fix]) -> Grant | None:
        key, margin = _CRITERIA[self._mission.elect], self._mission.handover_margin
        best = self.ranked(heard)[0]
        keys = {fix.uav: key(fix) for fix in heard}
        own, other = keys[self._uav], keys[best]
        if best != self._uav and own - other > margin * abs(own):
            return (self.term + 1, best)
        return None

    def _renew(self) -> None:
        self._lease_until = self.slot + self._mission.lease_slots
        self.suspects = False
        self._was_led = True
        self._in_vain.clear()

    def _suspect(self) -> None:
        if not self.suspects:
            self.suspects = True
            self._suspects_since = self.slot

    def _adopt(self, grant: Grant) -> None:
        """Grant a higher term. The one place where the grant changes: terms only grow."""
        if not self._voter or grant[0] <= self.term:
            return
        self.term, self.head = grant
        self.standbys = tuple(uav for uav in self.standbys if uav != self.head)
        self._successor = None
        self._granted_slot = self.slot
        self._lease_until = self.slot + self._mission.lease_slots
        self._suspects_since = self.slot
        self._claimable_since = None
        self._head_gone = False
        self._was_led = False
        self.suspects = False

    def _hear_claim(self, report: Report, theirs: Grant) -> None:
        if self.suspects and len(report.grants) >= self._mission.quorum:
            self._adopt(theirs)

    def _hear_successor(self, report: Report) -> None:
        if report.successor == NO_ONE or report.next_term <= self.term:
            return
        self._successor = (report.slot, (report.next_term, report.successor))
        if self.slot > report.slot:
            self._adopt(self._successor[1])

    def _count(self, grant: Grant) -> int:
        recent = self._knowledge.recent(self.slot - 1)
        return sum((fix.term, fix.head) == grant for fix in recent if fix.uav != self._uav)

    def _suspecting(self) -> tuple[str, ...]:
        """Who suspects, as far as heard in this slot or the last, this UAV included."""
        recent = self._knowledge.recent(self.slot - 1)
        others = [fix.uav for fix in recent if fix.suspects and fix.uav != self._uav and fix.term <= self.term]
        return (self._uav, *others)

    def _claim_if_next(self) -> None:
        if not (self._voter and self.suspects and self._uav in self.standbys):
            return
        suspecting = self._suspecting()
        if len(suspecting) < self._mission.quorum:
            self._claimable_since = None
            return
        if self._claimable_since is None:
            self._claimable_since = self.slot
        if not self._earlier_standby_lives(self._claimable_since) and not self._head_may_be_back(self._claimable_since):
            term = self.term + 1
            self._adopt((term, self._uav))
            self.claim = Claim(term, suspecting)

    def _head_may_be_back(self, since_slot: int) -> bool:
        """Whether the head should have this slot to gather its quorum again.

        So it should, for one whole slot, when it was heard lately, or when this UAV was cut off from
        most others until now: after an outage of the router everybody suspects a head that nothing has
        happened to, and a claim would only make it and the standby outbid each other.
        """
        if self._head_gone:
            return False
        heard_lately = self._knowledge.last_slot(self.head) >= self.slot - 1
        return self._cut_off or (heard_lately and self.slot <= since_slot + 1)

    def _earlier_standby_lives(self, since_slot: int) -> bool:
        """Whether a better standby was heard lately and has not had its time, a lease each, yet."""
        rank = self.standbys.index(self._uav)
        if self.slot - since_slot >= rank * self._mission.lease_slots:
            return False
        return any(self._knowledge.last_slot(uav) >= self.slot - 1 for uav in self.standbys[:rank])

    def _fallback_due(self) -> bool:
        """Whether waiting for a claim is over: a further lease has gone by, or at the very start all are here."""
        if not self._voter:
            return False
        waited = self.slot - self._suspects_since
        if self.term == 0 and waited >= 1:
            everyone = sum(1 for _ in self._knowledge.recent(self.slot - 1)) == len(self._order)
            return everyone or waited >= self._mission.lease_slots
        return waited >= self._mission.lease_slots

    def _grant_best_candidate(self) -> None:
        """Grant (highest term heard + 1, best candidate), if a quorum is looking for a head.

        Whoever was granted in vain, since it cannot hear or cannot plan, has its turn again after all
        others. All heads of the newest term count, not only the own one: what a split vote has set
        apart then comes together again.
        """
        since = self.slot - self._mission.lease_slots
        seen = [fix for fix in self._knowledge.recent(since) if fix.suspects or fix.uav == self._uav]
        if len(seen) < self._mission.quorum:
            return
        highest = max(self.term, *(fix.term for fix in seen))
        if not self._was_led:
            self._in_vain |= {self.head, *(fix.head for fix in seen if fix.term == highest)}
        fresh = [fix for fix in seen if fix.uav not in self._in_vain]
        if not fresh:
            self._in_vain.clear()
        self._adopt((highest + 1, self.ranked(fresh or seen)[0]))


HANDOVER_SLOTS = 20
"""Least number of slots between two planned handovers."""


def _by_energy(fix: Fix) -> float:
    """Most remaining energy first (the paper's criterion i)."""
    return -fix.energy_j


def _by_response_time(fix: Fix) -> float:
    """Shortest response time first (the paper's criterion ii); not measured yet is last."""
    return fix.response_ms if fix.response_ms > 0 else float("inf")


_CRITERIA = {"energy": _by_energy, "response-time": _by_response_time}
