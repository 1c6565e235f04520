"""Every row of the election's table of transitions, and what does not make a transition."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from edc_swarm.agent.election import Election, TermClaim
from edc_swarm.agent.knowledge import Grant, Knowledge
from edc_swarm.agent.succession import HANDOVER_SLOTS
from edc_swarm.protocol.messages import Fix, Report
from tests import builders

IDS = ("a", "b", "c", "d", "e")
MISSION = builders.mission(builders.row(IDS, gap_m=20.0, north_m=9.0))
ENERGY = {"a": 50.0, "b": 90.0, "c": 80.0, "d": 80.0, "e": 10.0}


def fix(uav: str, slot: int, term: int = 1, head: str = "a", **fields: Any) -> Fix:
    """A fix with the grant (1, a)."""
    return builders.fix(uav, slot, term=term, head=head, **{"energy_j": ENERGY.get(uav, 0.0), **fields})


def report(slot: int, term: int = 1, head: str = "a", grants: int = 3, **fields: Any) -> Report:
    """A report of head a in term 1 with a quorum; b, then c are its standbys."""
    return builders.report(slot, term, head, quorum=3, grants=list(IDS[:grants]), standby=["b", "c"], **fields)


class Voter:
    """One UAV's election, fed as the node feeds it."""

    def __init__(self, uav: str = "c", grant: Grant = (1, "a"), voter: bool = True, **mission: Any) -> None:
        self.uav = uav
        self.knowledge = Knowledge(MISSION.roster)
        changed = msgspec.structs.replace(MISSION, **mission)
        self.election = Election(changed, uav, grant, voter, self.knowledge)

    def slot(self, slot: int, *, quiet: bool = True) -> Voter:
        """Begin a slot; unless quiet, hear the head's report of it."""
        self.knowledge.begin_slot(slot)
        self.election.begin_slot(slot)
        self.say()
        if not quiet:
            self.election.hear_report(report(slot))
            self.say()
        return self

    def say(self) -> None:
        """The own fix becomes knowledge."""
        e = self.election
        seq = self.knowledge.newest[self.uav].seq + 1 if self.uav in self.knowledge.newest else 0
        own = fix(self.uav, e.slot, e.term, e.head, suspects=e.suspects, seq=seq)
        self.knowledge.hear_fix(own, e.slot)

    def hear(self, *fixes: Fix) -> Voter:
        """Hear fixes of others."""
        for each in fixes:
            self.knowledge.hear_fix(each, self.election.slot)
            self.election.hear_fix(each)
        return self


def trusting(uav: str = "c", **mission: Any) -> Voter:
    """A UAV in slot 5 that has just heard its head, a."""
    return Voter(uav, **mission).slot(5, quiet=False)


def suspecting(uav: str = "c", slot: int = 8, **mission: Any) -> Voter:
    """A UAV in `slot` that heard its head last in slot 5, and a quorum of others all the time."""
    voter = trusting(uav, **mission)
    for each in range(6, slot + 1):
        voter.hear(*(fix(other, each - 1) for other in ("d", "e") if other != uav))
        voter.slot(each)
    assert voter.election.suspects
    return voter


def test_the_lease() -> None:
    """Nothing from the head for two slots: suspect; a command or report renews."""
    voter = trusting("d")
    assert not voter.slot(6).slot(7).election.suspects
    assert voter.slot(8).election.suspects
    voter.election.renew_lease()
    assert not voter.slot(9).slot(10).election.suspects
    assert voter.slot(11).election.suspects
    voter.election.hear_report(report(11))
    assert not voter.election.suspects
    assert voter.election.grant == (1, "a")


def test_longer_leases() -> None:
    """`lease_slots` says how long."""
    voter = trusting("d", lease_slots=4)
    assert not voter.slot(6).slot(9).election.suspects
    assert voter.slot(10).election.suspects


@pytest.mark.parametrize(
    "useless",
    [report(8, grants=2), report(8, status="no-quorum"), report(8, term=0), report(8, head="b")],
)  # fmt: skip
def test_reports_that_renew_nothing(useless: Report) -> None:
    """A powerless head, an older term, another head."""
    voter = suspecting("d")
    voter.election.hear_report(useless)
    assert voter.election.suspects
    assert voter.election.grant == (1, "a")


