"""Gaps in what was heard: seen, asked for, filled, given up. Transcripts: what comes, and what is asked."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import pytest

from edc_swarm.protocol import gap_repair
from edc_swarm.protocol.gap_repair import GATHER_S, MAX_AT_ONCE, MAX_GAP, MAX_TRIES, WAITS_S, Gaps
from edc_swarm.protocol.keys import Keys, source_of
from edc_swarm.protocol.retransmission import Answer, Ask, Kept, Span

KEYS = Keys("m")
FIX, TRUTH, EVENT = KEYS.fix("a"), KEYS.truth("a"), KEYS.event("a")
US = ("a", "1-x")


class Watch:
    """Gaps of mission m, in which a, b and the operator are known, and a clock."""

    def __init__(self) -> None:
        self.known = {"a", "b", "operator", "viz"}
        self.gaps = Gaps("m", self.known)
        self.now_s = 100.0

    def hear(self, *seqs: int, key: str = FIX, instance: str = "1-x", payload: bytes = b"bytes") -> list[bool]:
        """Messages come by themselves; which of them are to be recorded."""
        return [self.gaps.heard(key, instance, seq, payload, self.now_s) for seq in seqs]

    def asks(self, after_s: float = 0.0) -> list[tuple[tuple[str, str], Ask]]:
        """The requests due some time later."""
        self.now_s += after_s
        return self.gaps.due(self.now_s)

    def answer(
        self, found: Sequence[tuple[str, int]], gone: Sequence[tuple[str, int]] = (), who: tuple[str, str] = US
    ) -> list[int]:
        """An answer comes; the numbers that are to be recorded."""
        kept = [Kept(key, seq, b"bytes") for key, seq in found]
        return [one.seq for one in self.gaps.answered(who, Answer(kept, list(gone)), self.now_s)]


@pytest.fixture
def watch() -> Watch:
    """Nothing heard yet."""
    return Watch()


def test_nothing_is_asked_where_nothing_is_missing(watch: Watch) -> None:
    """No request is due."""
    assert watch.hear(0, 1, 2) == [True] * 3
    assert watch.asks(10.0) == []
    assert (watch.gaps.next_s, watch.gaps.outstanding) == (None, False)


def test_a_gap_is_asked_for_and_filled(watch: Watch) -> None:
    """Exactly what is missing, of both keys at once, and then no more."""
    watch.hear(0, 3)
    watch.hear(2, key=TRUTH)
    assert watch.asks() == []
    assert watch.gaps.outstanding
    assert watch.asks(GATHER_S) == [(US, Ask([Span(FIX, 1, 2), Span(TRUTH, 0, 1)]))]
    assert watch.answer([(FIX, 1), (FIX, 2), (TRUTH, 0), (TRUTH, 1)]) == [1, 2, 0, 1]
    assert not watch.gaps.outstanding
    assert watch.asks(10.0) == []


def test_a_partial_answer_leads_to_the_next_ask_at_once(watch: Watch) -> None:
    """A publisher that answers in parts gets a request for the rest."""
    watch.hear(5)
    watch.asks(GATHER_S)
    assert watch.answer([(FIX, 0), (FIX, 1)], [(FIX, 2)]) == [0, 1]
    assert watch.asks() == [(US, Ask([Span(FIX, 3, 4)]))]
    assert watch.answer([], [(FIX, 3)]) == []
    assert watch.asks() == [(US, Ask([Span(FIX, 4, 4)]))]


def test_what_cannot_be_had_any_more_is_given_up(watch: Watch) -> None:
    """A ring that has run over: the gap stays, and nothing is hoped for."""
    watch.hear(3)
    watch.asks(GATHER_S)
    assert watch.answer([(FIX, 2)], [(FIX, 0), (FIX, 1)]) == [2]
    assert not watch.gaps.outstanding
    assert watch.asks(10.0) == []


def test_silence_is_asked_again_and_again_and_then_no_more(watch: Watch) -> None:
    """A publisher that died: so many asks, each waited for as long as is written."""
    watch.hear(1)
    watch.now_s += GATHER_S
    times_s = []
    while watch.gaps.outstanding:
        assert watch.asks() in ([], [(US, Ask([Span(FIX, 0, 0)]))])
        times_s.append(watch.now_s)
        watch.now_s = watch.gaps.next_s or watch.now_s
    assert [later - at for at, later in pairwise(times_s)] == pytest.approx(WAITS_S)
    assert len(times_s) == MAX_TRIES + 1
    assert watch.asks(100.0) == []


def test_another_gap_wakes_a_publisher_that_was_given_up(watch: Watch) -> None:
    """It lives after all: old gaps and new are asked for."""
    watch.hear(1)
    for _ in range(MAX_TRIES + 2):
        watch.asks(10.0)
    watch.hear(2)
    assert watch.asks(10.0) == []
    watch.hear(4)
    assert watch.asks(GATHER_S) == [(US, Ask([Span(FIX, 0, 0), Span(FIX, 3, 3)]))]


def test_a_gap_during_an_ask_waits_for_the_answer(watch: Watch) -> None:
    """The recorder does not repeat a request that is under way."""
    watch.hear(1)
    watch.asks(GATHER_S)
    watch.hear(3)
    assert watch.asks(GATHER_S) == []
    watch.answer([(FIX, 0)])
    assert watch.asks() == [(US, Ask([Span(FIX, 2, 2)]))]


def test_nothing_is_recorded_twice(watch: Watch) -> None:
    """It ignores answers without a request: one sent twice, one that came by itself, keys never heard of."""
    watch.hear(0, 3)
    watch.asks(GATHER_S)
    assert watch.hear(1) == [True]
    assert watch.answer([(FIX, 1), (FIX, 2)]) == [2]
    assert watch.answer([(FIX, 1), (FIX, 2)]) == []
    assert watch.hear(2) == [False]
    assert watch.answer([(TRUTH, 0)], [(EVENT, 0)]) == []


def test_what_comes_by_itself_in_the_midst_of_a_gap_leaves_both_ends(watch: Watch) -> None:
    """They are asked for, and found."""
    watch.hear(0, 6)
    assert watch.hear(3) == [True]
    assert watch.asks(GATHER_S) == [(US, Ask([Span(FIX, 1, 2), Span(FIX, 4, 5)]))]
    assert watch.answer([(FIX, 4), (FIX, 5), (FIX, 1), (FIX, 2)]) == [4, 5, 1, 2]


def test_what_really_was_said_twice_is_recorded_twice(watch: Watch) -> None:
    """Two messages of one number are evidence, also where the first of them was fetched."""
    watch.hear(0, 2)
    watch.asks(GATHER_S)
    watch.answer([(FIX, 1)])
    assert watch.hear(0, 2) == [True, True]
    assert watch.hear(1, payload=b"forged") == [True]


def test_the_last_word_tells_of_a_tail(watch: Watch) -> None:
    """It names keys without any message too, and may name keys without the mission."""
    watch.hear(0)
    watch.gaps.closed("a", "1-x", {FIX: 1, EVENT: 0}, watch.now_s)
    watch.gaps.closed("viz", "9-y", {"viz/uavs": 0}, watch.now_s)
    assert watch.asks(GATHER_S) == [
        (US, Ask([Span(FIX, 1, 1), Span(EVENT, 0, 0)])),
        (("viz", "9-y"), Ask([Span(f"{KEYS.root}/viz/uavs", 0, 0)])),
    ]
    assert watch.hear(1) == [True]
    assert watch.answer([(FIX, 1), (EVENT, 0)]) == [0]


def test_who_has_closed_is_told_when_nothing_is_wanted_any_more(watch: Watch) -> None:
    """At once where nothing is missing, otherwise with the last answer; and once."""
    watch.hear(0, 2)
    watch.hear(0, key=KEYS.fix("b"), instance="2-x")
    watch.gaps.closed("b", "2-x", {KEYS.fix("b"): 0}, watch.now_s)
    assert watch.asks() == [(("b", "2-x"), Ask([]))]
    watch.gaps.closed("a", "1-x", {FIX: 2}, watch.now_s)
    assert watch.asks(GATHER_S) == [(US, Ask([Span(FIX, 1, 1)]))]
    watch.answer([(FIX, 1)])
    assert watch.asks() == [(US, Ask([]))]
    assert watch.asks(10.0) == []


def test_nobody_closes_for_another(watch: Watch) -> None:
    """The last word of b says nothing about the messages of a."""
    watch.hear(0)
    watch.gaps.closed("b", "1-x", {FIX: 10}, watch.now_s)
    assert watch.asks(10.0) == []


def test_instances_are_publishers_of_their_own(watch: Watch) -> None:
    """A UAV that was started again is not asked for what its predecessor has said."""
    watch.hear(0, 2)
    watch.hear(0, 2, instance="2-x")
    assert watch.asks(GATHER_S) == [(US, Ask([Span(FIX, 1, 1)])), (("a", "2-x"), Ask([Span(FIX, 1, 1)]))]


def test_a_gap_during_an_ask_is_asked_for_as_often_as_any(watch: Watch) -> None:
    """A publisher that has not answered yet shows that it lives: the ask under way is the first for all of it."""
    watch.hear(1)
    for after_s in (GATHER_S, *WAITS_S[:2]):
        assert watch.asks(after_s)
    watch.hear(3)
    assert sum(len(watch.asks(10.0)) for _ in range(2 * MAX_TRIES)) == MAX_TRIES - 1


def test_strangers_are_not_asked_before_they_are_known(watch: Watch) -> None:
    """They delay no request to others either."""
    watch.hear(1, key=KEYS.fix("z"))
    assert watch.asks(10.0) == []
    assert (watch.gaps.outstanding, watch.gaps.next_s) == (False, None)
    watch.known.add("z")
    assert watch.asks() == [(("z", "1-x"), Ask([Span(KEYS.fix("z"), 0, 0)]))]


def test_what_nobody_counts_is_left_alone(watch: Watch) -> None:
    """The recorder's own words, foreign keys, and instances that are no part of a key."""
    for key, instance in ((KEYS.event("recorder"), "1-x"), (f"{KEYS.root}/x", "1-x"), (FIX, ""), (FIX, "*/**")):
        assert watch.hear(5, 5, key=key, instance=instance) == [True, True]
    assert watch.asks(10.0) == []


