"""Links: cuts, windows, which rule holds, and one stream of chance per directed link."""

from __future__ import annotations

from typing import Any

import pytest

from edc_swarm.emulation.fading import fading_loss
from edc_swarm.emulation.links import MAX_CHANGES, Cut, LinkEmulator, cut_pair, have_range, mission_s
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.link import Link
from tests.builders import mission, row

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


def test_a_burst_ends_with_its_rule() -> None:
    """A rule without bursts loses nothing by the burst that the rule before it was in."""
    emulator = links({"burst_enter": 1.0, "burst_leave": 0.0}, {"start_s": 1.0})
    assert [emulator.arrivals_ns("a", at_s) for at_s in (0.0, 1.0)] == [[], [0]]


def test_changes_by_faults_are_limited() -> None:
    """A flood of faults fills no memory: from some number on none has an effect."""
    emulator, one_less = links(), links()
    for number in range(MAX_CHANGES):
        for each in (emulator, one_less) if number else (emulator,):
            each.add_rule(Link(loss=0.0))
            each.add_cut(Cut(frozenset("c"), frozenset("b"), 0.0))
    for each in (emulator, one_less):
        each.add_rule(Link(delay_ms=7.0))
        each.add_cut(Cut(frozenset("d"), frozenset("b"), 0.0))
    assert (emulator.arrivals_ns("a", 0.0), emulator.is_cut("d", 0.0)) == ([0], False)
    assert (one_less.arrivals_ns("a", 0.0), one_less.is_cut("d", 0.0)) == ([7_000_000], True)


def test_loss_over_distance() -> None:
    """Half at the range, more beyond it; without shadowing a sharp edge; at the same place none."""
    soft, sharp = Link(range_m=100.0), Link(range_m=100.0, shadowing_db=0.0)
    losses = [fading_loss(distance_m, soft) for distance_m in (0.0, 20.0, 50.0, 100.0, 200.0, 500.0)]
    assert losses == sorted(losses)
    assert losses[0] == 0.0
    assert losses[3] == 0.5
    assert losses[1] + losses[5] == pytest.approx(1.0)
    assert losses[4] == pytest.approx(0.93386, abs=1e-5)
    assert [fading_loss(distance_m, sharp) for distance_m in (99.9, 100.1)] == [0.0, 1.0]
    assert fading_loss(200.0, Link(range_m=100.0, path_loss_exponent=4.0)) > losses[4]


def test_range_is_about_where_both_are() -> None:
    """From the starts on, and as they are placed; the loss of the link comes on top."""
    roster = row("ab", gap_m=60.0, north_m=0.0)
    link = Link(range_m=50.0, shadowing_db=0.0)
    emulator = LinkEmulator(mission(roster, link=[link]), "b")
    assert emulator.arrivals_ns("a", 0.0) == []
    emulator.place("b", 45.0, 0.0)
    assert emulator.arrivals_ns("a", 0.0) == [0]
    emulator.place("a", 0.0, 30.0)
    assert emulator.arrivals_ns("a", 0.0) == []
    lossy = LinkEmulator(mission(roster, link=[Link(range_m=100.0, shadowing_db=0.0, loss=1.0)]), "b")
    assert lossy.arrivals_ns("a", 0.0) == []
    far = LinkEmulator(mission(roster, link=[Link(range_m=50.0, shadowing_db=0.0, loss=1e-9)]), "b")
    assert far.arrivals_ns("a", 0.0) == []


def test_which_missions_have_a_range() -> None:
    """Those with a link or with a fault to come that has one."""
    assert not have_range(Mission(link=[Link(loss=0.5)], fault=["link *>* loss 0.5 @3"]))
    assert have_range(Mission(link=[Link(), Link(range_m=1.0)]))
    assert have_range(Mission(fault=["link *>* range 50 @3"]))


@pytest.mark.parametrize(("scale", "seconds"), [(1.0, 2.5), (4.0, 10.0)])
def test_mission_seconds(scale: float, seconds: float) -> None:
    """Wall time since the epoch times the time scale."""
    assert mission_s(2_500_000_000, scale) == seconds