def test_proof_of_a_newer_term_is_granted() -> None:
    """A report with a quorum in a higher term, whether or not the old head is heard."""
    voter = trusting("d")
    voter.election.hear_report(report(5, term=4, head="e"))
    assert (voter.election.grant, voter.election.suspects) == ((4, "e"), False)
    voter.election.hear_report(report(5, term=3, head="b"))
    voter.election.hear_report(report(5, term=4, head="b"))
    assert voter.election.grant == (4, "e"), "terms only grow, and one head in each"
    voter.election.hear_report(report(5, term=9, head="b", grants=2))
    assert voter.election.grant == (4, "e"), "without a quorum it proves nothing"


def test_a_named_successor_is_granted_in_the_next_slot() -> None:
    """In the slot of the report the old head still holds; heard late, the grant is at once."""
    voter = trusting("d")
    voter.election.hear_report(report(5, successor="b", next_term=2))
    assert voter.election.grant == (1, "a")
    assert voter.slot(6).election.grant == (2, "b")
    late = trusting("d").slot(6)
    late.election.hear_report(report(5, successor="b", next_term=2))
    assert late.election.grant == (2, "b")


def test_a_successor_named_by_a_clock_ahead() -> None:
    """The report of slot 6, heard in slot 5, still asks for the grant in slot 7."""
    voter = trusting("d")
    voter.election.hear_report(report(6, successor="b", next_term=2))
    assert voter.slot(6).election.grant == (1, "a")
    assert voter.slot(7).election.grant == (2, "b")


@pytest.mark.parametrize("grant", [(1, "b"), (0, "b"), (0, "")])
def test_no_way_to_grant_another_head_in_one_term(grant: Grant) -> None:
    """No report, claim, successor or quorum of fixes moves a UAV that suspects to a term that is not higher."""
    term, head = grant
    voter = suspecting("d").hear(*(fix(uav, 8, term, head) for uav in "bce"))
    voter.election.hear_report(report(8, term=term, head=head or "b"))
    voter.election.hear_report(report(8, term=term, head=head or "b", status="claim"))
    assert (voter.election.grant, voter.election.suspects) == ((1, "a"), True)


@pytest.mark.parametrize(
    "useless",
    [
        report(5, successor="b", next_term=1),
        report(5, head="b", successor="b", next_term=2),
        report(5, grants=2, successor="b", next_term=2),
    ],
)
def test_successors_that_are_none(useless: Report) -> None:
    """Not a higher term, not from the head granted, not with a quorum."""
    voter = trusting("d")
    voter.election.hear_report(useless)
    assert voter.slot(6).election.grant == (1, "a")


def test_a_claim_is_granted_by_who_suspects() -> None:
    """A quorum of suspicions moves those who suspect, and nobody else."""
    claim = report(8, term=2, head="b", status="claim")
    voter = suspecting("d")
    voter.election.hear_report(msgspec.structs.replace(claim, grants=["b", "c"]))
    assert voter.election.grant == (1, "a")
    voter.election.hear_report(claim)
    assert (voter.election.grant, voter.election.suspects) == ((2, "b"), False)
    calm = trusting("d")
    calm.election.hear_report(claim)
    assert calm.election.grant == (1, "a")


def test_a_fix_with_a_higher_term() -> None:
    """A UAV that suspects grants it; one that does not needs a quorum of such fixes."""
    assert suspecting("d").hear(fix("e", 8, 2, "b")).election.grant == (2, "b")
    assert suspecting("d").hear(fix("e", 8, 2, "")).election.grant == (1, "a")
    assert suspecting("d").hear(fix("e", 8, 1, "b")).election.grant == (1, "a")
    voter = trusting("d").hear(fix("a", 5, 2, "b"), fix("b", 5, 2, "b"))
    assert voter.election.grant == (1, "a")
    voter.hear(fix("c", 5, 3, "b"))
    assert voter.election.grant == (1, "a"), "the quorum is of one grant"
    assert voter.hear(fix("e", 5, 2, "b")).election.grant == (2, "b")


