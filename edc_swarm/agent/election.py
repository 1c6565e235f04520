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
report              from the head granted, names a successor, even late   grant it in the next slot
report (claim)      shows a quorum of suspicions, I suspect, term higher  grant it
fix                 I suspect, and it carries a higher term               grant the same
fix                 a quorum of fixes carries one higher grant            grant the same
fix, peer gone      I am the next standby, a quorum suspects              claim the next term
peer gone           it is the head                                        suspect (a hint, never proof)
slot begins         no message of the head for `lease_slots` slots        suspect
slot begins         suspicion for another lease, I am on duty by the      claim a term above all heard
                    rota, a quorum suspects, better candidates had a slot
                    each
==================  ====================================================  ============================

A *quorum of suspicions* before any move (pre-vote) has two effects: one lossy link or one restarted UAV
disturbs nobody, and a minority never raises its term. A standby delays its claim by a lease for each better
standby that lives, and by a whole slot if the head may be back: a head survives an outage of the network.

*Few listen.* The rows "fix" are those of UAVs that hear all fixes (`Election.listens`): the head, its standbys, and
without a head the UAVs on duty (`agent/rota.py`). All others learn of a new term by the claim, which its claimant
repeats with its fixes until it has a quorum, and by the reports of the head.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from edc_swarm.agent.knowledge import Grant, Knowledge
from edc_swarm.agent.rota import WINDOW_SLOTS, Rota
from edc_swarm.agent.succession import ACTING_SLOTS, HANDOVER_SLOTS, Candidates
from edc_swarm.mission.configuration import Mission
from edc_swarm.protocol.messages import NO_ONE, Fix, Report


@dataclass(frozen=True, slots=True)
class TermClaim:
    """A standby's or candidate's claim to lead `term`, with the UAVs that suspect the old head."""

    term: int
    suspecting: tuple[str, ...]


@dataclass(slots=True)
class Lease:
    """Trust in the head granted. It lasts until the end of slot `until`; `suspects` since slot `since`."""

    slots: int
    until: int = -1
    suspects: bool = True
    since: int = -1

    def renew(self, slot: int) -> None:
        """Trust the head for `slots` slots after `slot`."""
        self.until = slot + self.slots
        self.suspects = False

    def suspect(self, slot: int) -> None:
        """Suspect the head, from `slot` on if not earlier."""
        if not self.suspects:
            self.suspects, self.since = True, slot


