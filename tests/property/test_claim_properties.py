"""No id ever has two claimants that may fly, whatever comes and goes."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from edc_swarm.protocol.claims import Claims, IdClaim, instance_name

UAVS = [f"u{number}" for number in range(6)]
CLAIMANTS = [digit * 16 for digit in "0123"]

steps = st.lists(
    st.one_of(
        st.tuples(st.just("claim"), st.sampled_from(CLAIMANTS), st.integers(1, 4)),
        st.tuples(st.just("come"), st.sampled_from(CLAIMANTS), st.just(0)),
        st.tuples(st.just("go"), st.sampled_from(CLAIMANTS), st.just(0)),
        st.tuples(st.just("begin"), st.just(""), st.just(0)),
        st.tuples(st.just("restart"), st.just(""), st.just(0)),
    ),
    max_size=40,
)


@given(steps)
@settings(max_examples=300, deadline=None)
def test_no_id_is_issued_twice(history: list[tuple[str, str, int]]) -> None:
    """While its claimant is there an id stays with it, also across a restart of the operator; once begun, for good."""
    book, there, said = Claims(UAVS), set[str](), dict[str, set[str]]()
    final: dict[str, str] = {}
    for kind, claimant, uavs in history:
        if kind == "claim":
            there.add(claimant)
            issued = book.issue(IdClaim(claimant=claimant, uavs=uavs))
            others = {uav for other in there - {claimant} for uav in said.get(other, set())}
            assert not others & set(issued)
            assert all(final.get(uav, claimant) == claimant for uav in issued)
            assert len(issued) in {0, uavs} or set(issued) <= said.get(claimant, set())
            said[claimant] = set(issued)
        elif kind == "come" and claimant not in there:
            there.add(claimant)
            said[claimant] = set(book.held_by(claimant))
            book.see_claimant(claimant, True)
        elif kind == "go" and claimant in there:
            there.discard(claimant)
            book.see_claimant(claimant, False)
        elif kind == "begin" and not book.begun:
            book.begin()
            final = dict(zip(UAVS, book.claimants(UAVS), strict=True))
        elif kind == "restart":
            book = _restarted(there, said, final, begun=book.begun)


def _restarted(there: set[str], said: dict[str, set[str]], final: dict[str, str], *, begun: bool) -> Claims:
    """The book of the next operator: from the mission message, or from the tokens of whoever is there."""
    book = Claims(UAVS)
    if begun:
        book.resume(final)
    for claimant in there:
        book.see_claimant(claimant, True)
        for uav in said.get(claimant, set()):
            book.see_uav(uav, instance_name("1-00000000", claimant))
    return book