def test_the_first_standby_claims() -> None:
    """With a quorum of suspicions, the own included, and not before."""
    voter = suspecting("b").hear(fix("d", 8, suspects=True), fix("e", 8))
    assert voter.election.claim is None
    voter.hear(fix("c", 8, suspects=True))
    assert voter.election.claim == TermClaim(2, ("b", "c", "d"))
    assert voter.election.grant == (2, "b")
    assert voter.election.leads


@pytest.mark.parametrize(
    "others",
    [
        [fix("d", 6, suspects=True), fix("e", 6, suspects=True)],
        [fix("d", 8, voter=False, suspects=True), fix("e", 8, suspects=True)],
        [fix("d", 8), fix("e", 8)],
    ],
)
def test_no_quorum_of_suspicions(others: list[Fix]) -> None:
    """Suspicions that are old, of UAVs without memory, or none: nobody moves."""
    voter = suspecting("b").hear(*others)
    assert voter.election.claim is None
    assert voter.election.grant == (1, "a")


def test_the_second_standby_waits_for_the_first() -> None:
    """As long as the better one lives, for a lease; at once when it is not heard."""
    suspicions = [fix("d", 8, suspects=True), fix("e", 8, suspects=True)]
    assert suspecting("c").hear(*suspicions).election.grant == (2, "c")
    voter = suspecting("c").hear(fix("b", 8, suspects=True), *suspicions)
    assert voter.election.grant == (1, "a")
    for slot in (9, 10):
        voter.election.begin_slot(slot)
        voter.say()
        if voter.election.grant == (1, "a"):
            voter.hear(*(fix(uav, slot, suspects=True) for uav in ("b", "d", "e")))
    assert voter.election.term == 2


def test_a_head_that_may_be_back_has_a_slot_to_itself() -> None:
    """After an outage, or when it is heard again, nobody outbids the old head before a whole slot has passed."""
    suspicions = [fix("d", 8, suspects=True), fix("e", 8, suspects=True)]
    heard_again = suspecting("b", slot=9, lease_slots=3)
    for slot, claims in ((9, False), (10, False), (11, True)):
        if slot > 9:
            heard_again.slot(slot)
        heard_again.hear(*(fix(uav, slot, suspects=True) for uav in "ade"))
        assert (heard_again.election.claim is not None) is claims
    cut_off = trusting("b")
    for slot in (6, 7, 8):
        cut_off.slot(slot)
    assert cut_off.hear(*suspicions).election.claim is None
    cut_off.slot(9).hear(fix("d", 9, suspects=True), fix("e", 9, suspects=True))
    assert cut_off.election.claim is not None


def test_who_is_no_standby_never_claims() -> None:
    """However many suspect."""
    voter = suspecting("d").hear(*(fix(uav, 8, suspects=True) for uav in ("b", "c", "e")))
    assert voter.election.claim is None
    assert voter.election.grant == (1, "a")


def test_a_token_that_vanishes() -> None:
    """The head's makes suspect at once; a standby that knows a quorum of suspicions then claims."""
    voter = trusting("b").hear(fix("c", 5, suspects=True), fix("d", 5, suspects=True))
    voter.election.peer_gone("e")
    assert not voter.election.suspects
    voter.election.peer_gone("a")
    assert voter.election.claim == TermClaim(2, ("b", "c", "d"))
    head = Voter("a")
    head.slot(5)
    head.election.planned()
    head.election.peer_gone("a")
    assert not head.election.suspects, "never oneself"


def test_who_listens() -> None:
    """The head, the standbys, and of all others only those that suspect and are on duty: a-d, then e, a, b, c."""
    assert [uav for uav in IDS if Voter(uav).slot(5, quiet=False).election.listens] == ["a", "b", "c"]
    assert [uav for uav in "de" if suspecting(uav, 8).election.listens] == ["e"]
    assert [uav for uav in "de" if suspecting(uav, 12).election.listens] == ["d"]
    assert not Voter("d", grant=(0, ""), voter=False).slot(0).election.listens


def test_a_standby_listens_no_longer_than_its_patience() -> None:
    """A standby that hears a quorum and gets no head for 2 (3 + 2) slots listens on duty alone."""
    voter = trusting("d")
    voter.election.standbys = ("c", "d")
    for slot in range(6, 24):
        voter.hear(*(fix(uav, slot - 1) for uav in ("b", "c"))).slot(slot)
        assert voter.election.suspects is (slot >= 8)
        assert voter.election.listens is (slot <= 17)  # Patience ends with slot 17, as does the duty of slots 12-17.
    voter.election.hear_report(report(23))
    assert not voter.election.listens, "no standby any more"
    head = Voter("d", grant=(1, "d")).slot(23)
    head.election.planned()
    assert head.election.listens


