"""End of a mission: all UAVs are at their targets, or nothing can change any more; and its head."""

from __future__ import annotations

import msgspec
import pytest

from edc_swarm.protocol.completion import STALL_SLOTS, MissionMonitor
from edc_swarm.protocol.messages import Command, Fix, Report
from tests import builders
from tests.builders import mission, row

ROSTER = row("ab", gap_m=30.0, north_m=90.0)


def fix(uav: str, slot: int, arrived: bool) -> Fix:
    """A fix at the target, or at the start."""
    return builders.fix(uav, slot, (0.0 if uav == "a" else 30.0, 90.0 if arrived else 0.0), arrived=arrived)


def monitor() -> MissionMonitor:
    """A monitor of two UAVs."""
    return MissionMonitor(mission(ROSTER))


def report(term: int, slot: int, head: str, grants: int = 2) -> Report:
    """A report with standbys."""
    return builders.report(slot, term, head, grants=["a", "b"][:grants], standby=["b"])


def test_all_there() -> None:
    """Complete when every UAV's fix of the slot says so, and not before."""
    judge = monitor()
    assert not judge.complete(3)
    judge.hear_fix(fix("a", 3, True))
    assert not judge.complete(3)
    judge.hear_fix(fix("b", 2, True))
    assert not judge.complete(3), "a fix of an older slot is none of this one"
    judge.hear_fix(fix("b", 3, False))
    assert not judge.complete(3)
    judge.hear_fix(fix("b", 4, True))
    assert judge.complete(3)
    assert (judge.arrived, judge.slot) == (2, 4)


def test_old_fixes_change_nothing() -> None:
    """A fix that was overtaken is not the newest."""
    judge = monitor()
    judge.hear_fix(fix("a", 5, True))
    judge.hear_fix(fix("a", 4, False))
    assert judge.arrived == 1


def test_those_who_are_gone() -> None:
    """The dead are not waited for, the revived are, and nobody is never all."""
    judge = monitor()
    judge.hear_fix(fix("a", 3, True))
    judge.end("b")
    assert judge.complete(3)
    judge.revive("b")
    assert not judge.complete(3)
    judge.end("a")
    judge.end("b")
    assert not judge.complete(3)


def test_who_has_landed_by_a_report_is_not_waited_for() -> None:
    """A process that is frozen for good says nothing more; that its UAV has landed is known by its head alone."""
    judge = monitor()
    judge.hear_fix(fix("b", 3, False))
    judge.hear_fix(fix("a", 9, True))
    judge.hear_report(builders.report(9, grants=["a"], landed=["b"]))
    assert not judge.complete(9), "no quorum backs that report"
    judge.hear_report(builders.report(9, grants=["a", "b"], landed=["b"]))
    assert judge.complete(9)
    judge.hear_report(builders.report(10, 2, "a", grants=["a", "b"]))
    assert judge.complete(9), "who has landed never flies again, whatever a new head knows"


def test_who_leads() -> None:
    """The newest report with a quorum in the highest term tells."""
    judge = monitor()
    assert (judge.head, judge.standbys) == ("", [])
    judge.hear_report(report(1, 5, "a"))
    judge.hear_report(report(2, 4, "b"))
    judge.hear_report(report(1, 6, "a"))
    judge.hear_report(report(3, 7, "a", grants=1))
    assert (judge.head, judge.standbys) == ("b", ["b"])


# --- nothing can change any more ---------------------------------------------------------------


def command(slot: int, step_m: float) -> Command:
    """A command of head a to b, a step of this length."""
    return builders.command("b", slot, (30.0, 0.0), (30.0, step_m))


def flown(slot: int, step_m: float) -> Fix:
    """A fix of b that has flown a step."""
    return builders.fix("b", slot, (30.0, 0.0), from_x_m=30.0, from_y_m=-step_m, executing=True)


def test_a_standstill_takes_so_many_plans() -> None:
    """One plan after the other in which nobody is to move, and none that moves anybody."""
    judge = monitor()
    for slot in range(STALL_SLOTS):
        assert not judge.stalled(slot)
        judge.hear_report(report(1, slot, "a"))
        judge.hear_report(report(1, slot, "a"))
    assert judge.stalled(STALL_SLOTS)


@pytest.mark.parametrize("happening", ["command", "fix", "end", "revive", "term"])
def test_whatever_happens_ends_a_standstill(happening: str) -> None:
    """A plan or a fix that moves somebody, a death, a return, another head: counting starts anew."""
    judge = MissionMonitor(mission([*ROSTER, msgspec.structs.replace(ROSTER[0], uav="c")]))
    if happening == "revive":
        judge.end("b")
    _plans(judge, 0, STALL_SLOTS - 1)
    match happening:
        case "command":
            judge.hear_command(command(STALL_SLOTS, 0.01))
        case "fix":
            judge.hear_fix(flown(STALL_SLOTS, 0.01))
        case "end":
            judge.end("b")
        case "revive":
            judge.revive("b")
    term = 2 if happening == "term" else 1
    _plans(judge, STALL_SLOTS - 1, 2 * STALL_SLOTS - 2, term)
    assert not judge.stalled(2 * STALL_SLOTS)
    _plans(judge, 2 * STALL_SLOTS - 2, 2 * STALL_SLOTS - 1, term)
    assert judge.stalled(2 * STALL_SLOTS)


def test_steps_too_short_to_get_anywhere_are_none() -> None:
    """A jam may hand out ever shorter ones: 0.1 mm where 2.5 m are possible."""
    for step_m, stalled in ((1e-4, True), (1e-3, False)):
        judge = monitor()
        for slot in range(STALL_SLOTS):
            judge.hear_fix(flown(slot, step_m))
            judge.hear_command(command(slot + 1, step_m))
            judge.hear_report(report(1, slot, "a"))
        assert judge.stalled(STALL_SLOTS) is stalled


def test_slots_without_a_plan_prove_nothing() -> None:
    """A planner that takes its time, or a network that has no head for long."""
    judge = monitor()
    for slot in range(10 * STALL_SLOTS):
        for uav in ("a", "b"):
            judge.hear_fix(fix(uav, slot, False))
        if slot % 20 == 0:
            judge.hear_report(report(1, slot, "a"))
    assert not judge.stalled(10 * STALL_SLOTS)


def test_nothing_stalls_before_the_last_fault_is_over() -> None:
    """UAVs that a fault has stopped may fly on after it is healed."""
    judge = MissionMonitor(mission(ROSTER, fault=["freeze b @10 for 500"]))
    _plans(judge, 0, 509 + STALL_SLOTS)
    assert not judge.stalled(600)
    _plans(judge, 509 + STALL_SLOTS, 510 + STALL_SLOTS)
    assert judge.stalled(610)


def test_nobody_waits_for_a_quorum_that_cannot_be() -> None:
    """Neither of the dead nor across a partition for good."""
    dead = monitor()
    dead.hear_fix(fix("a", 40, False))
    dead.end("b")
    split = MissionMonitor(mission(ROSTER, fault=["partition a|b @40"]))
    for judge in (dead, split):
        assert not judge.stalled(39 + STALL_SLOTS)
        assert judge.stalled(40 + STALL_SLOTS)
    dead.revive("b")
    assert not dead.stalled(1000)


def _plans(judge: MissionMonitor, first: int, end: int, term: int = 1) -> None:
    for slot in range(first, end):
        judge.hear_report(report(term, slot, "a"))
