"""Statistics of the link model, on streams long enough for five standard deviations."""

from __future__ import annotations

import math
from itertools import groupby, pairwise
from statistics import fmean, median
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from edc_swarm.emulation.links import LinkEmulator
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.link import Link

MESSAGES = 20_000
MS = 1e6


def stream(sender: str = "a", receiver: str = "b", seed: int = 1, **rule: Any) -> list[list[int]]:
    """Arrivals of many messages over one link."""
    emulator = LinkEmulator(Mission(seed=seed, link=[Link(**rule)]), receiver)
    return [emulator.arrivals_ns(sender, 0.0) for _ in range(MESSAGES)]


def within(count: int, share: float) -> bool:
    """Whether a binomial count is within five standard deviations."""
    return abs(count - MESSAGES * share) <= 5 * math.sqrt(MESSAGES * share * (1 - share))


@pytest.mark.parametrize("loss", [0.01, 0.1, 0.5, 0.9])
def test_loss_rate(loss: float) -> None:
    """Independent loss at the stated rate, and of neighbours independently."""
    lost = [not arrivals for arrivals in stream(loss=loss)]
    assert within(sum(lost), loss)
    assert within(sum(a and b for a, b in pairwise(lost)), loss * loss)


def test_burst_length() -> None:
    """Gilbert-Elliott: bursts of mean 1 / leave, gaps of mean 1 / enter, the good state loses nothing."""
    lost = [not arrivals for arrivals in stream(burst_enter=0.02, burst_leave=0.25)]
    runs = [(state, len(list(run))) for state, run in groupby(lost)]
    bursts, gaps = ([length for state, length in runs if state is wanted] for wanted in (True, False))
    assert fmean(bursts) == pytest.approx(4.0, rel=5 / math.sqrt(len(bursts)))
    assert fmean(gaps) == pytest.approx(50.0, rel=5 / math.sqrt(len(gaps)))
    assert sum(lost) / MESSAGES == pytest.approx(0.02 / 0.27, rel=0.25)


def test_losses_within_a_burst() -> None:
    """In the bad state `burst_loss` of the messages go, outside it `loss`."""
    lost = sum(not arrivals for arrivals in stream(burst_enter=0.5, burst_leave=0.5, burst_loss=0.4, loss=0.2))
    assert within(lost, 0.3)


@pytest.mark.parametrize(
    ("distribution", "mean", "middle", "least", "most"),
    [
        ("constant", 30.0, 30.0, 30.0, 30.0),
        ("uniform", 40.0, 40.0, 30.0, 50.0),
        ("normal", 30.0 + 20 * math.sqrt(2 / math.pi), 30 + 0.6745 * 20, 30.0, 90.0),
        ("lognormal", 30.0 + 10 * math.exp(0.5), 40.0, 30.0, math.inf),
    ],
)
def test_delays(distribution: str, mean: float, middle: float, least: float, most: float) -> None:
    """30 ms and a jitter of 20 ms in each shape: mean, median, bounds."""
    delays = [ns / MS for (ns,) in stream(delay_ms=30, jitter_ms=20, distribution=distribution)]
    assert fmean(delays) == pytest.approx(mean, rel=0.02)
    assert median(delays) == pytest.approx(middle, rel=0.02)
    assert least - 1e-6 <= min(delays)
    assert max(delays) <= most + 1e-6


def test_duplicates() -> None:
    """The stated share comes twice, each copy with a delay of its own."""
    copies = [arrivals for arrivals in stream(duplicate=0.2, jitter_ms=10) if len(arrivals) == 2]
    assert within(len(copies), 0.2)
    assert sum(first != second for first, second in copies) > 0.99 * len(copies)


def test_reorder() -> None:
    """The stated share is held back, for a while of the order of a slot, so that others overtake."""
    held = [ns for (ns,) in stream(reorder=0.2) if ns > 0]
    assert within(len(held), 0.2)
    assert max(held) > 0.9 * Mission().slot_ns
    assert max(held) <= 3 * Mission().slot_ns
    assert median(held) < 0.9 * max(held)


@given(st.integers(0, (1 << 63) - 1), st.floats(0, 1), st.floats(0, 100))
def test_the_same_seed_gives_the_same_link(seed: int, loss: float, jitter_ms: float) -> None:
    """A link is a function of seed, sender and receiver, whatever goes on on other links meanwhile."""
    rules = [Link(loss=loss, jitter_ms=jitter_ms, delay_ms=1, burst_enter=0.1, duplicate=0.1, reorder=0.1)]
    alone, busy = (LinkEmulator(Mission(seed=seed, link=rules), "b") for _ in range(2))
    first = [alone.arrivals_ns("a", 0.0) for _ in range(40)]
    second = []
    for _ in range(40):
        busy.arrivals_ns("c", 0.0)
        second.append(busy.arrivals_ns("a", 0.0))
    assert first == second


def test_links_are_independent() -> None:
    """Another sender, another receiver, another direction or another seed is another stream."""
    streams = [
        [bool(arrivals) for arrivals in stream(sender, receiver, seed, loss=0.5)]
        for sender, receiver, seed in (("a", "b", 1), ("b", "a", 1), ("a", "c", 1), ("c", "b", 1), ("a", "b", 2))
    ]
    for index, left in enumerate(streams):
        for right in streams[:index]:
            assert within(sum(a == b for a, b in zip(left, right, strict=True)), 0.5)