def test_the_fallback() -> None:
    """After a further lease with a quorum that suspects, the best UAV on duty claims, above all terms heard."""
    voter = suspecting("c", slot=9)
    voter.election.standbys = ()
    voter.hear(fix("e", 9, suspects=True), fix("b", 9), fix("d", 9, voter=False, suspects=True))
    assert voter.slot(10).election.claim is None, "no quorum of suspicions"
    voter = suspecting("c", slot=9)
    voter.election.standbys = ()
    voter.hear(fix("d", 9, suspects=True), fix("e", 9, suspects=True))
    assert voter.election.claim is None, "the lease is not over"
    assert voter.slot(10).election.claim == TermClaim(2, ("c", "d", "e"))
    voter = suspecting("d", slot=9).hear(fix("c", 9, suspects=True), fix("e", 9, suspects=True))
    assert voter.slot(10).election.claim is None, "not on duty"
    voter = suspecting("e", slot=9).hear(fix("b", 9, suspects=True), fix("d", 9, suspects=True))
    assert voter.slot(10).slot(11).election.claim is None, "a better one is on duty"


def test_a_claim_on_duty_waits_for_the_better_ones() -> None:
    """With a quorum from slot 13 on c gives b two slots, and d gives b and c three."""
    for uav, claims_in in (("c", 15), ("d", 16)):
        voter = trusting(uav)
        voter.election.standbys = ()
        for slot in range(6, claims_in + 1):
            assert voter.election.claim is None
            voter.hear(*(fix(other, slot - 1, suspects=slot > 12) for other in ("b", "c", "d", "e") if other != uav))
            voter.slot(slot)
        assert voter.election.claim is not None


def test_the_start() -> None:
    """In slot 1 when everybody was heard, else after a lease: the best candidate claims term 1."""
    full = Voter("b", grant=(0, "")).slot(0).hear(*(fix(uav, 0, 0, "", suspects=True) for uav in "acde"))
    assert full.slot(1).election.claim == TermClaim(1, ("b", "a", "c", "d", "e"))
    partly = Voter("c", grant=(0, "")).slot(0).hear(*(fix(uav, 0, 0, "", suspects=True) for uav in "ade"))
    assert partly.slot(1).election.grant == (0, "")
    assert partly.slot(2).election.grant == (1, "c")
    other = Voter("e", grant=(0, "")).slot(0).hear(*(fix(uav, 0, 0, "", suspects=True) for uav in "abcd"))
    assert other.slot(1).slot(2).slot(3).election.grant == (0, ""), "not on duty"


def test_a_claim_stands_until_it_has_a_quorum() -> None:
    """The claimant repeats it: until it has planned, suspects itself, or grants another."""

    def claimant() -> Voter:
        return Voter("b", grant=(0, "")).slot(0).hear(*(fix(uav, 0, 0, "", suspects=True) for uav in "acde")).slot(1)

    voter = claimant().slot(2).slot(3)
    assert voter.election.claim is not None
    assert voter.slot(4).election.claim is None
    led = claimant()
    led.election.planned()
    assert led.election.claim is None
    other = claimant()
    other.election.hear_report(report(1, term=2, head="a"))
    assert (other.election.grant, other.election.claim) == ((2, "a"), None)


def test_turns() -> None:
    """By energy, ties in roster order; who was granted and never led comes last, until one leads."""
    candidates = Voter("e").election.candidates
    among = [fix(uav, 5, suspects=True) for uav in "edcba"]
    assert candidates.in_turn(among, ["b"]) == ["b", "c", "d", "a", "e"]
    candidates.led = False
    assert candidates.in_turn(among, ["b"]) == ["c", "d", "a", "e", "b"]
    assert candidates.in_turn(among, ["c"]) == ["d", "a", "e", "b", "c"]
    candidates.note_lead()
    assert candidates.in_turn(among, ["c"]) == ["b", "c", "d", "a", "e"]


