"""Commands from a ground station: what they amount to, and what the operator does for them."""

from __future__ import annotations

import math
from typing import Any

import pytest

from edc_swarm.geodesy import to_wgs84
from edc_swarm.ground_station.frames import Request
from edc_swarm.ground_station.view import GroundView
from edc_swarm.mission.configuration import NS_PER_S
from edc_swarm.mission.faults import GiveGoal, OrderLanding
from edc_swarm.mission.routes import Course
from edc_swarm.protocol.ground_orders import GroundOrder, GroundOrders, order_in
from edc_swarm.protocol.messages import Event
from tests import builders

ROSTER = [
    builders.entry("a", (0.0, 0.0), (0.0, 100.0), energy_j=1000.0),
    builders.entry("b", (50.0, 0.0), route=[(50.0, 40.0), (90.0, 40.0)], target_m=(90.0, 40.0)),
]
MISSION = builders.mission_message(ROSTER)
PLACE = to_wgs84(30.0, 40.0, MISSION.origin_lat_deg, MISSION.origin_lon_deg)
PLACE_E7 = {"x": round(PLACE[0] * 1e7), "y": round(PLACE[1] * 1e7)}


def view(*, permitted: bool = True) -> GroundView:
    """Return the view of two UAVs in flight."""
    made = GroundView(permitted=permitted)
    made.hear(MISSION, 0)
    for uav in ("a", "b"):
        made.hear(builders.fix(uav, 3), 0)
    return made


def asks(name: str, system: int = 2, **fields: Any) -> Request:
    """Return a request of ground station 245."""
    return Request(245, 190, system, name, fields)


@pytest.mark.parametrize(
    ("request_", "order"),
    [
        (asks("command_long", command=193, param1=0.0), GroundOrder(uav="b", wish="pause")),
        (asks("command_long", command=193, param1=1.0), GroundOrder(uav="b", wish="go on")),
        (asks("command_long", command=176, param1=1.0, param2=4.0, param3=3.0), GroundOrder(uav="b", wish="pause")),
        (asks("command_long", command=176, param1=1.0, param2=4.0, param3=4.0), GroundOrder(uav="b", wish="go on")),
        (asks("set_mode", base_mode=1, custom_mode=4 << 16 | 3 << 24), GroundOrder(uav="b", wish="pause")),
        (asks("command_long", command=300), GroundOrder(uav="b", wish="go on")),
        (asks("command_long", command=21), GroundOrder(uav="b", wish="land")),
        (asks("command_int", command=192, **PLACE_E7), GroundOrder(uav="b", wish="goal", x_m=30.0, y_m=40.0)),
    ],
)
def test_what_steers_is_an_order_with_permission_and_denied_without(request_: Request, order: GroundOrder) -> None:
    """The same request: accepted and handed to the operator, or denied."""
    allowed, strict = view(), view(permitted=False)
    answers = allowed.answer(request_)
    assert [answer.fields["result"] for answer in answers if answer.name == "command_ack"] in ([0], [])
    (found,) = allowed.take_orders()
    assert (found.uav, found.wish) == (order.uav, order.wish)
    assert (found.x_m, found.y_m) == (
        (None, None) if order.x_m is None else pytest.approx((order.x_m, order.y_m), abs=0.02)
    )
    assert allowed.denied.total() == 0
    strict.answer(request_)
    assert (strict.take_orders(), strict.denied.total()) == ([], 1)


@pytest.mark.parametrize(
    "request_",
    [
        asks("command_long", command=400, param1=1.0),
        asks("command_long", command=20),
        asks("command_long", command=176, param1=1.0, param2=4.0, param3=6.0),
        asks("command_int", command=192, x=0, y=0),
        asks("command_long", command=192, param5=math.nan, param6=math.nan),
        asks("set_position_target_local_ned"),
        asks("mission_count", count=3),
    ],
)
def test_with_permission_everything_else_is_denied_still(request_: Request) -> None:
    """Arming, return, other modes, a place on another continent or none, set-points, missions."""
    allowed = view()
    allowed.answer(request_)
    assert (allowed.take_orders(), allowed.denied.total()) == ([], 1)


def test_a_flood_of_commands_is_bounded_and_the_rest_is_denied() -> None:
    """2000 commands to land in a second: 500 orders; the next second has room again."""
    allowed = view()
    allowed.advance(10 * NS_PER_S)
    for _ in range(2000):
        allowed.answer(asks("command_long", command=21))
    assert (len(allowed.take_orders()), allowed.denied.total()) == (500, 1500)
    allowed.answer(asks("command_long", command=21))
    assert allowed.take_orders() == [], "taking the orders makes no room"
    allowed.advance(11 * NS_PER_S)
    allowed.answer(asks("command_long", command=21))
    assert len(allowed.take_orders()) == 1


def test_a_uav_that_was_never_heard_takes_no_order() -> None:
    """Nobody knows where it is."""
    silent = GroundView(permitted=True)
    silent.hear(MISSION, 0)
    silent.answer(asks("command_long", command=21))
    assert silent.take_orders() == []


def test_a_pause_keeps_what_is_left_of_the_route() -> None:
    """It gets a goal where it rests; to go on, it gets the point that it had not reached; twice is refused."""
    orders = GroundOrders(MISSION)
    orders.hear_fix(builders.fix("b", 20, (60.0, 40.0), from_x_m=58.0, from_y_m=40.0, course=Course(leg=1)))
    paused = orders.carried_out_by(GroundOrder(uav="b", wish="pause"), 10.0)
    assert paused == GiveGoal("b", ((60.0, 40.0),), at_s=10.0)
    assert orders.pauses
    assert orders.carried_out_by(GroundOrder(uav="b", wish="pause"), 11.0) == "b pauses already"
    assert orders.carried_out_by(GroundOrder(uav="b", wish="go on"), 12.0) == GiveGoal("b", ((90.0, 40.0),), at_s=12.0)
    assert not orders.pauses
    assert orders.carried_out_by(GroundOrder(uav="b", wish="go on"), 13.0) == "b does not pause"


def test_a_new_goal_and_a_landing_end_a_pause() -> None:
    """What was left to fly is then forgotten."""
    orders = GroundOrders(MISSION)
    orders.hear_fix(builders.fix("a", 20))
    orders.carried_out_by(GroundOrder(uav="a", wish="pause"), 10.0)
    goal = orders.carried_out_by(GroundOrder(uav="a", wish="goal", x_m=5.0, y_m=6.0), 11.0)
    assert goal == GiveGoal("a", ((5.0, 6.0),), at_s=11.0)
    assert not orders.pauses
    assert orders.carried_out_by(GroundOrder(uav="a", wish="land"), 12.0) == OrderLanding("a", at_s=12.0)
    assert orders.carried_out_by(GroundOrder(uav="x", wish="land"), 12.0) == "x has not been heard"


def test_what_is_no_order_is_none() -> None:
    """Bytes of the bus: an unknown wish, a bad id, a place that is none."""
    for detail in (
        "",
        "{}",
        '{"uav":"a","wish":"arm"}',
        '{"uav":"a b","wish":"land"}',
        '{"uav":"a","wish":"goal","x_m":1e99}',
    ):
        assert order_in(Event(source="ground", kind="ground-command", detail=detail)) is None
