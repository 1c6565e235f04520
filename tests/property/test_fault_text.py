"""Property: the text of a fault is the fault."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from edc_swarm.errors import MissionError
from edc_swarm.mission.faults import (
    ChangeClock,
    ChangeGps,
    ChangeLink,
    Fault,
    Freeze,
    Heal,
    Kill,
    Partition,
    Restart,
    Resume,
    SlowSolver,
    parse_fault,
)

WORDS = [
    "kill",
    "link",
    "clock",
    "heal",
    "slow",
    "a>b",
    "a|b",
    "a",
    "@3",
    "@",
    "for",
    "2",
    "loss",
    "-1",
    "1e999",
    "nan",
]

ids = st.from_regex(r"\A[A-Za-z0-9_-]{1,32}\Z").filter(lambda uav: uav not in {"halves", "rest"})
seconds = st.floats(0, 1e9)
durations = st.one_of(st.just(float("inf")), seconds)
shares = st.floats(0, 1)
quantities = st.floats(0, 1e9)


def _numbers(**words: st.SearchStrategy[float]) -> st.SearchStrategy[tuple[tuple[str, float], ...]]:
    return st.lists(st.sampled_from(sorted(words)), unique=True).flatmap(
        lambda names: st.tuples(*(st.tuples(st.just(name), words[name]) for name in names))
    )


LINKS = _numbers(
    delay_ms=quantities, jitter_ms=quantities, loss=shares, duplicate=shares, reorder=shares, range_m=quantities
)
CLOCKS = _numbers(offset_ms=st.floats(-1e9, 1e9), drift_ppm=st.floats(-5e5, 5e5)).filter(bool)
groups = st.lists(ids, min_size=1, max_size=4).map(tuple)


def _faults(kind: type[Fault], **fields: st.SearchStrategy[object]) -> st.SearchStrategy[Fault]:
    return st.builds(kind, at_s=seconds, **fields)


faults = st.one_of(
    _faults(Kill, target=ids, mid_step=st.booleans(), for_s=durations),
    _faults(Freeze, target=ids, mid_step=st.booleans(), for_s=durations),
    _faults(Restart, target=ids, lose_memory=st.booleans()),
    _faults(Resume, target=ids),
    _faults(Partition, left=groups, right=groups, one_way=st.booleans(), for_s=durations),
    _faults(Partition, left=st.just(("halves",)), for_s=durations),
    _faults(Heal),
    _faults(ChangeLink, sender=ids, receiver=ids, quantities=LINKS, for_s=durations),
    _faults(ChangeClock, target=ids, quantities=CLOCKS),
    _faults(ChangeGps, target=ids, model=st.sampled_from(["none", "bias", "white", "gauss-markov"])),
    _faults(SlowSolver, target=ids, by_ms=quantities, for_s=durations),
)


@given(faults, st.floats(0.02, 60))
def test_the_text_of_a_fault_is_the_fault(fault: Fault, dt_s: float) -> None:
    """What an event says of a fault is the very fault, to the last digit and whatever the slot."""
    assert parse_fault(str(fault), dt_s) == fault


@given(st.one_of(st.text(), st.lists(st.sampled_from(WORDS)).map(" ".join)))
def test_any_text_is_read_or_refused(text: str) -> None:
    """Nothing but `MissionError` comes out, and what is read has a text that is read again."""
    try:
        fault = parse_fault(text, 0.5)
    except MissionError:
        return
    assert parse_fault(str(fault), 0.5) == fault


def test_slots_that_are_no_round_decimals() -> None:
    """7 slots of 0.3 s are 2.0999999999999996 s, which twelve digits would round."""
    fault = parse_fault("kill u001 @7", 0.3)
    assert fault.at_s == pytest.approx(2.1)
    assert parse_fault(str(fault), 0.3) == fault
