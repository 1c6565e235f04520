"""The end of faults, the length of a mission, and the promise of G7 after faults without an end."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest

from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.faults import parse_faults
from edc_swarm.mission.link import Link
from edc_swarm.mission.prospect import FAULT_SLACK_SLOTS, default_max_slots, prospect_of, settled_slot
from edc_swarm.mission.roster import complete_mission
from tests import builders
from tests.builders import entry

LIMIT = 20 * 20 + 200


def mission(*faults: str, uavs: int = 5, x_m: float = 50.0, **fields: Any) -> Mission:
    """Return a mission of UAVs a, b, ... that fly 50 m with steps of 2.5 m (slot 0.5 s)."""
    ids = [chr(97 + k) if uavs <= 26 else f"u{k}" for k in range(uavs)]
    ends = [((-x_m / 2, 20.0 * k), (x_m / 2, 20.0 * k)) for k in range(uavs)]
    roster = [entry(uav, *way, body_m=0.25, energy_j=1e4) for uav, way in zip(ids, ends, strict=True)]
    return builders.mission(roster, fault=list(faults), **fields)


@pytest.mark.parametrize(
    ("faults", "links", "slot"),
    [
        ([], [], 0),
        (["kill a @7"], [], 7),
        (["kill a @7 for 2s"], [], 11),
        (["freeze a @7 for 3"], [], 10),
        (["partition halves @4 for 3"], [], 7),
        (["partition halves @4"], [], 4),
        (["partition halves @4 for 30", "heal @2", "heal @9", "heal @20"], [], 20),
        (["partition halves @4", "heal @9"], [], 9),
        (["link *>* loss 0.2 @4 for 2.2s"], [], 9),
        (["slow a 100 @4 for 3"], [], 7),
        (["gps a white @6"], [Link(loss=0.1, end_s=5.0)], 10),
        ([], [Link(loss=0.1, start_s=5.0)], 10),
    ],
)
def test_settled_when_the_last_fault_is_over(faults: Sequence[str], links: list[Link], slot: int) -> None:
    """Each fault counts until its end, or from its start if it has none."""
    whole = mission(*faults, link=links)
    assert settled_slot(whole, parse_faults(whole)) == slot


def test_a_mission_lasts_until_it_can_be_judged() -> None:
    """This is the default; a `max_slots` of the user takes precedence."""
    assert complete_mission(mission()).max_slots == LIMIT
    late = ["kill a @900", "partition halves @4 for 3"]
    assert complete_mission(mission(*late)).max_slots == 900 + LIMIT + FAULT_SLACK_SLOTS
    assert complete_mission(mission(*late, max_slots=7)).max_slots == 7


def test_lost_commands_take_more_slots() -> None:
    """The limit is that of a good network divided by the share of the commands in time (docs/latency.md)."""
    for loss, share in ((0.1, 0.8242), (0.3, 0.5554), (0.5, 1 / 3)):
        by_file, by_fault = mission(link=[Link(loss=loss)]), mission(f"link *>* loss {loss} @3")
        for whole in (by_file, by_fault):
            prospect = prospect_of(whole, parse_faults(whole))
            assert prospect.obstacle == ""
            assert prospect.limit_slots == pytest.approx(LIMIT / share, abs=1)
        assert default_max_slots(by_fault) == 3 + prospect.limit_slots + FAULT_SLACK_SLOTS


def test_a_cut_by_a_word_does_not_shorten_a_lossy_mission() -> None:
    """The role `head` has an id only in flight, so the mission must be long enough for each UAV."""
    lossy = [Link(loss=0.3)]
    told = mission("partition a|rest @10", link=lossy)
    assert default_max_slots(mission("partition head|rest @10", link=lossy)) == default_max_slots(told)


@pytest.mark.parametrize(
    ("link", "missed_pct"),
    [
        (Link(loss=0.5), 0),
        (Link(loss=0.51), 51),
        (Link(delay_ms=199), 0),
        (Link(delay_ms=200), 100),
        (Link(delay_ms=100, jitter_ms=200), 0),
        (Link(delay_ms=100, jitter_ms=250), 60),
        (Link(delay_ms=100, jitter_ms=250, distribution="constant"), 0),
        (Link(delay_ms=100, jitter_ms=100, distribution="normal"), 0),
        (Link(delay_ms=100, jitter_ms=200, distribution="normal"), 62),
        (Link(delay_ms=100, jitter_ms=150, distribution="lognormal"), 0),
        (Link(delay_ms=100, jitter_ms=250, distribution="lognormal"), 59),
        (Link(reorder=0.6), 60),
        (Link(loss=0.3, reorder=0.3), 51),
        (Link(burst_enter=0.1, burst_leave=0.3), 0),
        (Link(burst_enter=0.3, burst_leave=0.1), 75),
        (Link(loss=1.0, sender="a", receiver="b"), 100),
        (Link(loss=1.0, end_s=9.0), 0),
        (Link(duplicate=1.0), 0),
    ],
)
def test_what_a_link_may_do_for_good(link: Link, missed_pct: int) -> None:
    """G7 allows at most half of the messages to be lost or late."""
    whole = mission(link=[link])
    said = prospect_of(whole, []).obstacle
    name = f"the link {link.sender}>{link.receiver}"
    assert said == (f"{name} loses or delays {missed_pct} % of its messages for good" if missed_pct else "")


def test_a_later_rule_replaces_an_earlier_one() -> None:
    """Only the links in force at the end count."""
    assert not _obstacle("link *>* loss 1 @3", "link *>* @9")
    assert _obstacle("link *>* loss 1 @3", "link a>b @9")
    assert not _obstacle("link a>b loss 1 @3", "link a>b loss 0.1 @9")
    assert not _obstacle("link a>b loss 1 @3", "link *>* loss 0.1 @9")


@pytest.mark.parametrize(
    ("faults", "why"),
    [
        (["slow a 90 @3"], ""),
        (["slow a 300 @3"], "'slow a 300 @1.5s' leaves no time for a plan, for good"),
        (["slow a 300 @3 for 5"], ""),
        (["slow a 300 @3", "slow a 10 @9"], ""),
        (["clock a offset 30 @3"], ""),
        (["clock a offset 50 @3"], "'clock a offset 50 @1.5s' leaves a clock beyond guard_s for good"),
        (["clock a drift 1 @3"], "'clock a drift 1 @1.5s' leaves a clock beyond guard_s for good"),
        (["clock a offset 50 @3", "clock a offset 0 @9"], ""),
        (["kill router @3"], "'kill router @1.5s' takes the router away for good"),
        (["freeze router @3"], "'freeze router @1.5s' takes the router away for good"),
        (["kill router @3 for 2"], ""),
        (["kill router @3", "restart router @9"], ""),
        (["freeze router @3", "resume router @9"], ""),
        (["link *>* range 500 @3"], "the link *>* has a radio range for good"),
        (["kill a @3", "freeze b @4", "restart c lose-memory @5", "gps d white @6"], ""),
    ],
)
def test_faults_for_good(faults: Sequence[str], why: str) -> None:
    """Some faults forbid every promise, and are named."""
    assert _obstacle(*faults, guard_s=0.04) == why


@pytest.mark.parametrize(
    ("faults", "side", "why"),
    [
        (["partition d,e|rest @3"], "abc", ""),
        (["partition a|rest @3", "partition b|c,d,e @5"], "cde", ""),
        (["partition a|rest @3", "partition b|c,d,e @5", "heal @9"], "abcde", ""),
        (["partition halves @3 for 5"], "abcde", ""),
        (["partition a,b|c,d,e @3", "partition c>d @4"], "cde", "cuts off some links"),
        (["partition a,b|c,d,e @3", "partition a>b @4"], "cde", ""),
        (["partition a>rest @3"], "abcde", "cuts off some links"),
        (["partition a>rest @3", "partition rest>a @4"], "bcde", ""),
        (["partition a,b|c,d @3"], "abcde", "cuts off some links"),
        (["partition a,b|rest @3", "partition c|d,e @3"], "ab", "none of its sides can have a quorum"),
        (["partition head|rest @3"], "abcde", "whom it cuts off is not known"),
    ],
)
def test_a_partition_for_good_leaves_a_promise_to_the_side_with_a_quorum(
    faults: Sequence[str], side: str, why: str
) -> None:
    """The side must be cut off from all others, both ways, and connected in itself."""
    whole = mission(*faults)
    prospect = prospect_of(whole, parse_faults(whole))
    assert prospect.side == frozenset(side)
    assert why in prospect.obstacle
    assert bool(why) == bool(prospect.obstacle)


def test_many_partitions_of_many_uavs() -> None:
    """The largest possible mission is cut into many sides."""
    whole = mission(*[f"partition u{k}|rest @{k}" for k in range(100)], uavs=2000)
    assert len(prospect_of(whole, parse_faults(whole)).side) == 1900


@pytest.mark.parametrize(("v_max_mps", "x_m"), [(5.0, 1e7), (1e-300, 50.0), (5e-324, 50.0), (5.0, 2e5)])
def test_no_mission_lasts_for_ever(v_max_mps: float, x_m: float) -> None:
    """For any distance and speed, `max_slots` stays within its limit."""
    for loss in (0.0, 0.5):
        assert default_max_slots(mission(uavs=1, x_m=2 * x_m, v_max_mps=v_max_mps, link=[Link(loss=loss)])) == 1_000_000


def _obstacle(*faults: str, **fields: Any) -> str:
    whole = mission(*faults, **fields)
    return prospect_of(whole, parse_faults(whole)).obstacle