def test_only_the_end_of_a_huge_gap_is_asked_for(watch: Watch) -> None:
    """An invented number makes no endless work."""
    watch.hear(1 << 50)
    ((_, ask),) = watch.asks(GATHER_S)
    assert ask.wanted == [Span(FIX, (1 << 50) - MAX_GAP, (1 << 50) - 1)]


def test_so_many_are_asked_at_once_and_no_more(watch: Watch) -> None:
    """The others when their turn comes, without anybody looking at the clock in vain."""
    names = [f"u{number}" for number in range(MAX_AT_ONCE + 1)]
    watch.known.update(names)
    for name in names:
        watch.hear(1, key=KEYS.fix(name))
    assert len(watch.asks(GATHER_S)) == MAX_AT_ONCE
    assert watch.gaps.next_s is not None
    assert watch.gaps.next_s > watch.now_s
    for name in names[:-1]:
        watch.hear(3, key=KEYS.fix(name))
    assert watch.asks(GATHER_S) == []
    assert watch.answer([(KEYS.fix("u0"), 0), (KEYS.fix("u0"), 2)], who=("u0", "1-x")) == [0, 2]
    assert [name for (name, _), _ in watch.asks(GATHER_S)] == [names[-1]]


def test_requests_are_bounded_in_time(watch: Watch) -> None:
    """Publishers that answer every request at once, each with one of many messages, are asked no faster for that."""
    names = [f"u{number}" for number in range(50)]
    watch.known.update(names)
    for name in names:
        watch.hear(1000, key=KEYS.fix(name))
    asked = 0
    for _ in range(500):
        for who, ask in watch.asks(0.001):
            asked += 1
            watch.answer([(ask.wanted[0].key, ask.wanted[0].first)], who=who)
    assert 9 * MAX_AT_ONCE <= asked <= 11 * MAX_AT_ONCE


