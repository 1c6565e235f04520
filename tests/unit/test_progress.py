"""When a mission is over, and who leads."""

from __future__ import annotations

from edc_swarm.config import Mission, RosterEntry
from edc_swarm.messages import Fix, Report
from edc_swarm.progress import MissionMonitor

ROSTER = [
    RosterEntry(uav=uav, start_x_m=x, start_y_m=0, target_x_m=x, target_y_m=90, r_m=5, body_m=1, energy_j=1)
    for uav, x in (("a", 0.0), ("b", 30.0))
]


def fix(uav: str, slot: int, arrived: bool) -> Fix:
    """A fix at the target, or at the start."""
    x_m = 0.0 if uav == "a" else 30.0
    y_m = 90.0 if arrived else 0.0
    return Fix(uav=uav, slot=slot, x_m=x_m, y_m=y_m, r_m=5, waypoint_x_m=x_m, waypoint_y_m=y_m, arrived=arrived)


def monitor() -> MissionMonitor:
    """A monitor of two UAVs."""
    return MissionMonitor(Mission(uavs=2, roster=ROSTER))


def report(term: int, slot: int, head: str, grants: int = 2) -> Report:
    """A report with standbys."""
    return Report(
        head=head, slot=slot, term=term, status="planned", quorum=2, grants=["a", "b"][:grants], standby=["b"]
    )


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


def test_who_leads() -> None:
    """The newest report with a quorum in the highest term tells."""
    judge = monitor()
    assert (judge.head, judge.standbys) == ("", [])
    judge.hear_report(report(1, 5, "a"))
    judge.hear_report(report(2, 4, "b"))
    judge.hear_report(report(1, 6, "a"))
    judge.hear_report(report(3, 7, "a", grants=1))
    assert (judge.head, judge.standbys) == ("b", ["b"])
