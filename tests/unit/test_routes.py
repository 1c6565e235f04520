"""Routes: the mission's fields, the course of a UAV from step to step, and where a plan aims."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import pytest

from edc_swarm.agent.vehicle import Vehicle, first_airframe, first_promise
from edc_swarm.emulation.energy import full_speed_energy_j, propulsion_power_w
from edc_swarm.errors import MissionError
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.prospect import prospect_of
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.mission.routes import Course, aim_m, headed, rectangle_m, way_m
from edc_swarm.mission.validation import mission_from_dict
from edc_swarm.protocol.admission import Admission
from edc_swarm.protocol.messages import Command, Fix, mission_message

ROUTE = [[10.0, 0.0], [10.0, 10.0], [0.0, 10.0]]
RAW: dict[str, Any] = {"uav": "a", "start_x_m": 0.0, "start_y_m": 0.0, "route": ROUTE}


def entry(**fields: Any) -> RosterEntry:
    """The UAV of a valid mission with these fields of its own."""
    return complete_mission(mission_from_dict({"roster": [{**RAW, **fields}]})).roster[0]


def refused(**fields: Any) -> MissionError:
    """The error of a mission whose UAV has these fields."""
    with pytest.raises(MissionError) as error:
        mission_from_dict({"roster": [{**RAW, **fields}]})
    return error.value


# --- the mission -----------------------------------------------------------------------------


def test_the_last_point_is_the_target() -> None:
    """A route makes the target unnecessary, and the straight way is the way along it."""
    made = entry()
    assert (made.target_x_m, made.target_y_m) == (0.0, 10.0)
    assert made.straight_m == 30.0
    assert entry(target_x_m=0.0, target_y_m=10.0) == made


@pytest.mark.parametrize(
    ("fields", "field", "allowed"),
    [
        ({"target_x_m": 1.0, "target_y_m": 10.0}, "roster[0].target_x_m, target_y_m", "the last point of route"),
        ({"hover_s": [1.0]}, "roster[0].hover_s", "as long as route (3)"),
        ({"hover_s": [1.0, -1.0, 0.0]}, "roster[0].hover_s[1]", "from 0"),
        ({"accept_m": 0.05}, "roster[0].accept_m", "from 0.1"),
        ({"route": []}, "roster[0]", "or with a route"),
        ({"route": [[1.0]]}, "roster[0].route[0]", "a point [x, y]"),
        ({"route": [[1.0, "x"]]}, "roster[0].route[0][1]", "a number"),
        ({"route": [[1.0, math.inf]]}, "roster[0].route[0][1]", "finite"),
        ({"route": [[0.0, 0.0]] * 1001}, "roster[0].route", "at most 1000 points"),
        ({"finish_by_s": -1.0}, "roster[0].finish_by_s", "from 0"),
    ],
)
def test_bad_routes_are_refused(fields: dict[str, Any], field: str, allowed: str) -> None:
    """The error names the field and what is allowed."""
    error = refused(**fields)
    assert error.field == field
    assert allowed in error.allowed


def test_the_limit_of_progress_counts_the_way_and_the_hovering() -> None:
    """30 m at 5 m/s and 4 s of hovering: 20 times 20 slots, and 200."""
    mission = complete_mission(mission_from_dict({"roster": [{**RAW, "hover_s": [4.0, 0.0, 9.0]}]}))
    assert prospect_of(mission, []).limit_slots == 20 * (12 + 8) + 200


def test_energy_counts_the_way_and_the_hovering() -> None:
    """Flight along the route at full speed, and hovering at the points but the last."""
    made, mission = entry(hover_s=[4.0, 0.0, 9.0]), Mission()
    expected_j = propulsion_power_w(5.0, mission.energy) * 6 + propulsion_power_w(0.0, mission.energy) * 4
    assert full_speed_energy_j(mission, made) == pytest.approx(expected_j)


def test_a_rectangle_holds_all_points() -> None:
    """Starts and all points of routes count."""
    assert rectangle_m([entry(start_x_m=-3.0)]) == ((-3.0, 0.0), (10.0, 10.0))


def test_a_uav_headed_elsewhere_keeps_the_rest() -> None:
    """Only the way is another."""
    made = headed(entry(hover_s=[1.0, 0.0, 0.0]), (3.0, 4.0))
    assert (made.points, made.r_m, made.straight_m) == ([(3.0, 4.0)], 5.0, 5.0)


# --- the course ------------------------------------------------------------------------------


def test_a_step_that_comes_near_enough_reaches_the_point() -> None:
    """What counts is the nearest place of the step, not its end."""
    made = entry()
    near, far = Course().after_step(made, (9.0, -1.0), (11.0, 1.0), 1, 0.5), Course()
    assert near.leg == 1
    assert far.after_step(made, (9.0, -1.1), (9.0, -3.0), 1, 0.5) == far
    assert Course().after_step(made, (8.0, 0.0), (9.0, 0.0), 1, 0.5).leg == 1
    assert Course().after_step(made, (8.0, 0.0), (math.nextafter(9.0, 0), 0.0), 1, 0.5).leg == 0


def test_one_step_may_reach_several_points_in_their_order() -> None:
    """A point that the step passes before its predecessor does not count."""
    made = entry(route=[[4.0, 0.0], [8.0, 0.0], [6.0, 0.0], [0.0, 30.0]], accept_m=0.5)
    assert Course().after_step(made, (0.0, 0.0), (10.0, 0.0), 1, 0.5).leg == 2


def test_the_last_point_is_never_passed() -> None:
    """A UAV that is at the last point has arrived only if it has reached all others."""
    made = entry(route=[[5.0, 0.0], [0.0, 0.0]])
    assert not Course().arrived(made, (0.0, 0.0))
    there = Course().after_step(made, (4.0, 0.0), (5.0, 0.0), 1, 0.5)
    assert not there.arrived(made, (5.0, 0.0))
    assert there.after_step(made, (5.0, 0.0), (0.0, 0.0), 1, 0.5).leg == 1
    assert there.arrived(made, (0.05, 0.0))


def test_hovering_takes_its_slots_within_the_radius() -> None:
    """The step that comes there does not count; a slot outside does not count either, and nothing is lost by it."""
    made, course = entry(hover_s=[1.2, 0.0, 0.0]), Course()
    here_m = (10.0, 0.0)
    course = course.after_step(made, (8.0, 0.0), here_m, 1, 0.5)
    assert (course.leg, course.hovered, course.hover_slots(made, 0.5)) == (0, 0, 3)
    course = course.after_step(made, here_m, here_m, 1, 0.5)
    assert (course.leg, course.hovered) == (0, 1)
    course = course.after_step(made, here_m, (10.0, -3.0), 1, 0.5).after_step(made, (10.0, -3.0), here_m, 1, 0.5)
    assert (course.leg, course.hovered) == (0, 1)
    course = course.after_step(made, here_m, here_m, 1, 0.5)
    assert (course.leg, course.hover_slots(made, 0.5)) == (0, 1)
    assert course.after_step(made, here_m, here_m, 1, 0.5) == Course(leg=1)
    assert course.after_step(made, here_m, here_m, 7, 0.5) == Course(leg=1)


def test_the_promise_carries_the_course() -> None:
    """A vehicle that starts from a promise goes on where it was; its fixes and its next promise say so."""
    mission = complete_mission(mission_from_dict({"roster": [RAW]}))
    made = mission.roster[0]
    promise = msgspec.structs.replace(first_promise(made), waypoint_x_m=9.5, course=Course(leg=1))
    vehicle = Vehicle(mission, made, promise, first_airframe(made))
    assert vehicle.course.left(made) == [(10.0, 10.0), (0.0, 10.0)]
    step: dict[str, Any] = {"start_x_m": 9.5, "start_y_m": 0.0, "target_x_m": 10.0, "target_y_m": 2.0}
    vehicle.begin_slot(1, Command(head="a", uav="a", slot=1, term=1, **step))
    assert (vehicle.course.leg, vehicle.arrived) == (1, False)


@pytest.mark.parametrize(
    ("course", "fits"),
    [
        (Course(), True),
        (Course(leg=2), True),
        (Course(leg=3), False),
        (Course(route=[(1.0, 1.0)]), False),
        (Course(goal=1), False),
        (Course(goal=1, leg=9, route=[(1.0, 1.0)]), True),
    ],
)
def test_a_fix_with_an_impossible_course_is_rejected(course: Course, fits: bool) -> None:
    """Goal 0 has the points of the roster, a later one at least one of its own."""
    message = mission_message(complete_mission(mission_from_dict({"roster": [RAW]})))
    fix = Fix(uav="a", slot=0, x_m=0, y_m=0, r_m=5, waypoint_x_m=0, waypoint_y_m=0, course=course)
    reason = Admission(message).refusal(msgspec.structs.replace(fix, sent_ns=message.epoch_ns))
    assert (reason is None) == fits


# --- the aim ---------------------------------------------------------------------------------


def test_far_away_the_aim_is_the_point() -> None:
    """Beyond one step nothing lies ahead of the present point."""
    assert aim_m((0.0, 0.0), [(10.0, 0.0), (10.0, 10.0)], 1.0, 2.5) == (10.0, 0.0)
    assert aim_m((9.0, 0.0), [(10.0, 0.0)], 1.0, 2.5) == (10.0, 0.0)


@pytest.mark.parametrize("turn_deg", range(0, 360, 15))
@pytest.mark.parametrize("accept_m", [0.1, 0.5, 2.0])
def test_a_full_step_to_the_aim_passes_the_point(turn_deg: int, accept_m: float) -> None:
    """At every turn the aim is within one step, and the step there reaches the point; straight on, no way is lost."""
    turn = math.radians(turn_deg)
    left = [(10.0, 0.0), (10.0 + 20 * math.cos(turn), 20 * math.sin(turn))]
    for start_x_m in (7.6, 8.5, 9.4, 10.0):
        here_m = (start_x_m, 0.0)
        aim = aim_m(here_m, left, accept_m, 2.5)
        assert math.dist(here_m, aim) <= 2.5 + 1e-12
        made = entry(route=[*left], accept_m=accept_m)
        assert Course().after_step(made, here_m, aim, 1, 0.5).leg == 1
        if turn_deg == 0:
            assert math.dist(here_m, aim) == pytest.approx(2.5)


def test_the_way_beyond_the_aim_is_what_is_left() -> None:
    """Aim and rest add up to the way along the route, hovering counts as flying, and a hovering UAV stays."""
    made = entry(hover_s=[0.0, 2.0, 0.0])
    left = Course().left(made)
    for here_m in ((0.0, 0.0), (7.7, 0.0), (9.0, 0.0)):
        aim, rest_m = Course().aim(made, here_m, 2.5, 0.5)
        assert rest_m == pytest.approx(way_m([aim, *left[1:]]))
    assert Course(leg=1).aim(made, (10.0, 9.0), 2.5, 0.5) == ((10.0, 10.0), 10.0 + 4 * 2.5)
    assert Course(leg=1, hovered=3).aim(made, (10.0, 10.0), 2.5, 0.5) == ((10.0, 10.0), 10.0 + 2.5)


def test_repeated_points_are_no_trouble() -> None:
    """A route that names a place twice flies on."""
    made = entry(route=[[10.0, 0.0], [10.0, 0.0], [0.0, 0.0]])
    assert aim_m((9.5, 0.0), [(10.0, 0.0), (10.0, 0.0), (0.0, 0.0)], 1.0, 2.5) == (10.0, 0.0)
    assert Course().after_step(made, (8.0, 0.0), (9.5, 0.0), 1, 0.5).leg == 2
