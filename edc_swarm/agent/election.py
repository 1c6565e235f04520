"""Election of the head over the fixes, as a pure state machine. All transitions are in this file.

Safety rests on the promise alone: a UAV grants one head per term and never changes it, and terms only grow.
This module decides only *when* a UAV grants *which* head, so that a swarm has one head soon
and keeps it while nothing is wrong.

State: the grant (term, head); `suspects`, the suspicion that the head is down. Transitions, in the order in
which they are tried ("I" is this UAV):

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
slot begins         no message of the head for `lease_slots` slots        suspect
slot begins         suspicion for another lease, a quorum suspects        grant the best candidate
==================  ====================================================  ============================

A *quorum of suspicions* before any move (pre-vote) has two effects: one lossy link or one restarted UAV
disturbs nobody, and a minority never raises its term. A standby delays its claim by a lease for each better
standby that lives, and by a whole slot if the head may be back: a head survives an outage of the network.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from edc_swarm.agent.knowledge import Grant, Knowledge
from edc_swarm.mission.configuration import Mission
from edc_swarm.protocol.messages import NO_ONE, Fix, Report


@dataclass(frozen=True, slots=True)
class Claim:
    """A standby's claim to lead `term`, with the UAVs that suspect the old head."""

    term: int
    suspecting: tuple[str, ...]


class Election:
    """Election state of one UAV.

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
        The newest fixes, with the own one.
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
        """True if this UAV grants itself."""
        return self.head == self._uav

    @property
    def listens(self) -> bool:
        """True if this UAV needs all fixes: it leads, is a standby, or suspects its head."""
        return self.leads or self._uav in self.standbys or self.suspects

    def begin_slot(self, slot: int) -> None:
        """Let time pass; the fix of this slot then carries the result.

        The caller begins the slot's command first, so a planned handover costs no slot.
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
        """Process another UAV's fix, which the knowledge holds already."""
        if fix.uav == self.head and fix.slot >= self.slot:
            self._head_gone = False
        if fix.term > self.term and fix.head != NO_ONE:
            theirs = (fix.term, fix.head)
            if self.suspects or self._count(theirs) >= self._mission.quorum:
                self._adopt(theirs)
        self._claim_if_next()

    def hear_command(self) -> None:
        """Renew the lease: the head granted has sent this UAV a command."""
        self._renew()

    def hear_report(self, report: Report) -> None:
        """Process a report: a sign of life, a proof of a newer term, a claim or a handover."""
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
        """Process the hint that `uav` vanished from the bus while the own link was up."""
        if uav == self.head and uav != self._uav:
            self._head_gone = True
            self._suspect()
        self._claim_if_next()

    def planned(self) -> None:
        """Renew the own lease: a head with a quorum leads."""
        self._renew()

    def ranked(self, among: Sequence[Fix]) -> list[str]:
        """Return the ids of the voters by the mission's criterion, best first, ties in roster order.

        UAVs that suspect their head come last: they may not hear.
        """
        voters = [fix for fix in among if fix.voter]
        key = _CRITERIA[self._mission.elect]
        return [fix.uav for fix in sorted(voters, key=lambda fix: (fix.suspects, key(fix), self._order[fix.uav]))]

    def pick_successor(self, heard: Sequence[Fix], everyone_heard: bool) -> Grant | None:
        """Return the grant that the head's next report asks for, or None if the head stays.

        The head succeeds itself in a higher term if a UAV cannot join this one: that UAV has promised a newer term,
        or has promised this term to another head. Otherwise the best candidate succeeds the head if its criterion is
        better by `handover_margin`, every UAV is heard, and the last handover is `HANDOVER_SLOTS` slots ago.
        """
        astray = [fix.term for fix in self._knowledge.recent(self.slot - 2) if self._cannot_join(fix)]
        if astray:
            return (max(astray) + 1, self._uav)
        if not everyone_heard or self.slot - self._granted_slot < HANDOVER_SLOTS:
            return None
        return self._better_head(heard)

    def _cannot_join(self, fix: Fix) -> bool:
        """Return True if a UAV has promised this term to another head, or is in a newer term."""
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
        """Grant a higher term. Only this method changes the grant, so terms only grow."""
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
        """Return this UAV and the others whose fix of this slot or the last says that they suspect the head."""
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
        """Return True if the standby leaves this slot to the head, which may gather its quorum again.

        It leaves one whole slot if it heard the head lately, or if it was cut off from most UAVs until now. After an
        outage of the router all UAVs suspect a head that still runs; after a claim that head and the standby would
        outbid each other.
        """
        if self._head_gone:
            return False
        heard_lately = self._knowledge.last_slot(self.head) >= self.slot - 1
        return self._cut_off or (heard_lately and self.slot <= since_slot + 1)

    def _earlier_standby_lives(self, since_slot: int) -> bool:
        """Return True if a better standby was heard lately and still has time, one lease each, to claim."""
        rank = self.standbys.index(self._uav)
        if self.slot - since_slot >= rank * self._mission.lease_slots:
            return False
        return any(self._knowledge.last_slot(uav) >= self.slot - 1 for uav in self.standbys[:rank])

    def _fallback_due(self) -> bool:
        """Return True if this UAV has waited long enough for a claim: a lease, or at the start until all are heard."""
        if not self._voter:
            return False
        waited = self.slot - self._suspects_since
        if self.term == 0 and waited >= 1:
            everyone = sum(1 for _ in self._knowledge.recent(self.slot - 1)) == len(self._order)
            return everyone or waited >= self._mission.lease_slots
        return waited >= self._mission.lease_slots

    def _grant_best_candidate(self) -> None:
        """Grant (highest term heard + 1, best candidate), if a quorum suspects.

        A head that was granted and never led (it cannot hear or cannot plan) is a candidate again after all
        others. All heads of the newest term count as such, not only the own one: so the UAVs agree again after a
        split vote.
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
    """Return the key of the paper's criterion i: most remaining energy first."""
    return -fix.energy_j


def _by_response_time(fix: Fix) -> float:
    """Return the key of the paper's criterion ii: shortest response time first, an unmeasured one last."""
    return fix.response_ms if fix.response_ms > 0 else float("inf")


_CRITERIA = {"energy": _by_energy, "response-time": _by_response_time}
