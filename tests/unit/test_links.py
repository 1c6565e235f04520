"""Links: cuts, windows, which rule holds, and one stream of chance per directed link."""

from __future__ import annotations

from typing import Any

import pytest

from edc_swarm.config import Link, Mission
from edc_swarm.links import Cut, LinkEmulator, cut_pair, mission_s

MS = 1_000_000


def links(*rules: dict[str, Any], receiver: str = "b", seed: int = 0) -> LinkEmulator:
    """The links into UAV b."""
    return LinkEmulator(Mission(seed=seed, link=[Link(**rule) for rule in rules]), receiver)


def test_without_a_rule_everything_arrives_at_once() -> None:
    """No delay, no copy, no loss."""
    assert links().arrivals_ns("a", 0.0) == [0]
    assert links({"sender": "c", "loss": 1.0}).arrivals_ns("a", 0.0) == [0]
    assert links({"receiver": "c", "loss": 1.0}).arrivals_ns("a", 0.0) == [0]


def test_constant_delay() -> None:
    """Milliseconds of wall time; `constant` adds no jitter."""
    emulator = links({"delay_ms": 7.5, "jitter_ms": 100, "distribution": "constant"})
    assert emulator.arrivals_ns("a", 0.0) == [7_500_000]


def test_the_last_rule_that_matches_holds() -> None:
    """Of rules for everyone, for this sender, for this time, the last one."""
    emulator = links({"delay_ms": 1}, {"sender": "a", "delay_ms": 2}, {"delay_ms": 3, "start_s": 5, "end_s": 6})
    found = [emulator.arrivals_ns(sender, at_s)[0] // MS for sender, at_s in (("a", 0), ("c", 0), ("a", 5), ("a", 6))]
    assert found == [2, 1, 3, 2]
    emulator.add_rule(Link(sender="c", delay_ms=4, start_s=0, end_s=1))
    emulator.add_rule(Link(receiver="x", delay_ms=9))
    assert emulator.arrivals_ns("c", 0.5) == [4 * MS]
    assert emulator.arrivals_ns("c", 1.0) == [1 * MS]


def test_a_cut_one_way() -> None:
    """Only what the left side says is cut off, while it lasts."""
    (cut,) = cut_pair(["a"], ["b"], 2.0, 3.0, one_way=True)
    assert [cut.blocks("a", "b", at_s) for at_s in (1.999, 2.0, 2.999, 3.0)] == [False, True, True, False]
    assert not cut.blocks("b", "a", 2.5)
    assert not cut.blocks("a", "c", 2.5)
    forth, back = cut_pair(["a"], ["b"], 2.0, 3.0, one_way=False)
    assert forth.blocks("a", "b", 2.5)
    assert back.blocks("b", "a", 2.5)


def test_cuts_at_a_receiver() -> None:
    """A cut for another receiver is none; healing ends all; the hint is muted like messages."""
    emulator = links()
    emulator.add_cut(Cut(frozenset("a"), frozenset("x"), 0.0))
    assert emulator.arrivals_ns("a", 1.0) == [0]
    emulator.add_cut(Cut(frozenset("a"), frozenset("b"), 0.5))
    assert emulator.arrivals_ns("a", 0.0) == [0]
    assert emulator.arrivals_ns("a", 1e6) == []
    assert emulator.is_cut("a", 1.0)
    assert not emulator.is_cut("c", 1.0)
    emulator.heal()
    assert emulator.arrivals_ns("a", 1.0) == [0]


def test_certain_and_impossible() -> None:
    """Probabilities 0 and 1 are exact."""
    assert all(links({"loss": 1.0}).arrivals_ns("a", 0.0) == [] for _ in range(50))
    emulator = links({"duplicate": 1.0, "delay_ms": 1})
    assert all(emulator.arrivals_ns("a", 0.0) == [MS, MS] for _ in range(50))
    burst = links({"burst_enter": 1.0, "burst_leave": 0.0})
    assert all(burst.arrivals_ns("a", 0.0) == [] for _ in range(50))
    harmless = links({"burst_enter": 1.0, "burst_leave": 0.0, "burst_loss": 0.0, "loss": 1.0})
    assert all(harmless.arrivals_ns("a", 0.0) == [0] for _ in range(50))


@pytest.mark.parametrize(("scale", "seconds"), [(1.0, 2.5), (4.0, 10.0)])
def test_mission_seconds(scale: float, seconds: float) -> None:
    """Wall time since the epoch times the time scale."""
    assert mission_s(2_500_000_000, scale) == seconds
