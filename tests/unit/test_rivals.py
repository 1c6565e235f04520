"""G7 where new goals send two UAVs to places at which their discs overlap."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from edc_swarm.mission.routes import Course
from edc_swarm.mission.zone import Zone
from edc_swarm.protocol.messages import Fix, Message
from tests.unit.synthetic import Path, flight, parallel
from tests.unit.test_invariants import progress

SLOTS = 420
ENDS = {"u0": (0.0, 16.0), "u1": (12.0, 16.0), "u2": (24.0, 16.0)}
"""Where the UAVs are for most of the record."""


def flown(goals: dict[str, tuple[float, float]], **fields: Any) -> list[Message]:
    """A long record of UAVs that rest at `ENDS`, with these places as their goals from the first slot on."""
    paths: list[Path] = [[*path, *[path[-1]] * (SLOTS - len(path))] for path in parallel()]
    messages = flight(paths, **{"v_max_mps": 1e4, "max_slots": 1000, **fields})
    for index, message in enumerate(messages):
        if isinstance(message, Fix) and message.uav in goals:
            course = Course(goal=1, route=[goals[message.uav]])
            there = message.slot > 8 and goals[message.uav] == ENDS[message.uav]
            messages[index] = msgspec.structs.replace(message, course=course, arrived=there)
    return messages


def test_whoever_is_second_need_not_arrive() -> None:
    """One UAV is there, so no other fits; both are named."""
    found = progress(flown({"u1": ENDS["u1"], "u2": (18.0, 16.0)}))
    note = "u2 need not arrive: its disc would overlap that of u1 there, which has arrived"
    assert (found.status, found.notes) == ("held", [note])


@pytest.mark.parametrize("goal", [(22.0, 16.0), (40.0, 16.0)])
def test_two_that_take_turns_are_not_judged(goal: tuple[float, float]) -> None:
    """None of two rivals is there; two goals that are apart are broken."""
    found = progress(flown({"u1": (14.0, 16.0), "u2": goal}))
    if goal == (22.0, 16.0):
        assert (found.status, len(found.notes)) == ("not-judged", 1)
        assert found.notes[0] == "the discs of u1 and u2 overlap at their targets, and none of them is there"
    else:
        assert {violation.uavs[0] for violation in found.violations} == {"u1", "u2"}


def test_rivals_excuse_nobody_else() -> None:
    """A third UAV must arrive, unless zones may let the two close it in."""
    goals = {"u0": (0.0, 60.0), "u1": ENDS["u1"], "u2": (18.0, 16.0)}
    assert [violation.uavs for violation in progress(flown(goals)).violations] == [["u0"]]
    goals["u1"] = (14.0, 16.0)
    assert [violation.uavs for violation in progress(flown(goals)).violations] == [["u0"]]
    fence = Zone(name="f", kind="inclusion", polygon=[(-99, -99), (99, -99), (99, 99), (-99, 99)])
    assert progress(flown(goals, zone=[fence])).status == "not-judged"