@dataclass(slots=True)
class ClaimTiming:
    """Facts that delay a claim.

    `since` is the slot in which a quorum of suspicions began, None without one; `duty_since` the one in which this UAV
    saw one on duty. `head_gone` is true if the head has left the bus; `cut_off` is true if this UAV heard no quorum
    when the slot began. `vain_slots` counts the slots without a head in which it heard one.
    """

    since: int | None = None
    duty_since: int | None = None
    head_gone: bool = False
    cut_off: bool = False
    vain_slots: int = 0

    def head_may_be_back(self, slot: int, since_slot: int, heard_slot: int) -> bool:
        """Return True if a standby leaves `slot` to the head, which may gather its quorum again.

        It leaves one whole slot if it heard the head lately (in `heard_slot`), or if it was cut off from most UAVs
        until now. After an outage of the router all UAVs suspect a head that still runs; after a claim that head and
        the standby would outbid each other.
        """
        if self.head_gone:
            return False
        return self.cut_off or (heard_slot >= slot - 1 and slot <= since_slot + 1)


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
        self._uav = uav
        self._quorum = mission.quorum
        self._voter = voter
        self._knowledge = knowledge
        self.candidates = Candidates(mission)
        self._rota = Rota(mission)
        self._patience_slots = mission.lease_slots * (mission.standbys + 2)
        self.term, self.head = grant
        self.slot = -1
        self.standbys: tuple[str, ...] = ()
        self.claim: TermClaim | None = None
        self._lease = Lease(mission.lease_slots)
        self._timing = ClaimTiming()
        self._granted_slot = 0
        self._acts = False
        self._successor: tuple[int, Grant] | None = None

    @property
    def grant(self) -> Grant:
        """(term, head)."""
        return (self.term, self.head)

    @property
    def leads(self) -> bool:
        """True if this UAV grants itself."""
        return self.head == self._uav

    @property
    def suspects(self) -> bool:
        """True if this UAV suspects that its head is down, or has none."""
        return self._lease.suspects

    @property
    def in_office(self) -> bool:
        """True if this UAV leads or is a standby."""
        return self.leads or self._uav in self.standbys

    @property
    def listens(self) -> bool:
        """True if this UAV needs all fixes: it leads, is a standby, or is on duty without a head.

        A head or standby that hears a quorum of fixes and yet has no head for `lease_slots` (`standbys` + 2) slots has
        had its chance, and listens only on duty. So at most `CANDIDATES` UAVs listen then, however large the swarm is.
        """
        if self.in_office and self._timing.vain_slots <= self._patience_slots:
            return True
        return self.suspects and self._voter and self._uav in self._rota.on_duty(self.slot)

    def begin_slot(self, slot: int) -> None:
        """Let time pass; the fix of this slot then carries the result.

        The caller begins the slot's command first, so a planned handover costs no slot.
        """
        if self.slot < 0:
            self._lease.since = slot
        self.slot = slot
        self._timing.cut_off = sum(1 for _ in self._knowledge.recent(slot - 1)) < self._quorum
        if self._successor is not None and slot > self._successor[0]:
            self._adopt(self._successor[1])
        if slot > self._lease.until:
            self._lease.suspect(slot)
            self.claim = None
        self._timing.vain_slots += self.suspects and not self._timing.cut_off
        self._claim_on_duty()

    def hear_fix(self, fix: Fix) -> None:
        """Process another UAV's fix, which the knowledge holds already."""
        if fix.uav == self.head and fix.slot >= self.slot:
            self._timing.head_gone = False
        if fix.term > self.term and fix.head != NO_ONE:
            theirs = (fix.term, fix.head)
            if self.suspects or self._knowledge.count_granting(theirs, self.slot - 1, self._uav) >= self._quorum:
                self._adopt(theirs)
        self._claim_if_next()

    def renew_lease(self) -> None:
        """Trust the head granted for another lease: it has sent this UAV a command, or a report with a quorum."""
        self._lease.renew(self.slot)
        self._timing.vain_slots = 0
        self.candidates.note_lead()

    def hear_report(self, report: Report) -> None:
        """Process a report: a sign of life, a proof of a newer term, a claim or a handover.

        One that is late is a handover at most. Its head has left the term that it says: a UAV that did not follow would
        miss in the quorum of the successor until the rota elects another one.
        """
        theirs = (report.term, report.head)
        if report.slot < self.slot - 1 and report.term <= self.term:
            if report.has_quorum and theirs == self.grant:
                self._hear_successor(report)
            return
        if report.status == "claim":
            if self.suspects and len(report.grants) >= self._quorum:
                self._adopt(theirs)
        elif report.has_quorum and report.term > self.term:
            self._adopt(theirs)
        if report.has_quorum and theirs == self.grant:
            self.renew_lease()
            self.standbys = tuple(report.standby)
            self._hear_successor(report)

    def peer_gone(self, uav: str) -> None:
        """Process the hint that `uav` vanished from the bus while the own link was up."""
        if uav == self.head and uav != self._uav:
            self._timing.head_gone = True
            self._lease.suspect(self.slot)
        self._claim_if_next()

    def planned(self) -> None:
        """Renew the own lease: a head with a quorum leads, and its claim has done its work."""
        self.renew_lease()
        self.claim = None

    def pick_successor(self, heard: Sequence[Fix], everyone_heard: bool) -> Grant | None:
        """Return the grant that the head's next report asks for, or None if the head stays.

        It hands over only if every UAV is heard and the last change of the grant is `HANDOVER_SLOTS` slots ago;
        `ACTING_SLOTS` if it came into office by the rota, not by the mission's criterion. See `Candidates.successor`.
        """
        office_slots = ACTING_SLOTS if self._acts else HANDOVER_SLOTS
        may_hand_over = everyone_heard and self.slot - self._granted_slot >= office_slots
        newest = list(self._knowledge.recent(self.slot - 2))
        return self.candidates.successor((self.term, self._uav), heard, newest, may_hand_over)

    def _adopt(self, grant: Grant) -> None:
        """Grant a higher term. Only this method changes the grant, so terms only grow."""
        if not self._voter or grant[0] <= self.term:
            return
        self.term, self.head = grant
        self.standbys = tuple(uav for uav in self.standbys if uav != self.head)
        self._successor = None
        self.claim = None
        self._acts = False
        self._granted_slot = self.slot
        self._lease.renew(self.slot)
        self._lease.since = self.slot
        self._timing = ClaimTiming(cut_off=self._timing.cut_off)
        self.candidates.led = False

    def _hear_successor(self, report: Report) -> None:
        if report.successor == NO_ONE or report.next_term <= self.term:
            return
        self._successor = (report.slot, (report.next_term, report.successor))
        if self.slot > report.slot:
            self._adopt(self._successor[1])

    def _claim_if_next(self) -> None:
        if not (self._voter and self.suspects and self._uav in self.standbys):
            return
        if 1 + self._knowledge.count_suspecting(self.slot - 1, self.term, self._uav) < self._quorum:
            self._timing.since = None
            return
        since = self._timing.since = self.slot if self._timing.since is None else self._timing.since
        heard_slot = self._knowledge.last_slot(self.head)
        may_be_back = self._timing.head_may_be_back(self.slot, since, heard_slot)
        if not (may_be_back or self._earlier_standby_lives(since)):
            self._claim(self.term + 1, self._knowledge.suspecting(self.slot - 1, self.term, self._uav))

    def _claim(self, term: int, suspecting: Sequence[str]) -> None:
        """Grant oneself `term`, and say which others suspect the old head."""
        self._adopt((term, self._uav))
        self.claim = TermClaim(term, (self._uav, *suspecting))

    def _earlier_standby_lives(self, since_slot: int) -> bool:
        """Return True if a better standby was heard lately and still has time, one lease each, to claim."""
        rank = self.standbys.index(self._uav)
        if self.slot - since_slot >= rank * self._lease.slots:
            return False
        return any(self._knowledge.last_slot(uav) >= self.slot - 1 for uav in self.standbys[:rank])

    def _duty_due(self) -> bool:
        """Return True if this UAV may claim on duty: after a lease, or at the start as soon as all are heard."""
        if not (self._voter and self.suspects and self._uav in self._rota.on_duty(self.slot)):
            return False
        waited = self.slot - self._lease.since
        if self.term == 0 and waited >= 1:
            everyone = sum(1 for _ in self._knowledge.recent(self.slot - 1)) == len(self._knowledge.roster)
            return everyone or waited >= self._lease.slots
        return waited >= self._lease.slots

    def _claim_on_duty(self) -> None:
        """Claim (highest term heard + 1) if due, a quorum suspects, and each better candidate has had its time.

        The best one has two slots, since it may see the quorum a slot later than the others; each other one has one.
        """
        if not self._duty_due():
            self._timing.duty_since = None
            return
        since = self.slot - self._lease.slots
        seen = [fix for fix in self._knowledge.recent(since) if fix.suspects or fix.uav == self._uav]
        if len(seen) < self._quorum:
            self._timing.duty_since = None
            return
        highest = max(self.term, *(fix.term for fix in seen))
        granted = {self.head, *(fix.head for fix in seen if fix.term == highest)}
        on_duty = self._rota.on_duty(self.slot)
        turns = self.candidates.in_turn([fix for fix in seen if fix.uav in on_duty], granted)
        duty_since = self._timing.duty_since = self.slot if self._timing.duty_since is None else self._timing.duty_since
        waits = turns.index(self._uav) if self._uav in turns else WINDOW_SLOTS
        if self.slot - duty_since >= waits + (waits > 0):
            self._claim(highest + 1, [fix.uav for fix in seen if fix.uav != self._uav])
            self._acts = True