def test_who_is_not_asked_yet_takes_nobodys_turn(watch: Watch) -> None:
    """However many gaps are still being gathered."""
    names = [f"u{number}" for number in range(MAX_AT_ONCE)]
    watch.known.update(names)
    watch.hear(1)
    watch.now_s += GATHER_S
    for name in names:
        watch.hear(1, key=KEYS.fix(name))
    assert [name for name, _ in watch.asks()] == [US]


def test_gaps_are_bounded(watch: Watch, monkeypatch: pytest.MonkeyPatch) -> None:
    """Messages beyond the limit stay a gap."""
    monkeypatch.setattr(gap_repair, "MAX_GAPS", 2)
    watch.hear(1, 3, 5)
    ((_, ask),) = watch.asks(GATHER_S)
    assert ask.wanted == [Span(FIX, 0, 0), Span(FIX, 2, 2)]
    watch.answer([(FIX, 0), (FIX, 2)])
    watch.hear(7)
    assert watch.asks(GATHER_S) == [(US, Ask([Span(FIX, 6, 6)]))]


@pytest.mark.parametrize(
    ("key", "source"),
    [
        (KEYS.fix("a"), "a"),
        (KEYS.command("a", "b"), "a"),
        (KEYS.report("a"), "a"),
        (KEYS.event("viz"), "viz"),
        (f"{KEYS.event('a')}/more", "a"),
        (f"{KEYS.mission}/more", ""),
        (KEYS.mission, "operator"),
        (f"{KEYS.root}/viz/location/u001", "viz"),
        (f"{KEYS.root}/claims", ""),
        ("swarm", ""),
    ],
)
def test_who_publishes_on_a_key(key: str, source: str) -> None:
    """The key alone names the publisher."""
    assert source_of(key) == source
