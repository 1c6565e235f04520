"""The head's work: quorum, once, barred terms, what is remembered per term, commands, reports."""

from __future__ import annotations

import math
from typing import Any

import pytest

from edc_swarm.agent.head import Head
from edc_swarm.agent.knowledge import ABSENT_SLOTS, Knowledge
from edc_swarm.planner.interface import Hull, Plan, PlanRequest
from edc_swarm.protocol.messages import Fix
from tests import builders
from tests.builders import mission, row

IDS = ("a", "b", "c", "d")
MISSION = mission(row(IDS, gap_m=20.0, north_m=9.0), v_max_mps=6.0)


class Moves:
    """A planner that moves everybody by the same step."""

    def __init__(self, dx_m: float = 0.0, dy_m: float = 1.5) -> None:
        self.step_m = dx_m, dy_m
        self.request: PlanRequest | None = None

    def plan(self, request: PlanRequest) -> Plan:
        """That step for everybody."""
        self.request = request
        dx_m, dy_m = self.step_m
        moved = [(float(x) + dx_m, float(y) + dy_m) for x, y in request.position_m]
        return Plan(moved, "planned", min_gap_m=0.5, guidance_ms=1.0, assemble_ms=2.0, solve_ms=4.0, iterations=7)


def fix(uav: str, slot: int, term: int = 2, head: str = "a", **fields: Any) -> Fix:
    """A fix at the start that grants a in term 2."""
    return builders.fix(uav, slot, (20.0 * IDS.index(uav), 0.0), x_m=0.0, term=term, head=head, **fields)


def head(*fixes: Fix, barred: int = 1, slot: int = 5) -> Head:
    """Head a, in office in term 2, that knows these fixes."""
    knowledge = Knowledge(MISSION.roster)
    for each in fixes:
        knowledge.hear_fix(each, slot)
    found = Head(MISSION, "a", barred, knowledge)
    found.take_office((2, "a"))
    return found


def three(slot: int = 5) -> list[Fix]:
    """Fixes of a, b, c: a quorum of four."""
    return [fix(uav, slot) for uav in "abc"]


@pytest.mark.parametrize(
    ("fixes", "quorum"),
    [
        (three(), True),
        (three()[:2], False),
        ([*three()[1:], fix("d", 5)], False),
        ([*three()[1:], fix("d", 5), fix("a", 4)], False),
        ([*three()[:2], fix("c", 4)], False),
        ([*three()[:2], fix("c", 5, term=1)], False),
        ([*three()[:2], fix("c", 5, head="b")], False),
        ([*three()[:2], fix("c", 5, voter=False)], False),
    ],
)
def test_quorum(fixes: list[Fix], quorum: bool) -> None:
    """More than half, in this very slot, with this very grant, the head itself among them."""
    assert head(*fixes).has_quorum(5) is quorum


@pytest.mark.parametrize(("barred", "may"), [(0, True), (1, True), (2, False), (3, False)])
def test_barred_terms(barred: int, may: bool) -> None:
    """A process never plans in a term that was on its disk when it started, or below."""
    assert head(*three(), barred=barred).may_plan(5) is may


def test_once() -> None:
    """One plan for each slot of a term, and none for an older slot; asking twice is a defect."""
    leader = head(*three())
    leader.plan(5, Moves())
    assert [leader.may_plan(slot) for slot in (4, 5, 6)] == [False, False, True]
    with pytest.raises(AssertionError, match="once"):
        leader.plan(5, Moves())
    with pytest.raises(AssertionError, match="quorum"):
        leader.plan(6, Moves())


def test_a_new_term_remembers_nothing() -> None:
    """t0 and the commands sent belong to the term; taking the same office again changes nothing."""
    leader = head(*three())
    leader.plan(5, Moves())
    office = leader.office
    assert (office.t0, office.planned_slot, sorted(office.sent)) == (5, 5, ["a", "b", "c"])
    leader.take_office((2, "a"))
    assert leader.office is office
    leader.take_office((3, "a"))
    assert (leader.office.t0, leader.office.planned_slot, leader.office.sent) == (-1, -1, {})


