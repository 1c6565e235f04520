"""Knowledge of the other UAVs: order of fixes, the UAVs heard, each case of the hull."""

from __future__ import annotations

from typing import Any

import pytest

from edc_swarm.agent.knowledge import HullRules, Knowledge
from edc_swarm.planner.interface import Hull
from edc_swarm.protocol.messages import Command, Fix, Report
from tests import builders
from tests.builders import Point, entry, hulls

ROSTER = [entry(uav, (20.0 * k, 0.0)) for k, uav in enumerate("abc")]
RULES = HullRules(u_max_m=2.0, lag_slots=0)
LAGGING = HullRules(u_max_m=2.0, lag_slots=1)
MINE = (3, "a")


def fix(slot: int, term: int = 3, head: str = "a", uav: str = "b", at: Point = (1, 2), **fields: Any) -> Fix:
    """A fix of UAV b that grants a in term 3, unless told otherwise."""
    return builders.fix(uav, slot, at, x_m=0.0, y_m=0.0, term=term, head=head, **fields)


def command(slot: int, to: Point = (3, 2)) -> Command:
    """A step of UAV b from (1, 2)."""
    return builders.command("b", slot, (1.0, 2.0), to, term=3)


def place(ax_m: float, ay_m: float, bx_m: float, by_m: float, radius_m: float = 0.0) -> Hull:
    """A hull of UAV b."""
    return Hull(1, ax_m, ay_m, bx_m, by_m, radius_m, 5.0)


def report(slot: int, hull: Hull, term: int = 2, head: str = "c") -> Report:
    """A report of another head that saw UAV b in `hull`."""
    seen = hulls({"b": ((hull.ax_m, hull.ay_m), (hull.bx_m, hull.by_m), hull.radius_m)})
    return builders.report(slot, term, head, **seen)


def heard(*fixes: Fix, slot: int = 9) -> Knowledge:
    """Knowledge after these fixes, in this order, all received in `slot`."""
    knowledge = Knowledge(ROSTER)
    for each in fixes:
        knowledge.hear_fix(each, slot)
    return knowledge


@pytest.mark.parametrize(
    ("first", "second", "newest"),
    [
        (fix(4, seq=1), fix(5, seq=2), 2),
        (fix(5, seq=2), fix(4, seq=1), 2),
        (fix(5, term=3, seq=2), fix(5, term=4, seq=3), 3),
        (fix(5, term=4, seq=3), fix(5, term=3, seq=2), 3),
        (fix(5, term=9, seq=2), fix(6, term=3, seq=3), 3),
        (fix(5, seq=7, instance="x"), fix(5, seq=8, instance="x"), 8),
        (fix(5, seq=8, instance="x"), fix(5, seq=7, instance="x"), 8),
        (fix(5, seq=8, instance="x"), fix(5, seq=8, instance="x", energy_j=3.0), 8),
        (fix(5, seq=8, instance="x"), fix(6, seq=0, instance="y"), 0),
        (fix(5, seq=8, instance="x"), fix(5, seq=9, instance="y", energy_j=3.0), 8),
    ],
)
def test_order_of_fixes(first: Fix, second: Fix, newest: int) -> None:
    """By slot, then term, then order of sending: late, doubled and overtaken fixes change nothing."""
    knowledge = heard(first, second)
    assert knowledge.newest["b"].seq == newest
    assert knowledge.newest["b"].energy_j == 0.0


def test_fixes_that_are_no_knowledge() -> None:
    """A stranger's fix, and that of a UAV that lost its promise, are not taken in."""
    assert heard(fix(5, uav="zz"), fix(5, voter=False)).newest == {}


def test_early_fixes_wait() -> None:
    """A fix of a slot that has not begun here counts from when it has."""
    knowledge = heard(fix(4), fix(6), slot=5)
    assert knowledge.last_slot("b") == 4
    knowledge.begin_slot(5)
    assert knowledge.heard(6, MINE) == []
    knowledge.begin_slot(6)
    assert (knowledge.last_slot("b"), knowledge.heard(6, MINE)) == (6, ["b"])


@pytest.mark.parametrize(
    ("found", "is_heard"),
    [
        (fix(5), True),
        (fix(4), False),
        (fix(5, term=2), False),
        (fix(5, term=4), False),
        (fix(5, head="c"), False),
        (fix(5, voter=False), False),
        (fix(5, suspects=True), True),
    ],
)
def test_heard(found: Fix, is_heard: bool) -> None:
    """Heard is who sent a fix of this very slot with this very grant."""
    knowledge = heard(found, fix(5, uav="a"))
    assert knowledge.heard(5, MINE) == (["a", "b"] if is_heard else ["a"])
    assert knowledge.count_heard(5, MINE) == 1 + is_heard


def test_heard_is_counted_right_when_grants_change() -> None:
    """The running count is the length of the list, whatever came before."""
    knowledge = heard(fix(5), fix(5, uav="c"), fix(5), fix(5, term=4, uav="c"), fix(4, uav="a"), fix(5, uav="a"))
    assert knowledge.heard(5, MINE) == ["a", "b"]
    assert knowledge.count_heard(5, MINE) == 2
    assert knowledge.count_heard(4, MINE) == 0
    assert knowledge.count_heard(5, (4, "a")) == 1


def test_recent_in_roster_order() -> None:
    """Newest fixes not older than asked."""
    knowledge = heard(fix(5, uav="c"), fix(4, uav="b"), fix(3, uav="a"))
    assert [each.uav for each in knowledge.recent(4)] == ["b", "c"]
    assert knowledge.last_slot("a") == 3


