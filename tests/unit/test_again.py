"""Ring of a publisher: the messages that it keeps, and the limits of one answer."""

from __future__ import annotations

import pytest

from edc_swarm.protocol.retransmission import (
    OVERHEAD_BYTES,
    TURN_BYTES,
    TURN_NUMBERS,
    Answer,
    Ask,
    Kept,
    Ring,
    Span,
    decode_answer,
    decode_ask,
    encode,
)


def ring(count: int, size: int = 10, **limit: int) -> Ring:
    """A ring that was told `count` messages on one key."""
    made = Ring(**limit)
    for seq in range(count):
        made.keep(Kept("k", seq, bytes(size), b"stamp"))
    return made


def numbers(answer: Answer) -> list[int]:
    """Numbers of what was found."""
    return [kept.seq for kept in answer.found]


def test_exactly_what_is_asked_for_is_given() -> None:
    """By key and number, in the order of the ask, with the bytes and the stamp as they were."""
    kept = Ring()
    scene = Kept("viz/uavs", 0, b"\x00scene", b'{"seq":0}')
    for each in (Kept("a", 0, b"a0"), scene, Kept("a", 1, b"a1"), Kept("b", 1, b"b1")):
        kept.keep(each)
    answer = kept.answer(Ask([Span("b", 0, 1), Span("viz/uavs", 0, 0)]))
    assert answer == Answer([Kept("b", 1, b"b1"), scene], [("b", 0)])


def test_the_oldest_are_forgotten() -> None:
    """Of ten messages the ring holds the last three, whatever their key."""
    kept = ring(10, limit_bytes=3 * (10 + 5 + OVERHEAD_BYTES))
    answer = kept.answer(Ask([Span("k", 0, 9)]))
    assert numbers(answer) == [7, 8, 9]
    assert answer.gone == [("k", seq) for seq in range(7)]


def test_what_is_larger_than_the_ring_is_not_kept() -> None:
    """The ring keeps the messages after it."""
    kept = ring(1, size=1000, limit_bytes=1000)
    for kept_bytes, seq in ((1, 1), (1, 2), (700, 3)):
        kept.keep(Kept("k", seq, bytes(kept_bytes)))
    assert numbers(kept.answer(Ask([Span("k", 0, 3)]))) == [3]


@pytest.mark.parametrize(("size", "given"), [(1, TURN_NUMBERS), (TURN_BYTES // 4, 4), (TURN_BYTES * 3, 1)])
def test_one_turn_gives_so_much_and_no_more(size: int, given: int) -> None:
    """By number and by bytes, but always at least one."""
    assert numbers(ring(300, size, limit_bytes=1 << 30).answer(Ask([Span("k", 0, 299)]))) == list(range(given))


def test_an_endless_ask_costs_one_turn() -> None:
    """A request for all numbers gets an answer about the first few."""
    answer = Ring().answer(Ask([Span("k", 0, 1 << 60)]))
    assert (answer.found, len(answer.gone)) == ([], TURN_NUMBERS)


def test_words_come_back() -> None:
    """An ask and an answer are what they were, after the bus."""
    ask, answer = Ask([Span("k", 1, 2)]), Answer([Kept("k", 1, b"\xff\x00", b"s")], [("k", 2)])
    assert decode_ask(encode(ask)) == ask
    assert decode_answer(encode(answer)) == answer