def test_t0_is_the_first_slot_with_a_quorum() -> None:
    """Later slots of the term do not move it."""
    knowledge = Knowledge(MISSION.roster)
    leader = Head(MISSION, "a", 1, knowledge)
    leader.take_office((2, "a"))
    for slot in (5, 6, 9):
        for each in three(slot):
            knowledge.hear_fix(each, slot)
        leader.plan(slot, Moves())
    assert leader.office.t0 == 5


def test_the_request() -> None:
    """Only the heard are planned, from the waypoints in their fixes; the others are hulls."""
    planner = Moves()
    head(*three(), fix("d", 4, term=1, head="b")).plan(5, planner)
    request = planner.request
    assert request is not None
    assert (request.slot, list(request.uav), request.previous_m) == (6, [0, 1, 2], None)
    assert list(request.position_m) == [(0.0, 0), (20.0, 0), (40.0, 0)]
    (hull,) = request.hulls
    assert (hull.uav, hull.ax_m, hull.bx_m, hull.radius_m, hull.r_m) == (3, 60.0, 60.0, 6.0, 5.0)


def test_hulls_of_all_who_are_not_heard() -> None:
    """Never heard, heard with another grant, heard earlier: each has one."""
    leader = head(*three(), fix("d", 3))
    leader.plan(5, Moves())
    assert leader.hulls(5) == {"d": Hull(3, 60, 0, 60, 0, 0.0, 5)}
    assert set(leader.hulls(6)) == set(IDS)
    assert leader.hulls(6)["b"] == Hull(1, 20, 0, 20, 1.5, 0.0, 5)


def test_commands() -> None:
    """Start is the fix's waypoint, target the plan's float; V, theta and alpha are those of eq. 10 and 11."""
    outcome = head(*three()).plan(5, Moves(0.9, 1.2))
    command = outcome.commands[1]
    assert (command.head, command.uav, command.slot, command.term) == ("a", "b", 6, 2)
    assert (command.start_x_m, command.start_y_m, command.target_x_m, command.target_y_m) == (20.0, 0.0, 20.9, 1.2)
    assert (command.vx_mps, command.vy_mps, command.speed_mps) == pytest.approx((1.8, 2.4, 3.0))
    assert command.heading_rad == pytest.approx(math.atan2(1.2, 0.9))
    assert command.deviation_rad == pytest.approx(math.atan2(1.2, 0.9) - math.pi / 2)
    assert head(*three()).plan(5, Moves(0.0, 0.0)).commands[0].deviation_rad == 0.0


def test_the_report() -> None:
    """It names the UAVs heard, the unheard ones with their hulls, and the times of planning."""
    report = head(*three()).plan(5, Moves()).report
    assert (report.head, report.slot, report.term, report.status) == ("a", 5, 2, "planned")
    assert (report.heard, report.grants, report.unheard, report.quorum) == (["a", "b", "c"], ["a", "b", "c"], ["d"], 3)
    assert (report.plan_ms, report.solve_ms, report.iterations, report.min_gap_m) == (7.0, 4.0, 7, 0.5)
    assert report.hull_uav == ["d", "a"]
    assert list(zip(*report.hull_columns, strict=True)) == [(60.0, 0.0, 60.0, 0.0, 21.0), (0.0, 0.0, 0.0, 1.5, 0.0)]
    assert report.has_quorum


def test_a_powerless_report() -> None:
    """It names who was heard, commands nobody and proves nothing."""
    report = head(*three()[:2]).powerless(5)
    assert (report.status, report.heard, report.unheard, report.has_quorum) == (
        "no-quorum",
        ["a", "b"],
        ["c", "d"],
        False,
    )


def test_whom_to_wait_for() -> None:
    """Not for those unheard for longer than three slots, nor for those who have left the bus."""
    assert not head(*three(), fix("d", 5 - ABSENT_SLOTS)).complete(5, set())
    assert head(*three(), fix("d", 5 - ABSENT_SLOTS)).complete(5, {"d"})
    assert head(*three(), fix("d", 4 - ABSENT_SLOTS)).complete(5, set())
    assert not head(*three()[:2], fix("c", 4)).complete(5, {"d"})
    assert not head(fix("a", 1), slot=1).complete(1, set()), "at the start all are waited for"