def test_response_time() -> None:
    """The shortest measured time first, none measured last; those who suspect after those who do not."""
    election = Voter(elect="response-time").election
    fixes = [
        fix("a", 5, response_ms=0.0),
        fix("b", 5, response_ms=3.0),
        fix("c", 5, response_ms=2.0),
        fix("d", 5, response_ms=1.0, suspects=True),
        fix("e", 5, response_ms=0.5, voter=False),
    ]
    assert election.candidates.ranked(fixes) == ["c", "b", "a", "d"]


def test_without_memory_nothing_is_ever_granted() -> None:
    """No report, claim, fix, successor or fallback moves a UAV that lost its promise."""
    voter = Voter("b", grant=(0, ""), voter=False)
    for slot in range(5, 12):
        voter.slot(slot)
        voter.election.hear_report(report(slot, successor="b", next_term=7))
        voter.election.hear_report(report(slot, status="claim", term=3))
        voter.hear(*(fix(uav, slot, 2, "a", suspects=True) for uav in "acde"))
        voter.election.peer_gone("a")
        assert (voter.election.grant, voter.election.claim) == ((0, ""), None)


# --- the head's succession ---------------------------------------------------------------------


def head_at(slot: int, **mission: Any) -> Voter:
    """Head a in `slot`, in office since slot 0."""
    voter = Voter("a", **mission).slot(0)
    voter.election.slot = slot
    voter.election.planned()
    voter.say()
    return voter


def everyone(slot: int, **energies: float) -> list[Fix]:
    """Fixes of all."""
    return [fix(uav, slot, energy_j=energies.get(uav, 50.0)) for uav in IDS]


@pytest.mark.parametrize(
    ("slot", "b_j", "all_heard", "successor"),
    [
        (HANDOVER_SLOTS, 56.0, True, (2, "b")),
        (HANDOVER_SLOTS, 54.9, True, None),
        (HANDOVER_SLOTS - 1, 90.0, True, None),
        (HANDOVER_SLOTS, 90.0, False, None),
    ],
)
def test_planned_handover(slot: int, b_j: float, all_heard: bool, successor: Grant | None) -> None:
    """Ten per cent behind the best, 20 slots in office, nobody unheard."""
    assert head_at(slot).election.pick_successor(everyone(slot, b=b_j), all_heard) == successor


def test_no_handover_to_who_suspects() -> None:
    """A UAV that does not hear its head would not hear that it is to lead."""
    fixes = [msgspec.structs.replace(f, suspects=f.uav == "b") for f in everyone(30, b=900.0, c=60.0)]
    assert head_at(30).election.pick_successor(fixes, True) == (2, "c")


@pytest.mark.parametrize(
    ("astray", "successor"),
    [
        (fix("e", 5, 7, "e"), (8, "a")),
        (fix("e", 3, 7, "e"), (8, "a")),
        (fix("e", 2, 7, "e"), None),
        (fix("e", 5, 1, "e"), (2, "a")),
        (fix("e", 5, 0, ""), None),
        (fix("e", 5, 7, "e", voter=False), None),
    ],
)
def test_who_cannot_join_is_taken_in(astray: Fix, successor: Grant | None) -> None:
    """The head succeeds itself above a newer term, and above its own where that is promised to another."""
    voter = head_at(5).hear(astray)
    assert voter.election.pick_successor(everyone(5), False) == successor


def test_an_acting_head_hands_over_soon() -> None:
    """Who leads by the rota may not be the best by the criterion: three slots are enough for the best to be warm."""
    voter = Voter("b", grant=(0, ""), elect="response-time").slot(0)
    voter.hear(*(fix(uav, 0, 0, "", suspects=True) for uav in "acde")).slot(1)
    assert voter.slot(2).election.leads is False, "a is better: it has two slots"
    voter.hear(*(fix(uav, 2, 0, "", suspects=True) for uav in "acde")).slot(3)
    assert voter.election.leads
    fixes = [fix(uav, 5, 1, "b", response_ms=1.0 if uav == "d" else 9.0) for uav in IDS]
    voter.election.planned()
    for slot, successor in ((4, None), (5, None), (6, (2, "d"))):
        voter.slot(slot)
        assert voter.election.pick_successor(fixes, True) == successor
