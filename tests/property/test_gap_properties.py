"""Property: however messages, asks and answers are lost and delayed, the record has each message once, or a gap."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from edc_swarm.protocol.gap_repair import GATHER_S, MAX_TRIES, WAITS_S, Gaps
from edc_swarm.protocol.keys import Keys
from edc_swarm.protocol.retransmission import OVERHEAD_BYTES, Ask, Kept, Ring, Span

KEYS = Keys("m")
STREAMS = (KEYS.fix("a"), KEYS.truth("a"), KEYS.event("a"))
US = ("a", "1-x")
LONG_S = sum(WAITS_S) + 1.0

fates = st.sampled_from(["arrives", "is lost", "comes late"])
said = st.lists(st.tuples(st.sampled_from(STREAMS), fates, st.booleans(), st.booleans()), max_size=60)


Said = tuple[str, str, bool, bool]
"""Key of a message, its fate, whether asks arrive then, whether an answer comes twice."""


class Bus:
    """A publisher and a recorder, and what the bus between them does to each message, ask and answer."""

    def __init__(self, kept: int) -> None:
        self.ring = Ring(kept * (OVERHEAD_BYTES + 1))
        self.gaps = Gaps("m", {"a"})
        self.seqs = dict.fromkeys(STREAMS, -1)
        self.recorded: list[tuple[str, int]] = []
        self.late: list[tuple[str, int]] = []
        self.asks = 0
        self.released = False
        self.now_s = 0.0

    def publish(self, key: str, fate: str) -> None:
        """Say one message."""
        self.seqs[key] += 1
        self.ring.keep(Kept(key, self.seqs[key], b"x"))
        if fate == "arrives":
            self.arrive(key, self.seqs[key])
        elif fate == "comes late":
            self.late.append((key, self.seqs[key]))

    def arrive(self, key: str, seq: int) -> None:
        """Let a message come by itself."""
        if self.gaps.heard(key, "1-x", seq, b"x", self.now_s):
            self.recorded.append((key, seq))

    def turn(self, after_s: float, *, asks_arrive: bool = True, twice: bool = False) -> None:
        """Let time pass, carry asks, and answers once or twice."""
        self.now_s += after_s
        for name, ask in self.gaps.due(self.now_s):
            self.asks += 1
            self.released |= ask == Ask([])
            if asks_arrive:
                for _ in range(2 if twice else 1):
                    taken = self.gaps.answered(name, self.ring.answer(ask), self.now_s)
                    self.recorded += [(kept.key, kept.seq) for kept in taken]

    def settle(self) -> None:
        """Let the publisher close and everything be asked for that still is."""
        self.gaps.closed(*US, self.seqs, self.now_s)
        for _ in range(100 + MAX_TRIES):
            self.turn(GATHER_S)


@given(said, st.integers(1, 80), st.data())
def test_each_message_once_or_gone(said: list[Said], kept: int, data: st.DataObject) -> None:
    """What the publisher still keeps is recorded in the end, nothing twice, and nothing but a gap else."""
    bus = Bus(kept)
    for key, fate, asks_arrive, twice in said:
        bus.publish(key, fate)
        late_first: bool = data.draw(st.booleans()) if bus.late else False
        if late_first:
            bus.arrive(*bus.late.pop(0))
        bus.turn(data.draw(st.sampled_from([0.0, GATHER_S, 1.0])), asks_arrive=asks_arrive, twice=twice)
    bus.settle()
    assert len(set(bus.recorded)) == len(bus.recorded)
    everything = {(key, seq) for key, last in bus.seqs.items() for seq in range(last + 1)}
    still_kept = bus.ring.answer(Ask([Span(key, 0, last) for key, last in bus.seqs.items()]))
    newest = {(one.key, one.seq) for one in still_kept.found}
    assert newest <= set(bus.recorded) <= everything
    assert not bus.gaps.outstanding
    assert bus.released or not said


@given(said)
def test_silence_costs_a_bounded_number_of_asks(said: list[Said]) -> None:
    """A publisher that never answers is asked so often for each gap that it shows, and then left alone."""
    bus = Bus(kept=1)
    for key, fate, *_ in said:
        bus.publish(key, fate)
    for _ in range(2 * MAX_TRIES):
        bus.turn(LONG_S, asks_arrive=False)
    assert bus.asks <= MAX_TRIES
    assert not bus.gaps.outstanding
    assert bus.gaps.next_s is None