def test_hull_of_one_never_heard() -> None:
    """The ball about the roster start, one step for every slot up to t0 + 1, then no more."""
    knowledge = Knowledge(ROSTER)
    for t0, radius_m in ((0, 4.0), (3, 10.0), (9, 22.0)):
        assert knowledge.hull("b", MINE, t0, {}, RULES) == place(20, 0, 20, 0, radius_m)


def test_hull_of_one_that_grants_me() -> None:
    """(a) The segment of the command for the slot after its fix, else the point."""
    knowledge = heard(fix(5))
    point = place(1, 2, 1, 2)
    assert knowledge.hull("b", MINE, 0, {}, RULES) == point
    assert knowledge.hull("b", MINE, 9, {"b": command(6)}, RULES) == place(1, 2, 3, 2)
    assert knowledge.hull("b", MINE, 9, {"b": command(5)}, RULES) == point
    assert knowledge.hull("b", MINE, 9, {"b": command(7)}, RULES) == point


@pytest.mark.parametrize("grant", [(2, "c"), (2, "a"), (4, "c"), (3, "c"), (0, "")])
@pytest.mark.parametrize(("t0", "radius_m"), [(5, 2.0), (4, 0.0), (3, 0.0), (7, 6.0), (20, 32.0)])
def test_hull_of_one_that_grants_another(grant: tuple[int, str], t0: int, radius_m: float) -> None:
    """(b) The ball about the waypoint, u_max for each slot from the fix to t0 + 1; own commands do not count."""
    knowledge = heard(fix(5, *grant), slot=30)
    assert knowledge.hull("b", MINE, t0, {"b": command(6)}, RULES) == place(1, 2, 1, 2, radius_m)


def test_hull_that_was_relayed() -> None:
    """A report serves like a fix of its slot, with its hull in place of the waypoint; the smallest ball counts."""
    knowledge = heard(fix(5, 1, "c"))
    knowledge.hear_report(report(8, place(1, 2, 7, 2, 1.5), term=1))
    assert knowledge.hull("b", MINE, 9, {}, RULES) == place(1, 2, 7, 2, 1.5 + 4.0)
    assert knowledge.hull("b", MINE, 7, {}, RULES) == place(1, 2, 7, 2, 1.5)
    assert knowledge.hull("b", MINE, 4, {}, RULES) == place(1, 2, 1, 2), "the fix alone, if nothing can have followed"
    knowledge.hear_report(report(7, place(0, 0, 0, 0, 0), term=1))
    assert knowledge.hull("b", MINE, 7, {}, RULES) == place(1, 2, 7, 2, 1.5), "an older report changes nothing"
    knowledge.hear_fix(fix(8, 1, "c", at=(5, 5)), 9)
    assert knowledge.hull("b", MINE, 9, {}, RULES) == place(5, 5, 5, 5, 4.0), "a fix of that slot knows better"
    knowledge.hear_report(report(9, place(0, 0, 0, 0, 3), term=1))
    assert knowledge.hull("b", MINE, 9, {}, RULES) == place(5, 5, 5, 5, 4.0), "as does one before a wide hull"
    knowledge.hear_fix(fix(8, 3, "a", at=(5, 5)), 9)
    assert knowledge.hull("b", MINE, 9, {}, RULES) == place(5, 5, 5, 5), "one that grants me moves by no other"


@pytest.mark.parametrize(("term", "radius_m"), [(2, 1.5), (1, 3.5), (3, 3.5)])
def test_the_term_just_before_is_known_a_slot_longer(term: int, radius_m: float) -> None:
    """Its head moved none of those in the slot after its report; an older one may have had a successor that did."""
    knowledge = Knowledge(ROSTER)
    knowledge.hear_report(report(8, place(1, 2, 7, 2, 1.5), term=term))
    assert knowledge.hull("b", MINE, 8, {}, RULES) == place(1, 2, 7, 2, radius_m)


def test_of_two_reports_of_a_slot_the_later_term_counts() -> None:
    """Whichever comes first."""
    knowledge = Knowledge(ROSTER)
    later, earlier = report(8, place(7, 7, 7, 7), term=2), report(8, place(5, 5, 5, 5), term=1)
    for said in (earlier, later, earlier):
        knowledge.hear_report(said)
    assert knowledge.hull("b", MINE, 8, {}, RULES) == place(7, 7, 7, 7)


def test_relayed_hull_of_a_stranger() -> None:
    """A report about a UAV that is not in the roster, or with lists of unequal length, harms nothing."""
    knowledge = Knowledge(ROSTER)
    knowledge.hear_report(builders.report(3, 2, "c", hull_uav=["zz", "b"]))
    knowledge.hear_report(builders.report(3, 2, "c", **hulls({"zz": ((1, 1), (1, 1), 1)})))
    assert knowledge.hull("b", MINE, 0, {}, RULES) == place(20, 0, 20, 0, 4.0)


def test_hull_with_lag() -> None:
    """Vehicles that may still be on their previous step: that segment belongs to every hull."""
    late = fix(5, from_x_m=1.0, from_y_m=0.0)
    assert heard(late).hull("b", MINE, 0, {}, LAGGING) == place(1, 0, 1, 2)
    other = heard(fix(5, 2, "c", from_x_m=1.0, from_y_m=0.0))
    assert other.hull("b", MINE, 5, {}, LAGGING) == place(1, 0, 1, 2, 2.0)
    corner = heard(late).hull("b", MINE, 0, {"b": command(6)}, LAGGING)
    assert (corner.ax_m, corner.ay_m, corner.bx_m, corner.by_m) == (1, 0, 3, 2)
    assert corner.radius_m == pytest.approx(2**0.5), "the waypoint between the two steps is inside"
