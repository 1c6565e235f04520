"""New goals in flight: the operator's pending goals, the UAV that receives one, the messages, and lifelong missions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations
from typing import Any

import msgspec
import pytest
import shapely

from edc_swarm.agent.effects import Persist, Publish, Received, Tick
from edc_swarm.agent.node import UavNode
from edc_swarm.agent.vehicle import Promise, first_airframe, first_promise
from edc_swarm.errors import MessageError
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.faults import GiveGoal, parse_fault
from edc_swarm.mission.field_types import MAX_GOAL_POINTS
from edc_swarm.mission.lifelong import next_goal
from edc_swarm.mission.prospect import prospect_of
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.routes import Course
from edc_swarm.mission.validation import mission_from_dict
from edc_swarm.mission.zone import Zone
from edc_swarm.protocol.admission import Admission
from edc_swarm.protocol.codec import decode, encode
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.goals import PATIENCE_SLOTS, GoalAnswer, PendingGoals, answer_in
from edc_swarm.protocol.keys import Keys, kind_of, source_of
from edc_swarm.protocol.messages import Event, Fix, Goal, mission_message
from edc_swarm.recording.model import Recording
from edc_swarm.recording.sifting import sift
from processes.operator.takeover import unanswered_goals

MISSION = complete_mission(Mission(name="m", uavs=3, seed=1))
MESSAGE = msgspec.structs.replace(mission_message(MISSION), instance="operator")
ENTRY = MISSION.roster[0]
ROUTE = [(10.0, 20.0), (30.0, 40.0)]


def goal(number: int = 1, **fields: Any) -> Goal:
    """The operator's goal for the first UAV."""
    basis: dict[str, Any] = {"source": "operator", "uav": "u001", "route": ROUTE, "sent_ns": MESSAGE.epoch_ns}
    return Goal(number=number, **{**basis, **fields})


def fix(course: Course, uav: str = "u001", slot: int = 5) -> Fix:
    """A fix that tells this course."""
    return Fix(uav=uav, slot=slot, x_m=0, y_m=0, r_m=5, waypoint_x_m=0, waypoint_y_m=0, course=course)


def node(promise: Promise | None = None, *, memory: bool = True, energy_j: float = 5e4) -> UavNode:
    """The first UAV in slot 3, whose disk has this promise."""
    kept = promise or msgspec.structs.replace(first_promise(ENTRY), slot=2)
    body = msgspec.structs.replace(first_airframe(ENTRY), energy_j=energy_j)
    made = UavNode(MESSAGE, "u001", "u001-1", kept if memory else None, body)
    made.step(Tick(), MESSAGE.epoch_ns + 3 * MESSAGE.slot_ns)
    return made


def told(effects: Sequence[Any], kind: type) -> list[Any]:
    """The messages of a kind among the effects."""
    return [e.message for e in effects if isinstance(e, Publish) and isinstance(e.message, kind)]


def receive(made: UavNode, message: Goal, slot: float = 3.3) -> list[Any]:
    """The effects of a goal that comes within a slot."""
    return made.step(Received(message), MESSAGE.epoch_ns + round(slot * MESSAGE.slot_ns))


# --- the UAV ---------------------------------------------------------------------------------


def test_a_goal_is_persisted_before_it_is_acknowledged() -> None:
    """The promise with the goal is written before the fix that tells it."""
    effects = receive(node(), goal())
    kinds = [
        type(e) if isinstance(e, Persist) else type(e.message) for e in effects if isinstance(e, Persist | Publish)
    ]
    assert kinds == [Persist, Fix]
    assert effects[0].promise.course == Course(goal=1, route=ROUTE)
    (said,) = told(effects, Fix)
    assert (said.course, said.arrived) == (Course(goal=1, route=ROUTE), False)


def test_a_goal_survives_a_restart() -> None:
    """The next life flies the goal that the promise has."""
    effects = receive(node(), goal())
    again = node(effects[0].promise)
    (said,) = told(again.step(Tick(), MESSAGE.epoch_ns + 4 * MESSAGE.slot_ns), Fix)
    assert said.course == Course(goal=1, route=ROUTE)


@pytest.mark.parametrize("number", [1, 2, 3])
def test_older_goals_and_the_same_again_are_ignored(number: int) -> None:
    """Nothing happens: the next fix acknowledges the goal that the UAV flies."""
    made = node()
    receive(made, goal(3))
    assert receive(made, goal(number, route=[(1.0, 1.0)]), 3.5) == []
    (said,) = told(made.step(Tick(), MESSAGE.epoch_ns + 4 * MESSAGE.slot_ns), Fix)
    assert said.course == Course(goal=3, route=ROUTE)


def test_a_newer_goal_replaces_what_is_left() -> None:
    """The route of the older one is forgotten, whatever was left of it."""
    made = node()
    receive(made, goal(3))
    (said,) = told(receive(made, goal(8, route=[(1.0, 1.0)]), 3.5), Fix)
    assert said.course == Course(goal=8, route=[(1.0, 1.0)])


def test_a_goal_of_another_uav_is_none_of_its_business() -> None:
    """Only the UAV that the goal names takes it."""
    assert receive(node(), goal(uav="u002")) == []


def test_a_goal_that_the_battery_does_not_cover_is_refused() -> None:
    """The UAV says why, once a slot however often it is asked, and flies on."""
    made = node(energy_j=20_000.0)
    effects = receive(made, goal(route=[(5000.0, 0.0)]))
    (event,) = told(effects, Event)
    answer = answer_in(event)
    assert event.kind == EventKind.GOAL_REFUSED
    assert answer is not None
    assert (answer.uav, answer.number) == ("u001", 1)
    assert "the battery holds" in answer.reason
    assert not told(effects, Fix)
    assert receive(made, goal(route=[(5000.0, 0.0)]), 3.4) == []
    assert told(receive(made, goal(2)), Fix)[0].course.goal == 2


def test_a_uav_without_memory_refuses() -> None:
    """It flies no command for the rest of the mission, so it accepts no goal."""
    (event,) = told(receive(node(memory=False), goal()), Event)
    answer = answer_in(event)
    assert answer is not None
    assert "lost its memory" in answer.reason


# --- pending goals --------------------------------------------------------------------------------


def test_a_goal_is_repeated_once_a_slot_until_the_fix_says_it() -> None:
    """Goal or acknowledgement may be lost: the operator sends it until a fix carries number and target."""
    pending = PendingGoals(MISSION)
    pending.give("u001", ROUTE, 5)
    assert [each.number for each in pending.due(5)] == [1]
    assert pending.due(5) == []
    pending.hear_fix(fix(Course()))
    assert [each.route for each in pending.due(6)] == [ROUTE]
    pending.hear_fix(fix(Course(goal=1, leg=1, route=ROUTE[1:])))
    assert not pending.waits
    assert pending.due(7) == []


def test_a_number_that_is_taken_is_followed_by_the_next() -> None:
    """Another client was faster with the same number: the operator's goal gets a higher one."""
    pending = PendingGoals(MISSION)
    pending.give("u001", ROUTE, 5)
    pending.hear_fix(fix(Course(goal=1, route=[(9.0, 9.0)])))
    assert [(each.number, each.route) for each in pending.due(6)] == [(2, ROUTE)]
    pending.hear_fix(fix(Course(goal=7, route=[(8.0, 8.0)])))
    assert not pending.waits
    pending.give("u001", ROUTE, 7)
    assert [each.number for each in pending.due(7)] == [8]


def test_a_refused_goal_is_not_repeated() -> None:
    """The event of another UAV, of another number or without sense changes nothing."""
    pending = PendingGoals(MISSION)
    pending.give("u001", ROUTE, 5)

    def refusal(source: str, number: int) -> Event:
        detail = msgspec.json.encode(GoalAnswer(source, number, "too far")).decode()
        return Event(source=source, kind=EventKind.GOAL_REFUSED, detail=detail)

    for event in (refusal("u002", 1), refusal("u001", 9), Event(source="u001", kind="goal-refused", detail="?")):
        pending.hear_event(event)
    assert pending.waits
    pending.hear_event(refusal("u001", 1))
    assert not pending.waits


def test_a_dead_uav_is_given_up() -> None:
    """After `PATIENCE_SLOTS` without an answer the pending says so, once."""
    pending = PendingGoals(MISSION)
    pending.give("u001", ROUTE, 5)
    assert pending.given_up(4 + PATIENCE_SLOTS) == []
    (answer,) = pending.given_up(5 + PATIENCE_SLOTS)
    assert (answer.uav, answer.number) == ("u001", 1)
    assert pending.given_up(6 + PATIENCE_SLOTS) == []
    assert not pending.waits


def test_a_newer_goal_replaces_the_one_that_waits() -> None:
    """The number grows, and only the newer one is sent."""
    pending = PendingGoals(MISSION)
    pending.give("u001", ROUTE, 5)
    pending.give("u001", [(1.0, 1.0)], 6)
    assert [(each.number, each.route) for each in pending.due(6)] == [(2, [(1.0, 1.0)])]


# --- messages and faults ---------------------------------------------------------------------


def test_the_key_names_sender_and_receiver() -> None:
    """`goal/{source}/to/{uav}`: the key's sender must be the message's."""
    keys = Keys("m")
    assert keys.of(goal()) == keys.goal("operator", "u001") == "swarm/m/goal/operator/to/u001"
    assert kind_of("swarm/m/goal/operator/to/u001") is Goal
    assert source_of("swarm/m/goal/operator/to/u001") == "operator"
    assert decode(keys.of(goal()), encode(goal())) == goal()
    with pytest.raises(MessageError):
        decode(keys.goal("someone", "u001"), encode(goal()))


@pytest.mark.parametrize("route", [[], [(0.0, 0.0)] * (MAX_GOAL_POINTS + 1), [(1e8, 0.0)]])
def test_a_malformed_route_does_not_decode(route: list[tuple[float, float]]) -> None:
    """From one point to the most that a promise holds, each within the limits of coordinates."""
    with pytest.raises(MessageError):
        decode("swarm/m/goal/operator/to/u001", msgspec.json.encode(goal(route=route)))


def test_only_the_operator_gives_goals_unless_the_mission_lets_others() -> None:
    """`goals_from = "any"` admits every sender; nobody may send for an unknown UAV, or from before the mission."""
    strict = Admission(MESSAGE)
    open_to_all = Admission(msgspec.structs.replace(MESSAGE, goals_from="any"))
    assert strict.refusal(goal()) is None
    assert "operator alone" in (strict.refusal(goal(source="someone")) or "")
    assert open_to_all.refusal(goal(source="someone")) is None
    assert open_to_all.refusal(goal(uav="u009")) is not None
    late = Admission(msgspec.structs.replace(MESSAGE, sent_ns=MESSAGE.epoch_ns))
    assert "before the mission" in (late.refusal(goal(sent_ns=MESSAGE.epoch_ns - 1)) or "")


def test_a_recording_keeps_the_goals_of_this_run() -> None:
    """Goals of the operator stay; those of an unknown sender are counted as garbage."""
    recording = Recording.from_messages([MESSAGE, goal(instance="operator"), goal(source="someone", instance="x")])
    sift(recording)
    assert [each.source for each in recording.goals] == ["operator"]
    assert recording.garbage_count == 1


@pytest.mark.parametrize("text", ["goal u003 120,40 80,40 @20", "goal head 0,-1.5 @3.2s"])
def test_the_verb_reads_and_writes_points(text: str) -> None:
    """The canonical text reads as the same fault."""
    fault = parse_fault(text, 0.5)
    assert isinstance(fault, GiveGoal)
    assert parse_fault(str(fault), 0.5) == fault


@pytest.mark.parametrize(
    "text", ["goal u003 @20", "goal u003 1 @20", "goal u003 1,2,3 @2", "goal u003 a,b @2", "goal u003 1,2 @2 for 3"]
)
def test_bad_goals_are_refused(text: str) -> None:
    """The error shows the syntax."""
    with pytest.raises(Exception, match="X,Y"):
        parse_fault(text, 0.5)


def test_the_limit_of_progress_counts_the_goals_of_faults() -> None:
    """A goal far away makes the mission longer."""
    plain, far = prospect_of(MISSION, []), parse_fault("goal u001 2000,0 @20", 0.5)
    assert prospect_of(MISSION, [far]).limit_slots > plain.limit_slots + 20 * 1800 / 2.5


# --- lifelong --------------------------------------------------------------------------------


def test_lifelong_goals_are_those_of_seed_uav_and_number() -> None:
    """The same again for the same, another place than the one where the UAV is, and disjoint for all UAVs."""
    mission = complete_mission(mission_from_dict({"uavs": 8, "seed": 3, "goals": "lifelong", "area_m2": 40_000.0}))
    targets: dict[str, set[tuple[float, float]]] = {}
    for entry in mission.roster:
        here_m = (entry.target_x_m, entry.target_y_m)
        targets[entry.uav] = {here_m}
        for number in range(1, 20):
            to_m = next_goal(mission, entry.uav, number, here_m)
            assert to_m == next_goal(mission, entry.uav, number, here_m)
            assert math.dist(to_m, here_m) > 1
            targets[entry.uav].add(to_m)
            here_m = to_m
        assert len(targets[entry.uav]) > 3
    for one, other in combinations(targets.values(), 2):
        assert min(math.dist(a, b) for a in one for b in other) >= 10.5
    elsewhere = msgspec.structs.replace(mission, seed=4)
    assert next_goal(elsewhere, "u001", 1, (0, 0)) != next_goal(mission, "u001", 1, (0, 0))


def test_without_room_a_uav_flies_somewhere_all_the_same() -> None:
    """In a field that one disc fills, the only site is the target: then a place of chance is the goal."""
    raw = {"uav": "a", "start_x_m": 0.0, "start_y_m": 0.0, "target_x_m": 3.0, "target_y_m": 3.0}
    mission = complete_mission(mission_from_dict({"goals": "lifelong", "roster": [raw]}))
    x_m, y_m = next_goal(mission, "a", 1, (3.0, 3.0))
    assert 0 <= x_m <= 3
    assert 0 <= y_m <= 3


ZONED: dict[str, Any] = {
    "uavs": 6,
    "seed": 3,
    "goals": "lifelong",
    "area_m2": 40_000.0,
    "r_m": 3.0,
    "zone": [
        {"name": "yard", "kind": "inclusion", "polygon": [[5, 5], [195, 5], [195, 195], [100, 120], [5, 195]]},
        {"name": "west", "kind": "inclusion", "centre": [60.0, 100.0], "radius_m": 110.0, "keep": "disc"},
        {"name": "tower", "kind": "exclusion", "centre": [75.0, 60.0], "radius_m": 20.0},
        {"name": "wall", "kind": "exclusion", "polygon": [[120, -5], [124, -5], [124, 145], [120, 145]]},
    ],
}
"""Two fences, a tower, and a wall that closes the east off."""


def test_lifelong_goals_keep_to_all_zones() -> None:
    """Every goal is inside all fences, outside all exclusion zones by the radius, and on the UAV's side of a wall."""
    mission = complete_mission(mission_from_dict(ZONED))
    yard, west, tower, wall, _ = (
        shapely.Polygon(zone.polygon) if zone.polygon else shapely.Point(zone.centre).buffer(zone.radius_m, 256)
        for zone in mission.zone
    )
    free = yard.intersection(west.buffer(-3.0)).difference(tower.buffer(3.0)).difference(wall.buffer(3.0))
    assert len(shapely.get_parts(free)) == 2
    for entry in mission.roster:
        here_m = (entry.target_x_m, entry.target_y_m)
        part = next(each for each in shapely.get_parts(free) if each.buffer(0.1).covers(shapely.Point(here_m)))
        goals = set()
        for number in range(1, 30):
            here_m = next_goal(mission, entry.uav, number, here_m)
            goals.add(here_m)
        assert len(goals) > 3
        assert all(part.buffer(0.01).covers(shapely.Point(point)) for point in goals)


def test_zones_that_leave_no_other_place_send_a_uav_to_and_fro() -> None:
    """The goal is the start, then the target."""
    tight = {"name": "tube", "kind": "inclusion", "polygon": [[-1, -1], [0, -1], [31, 29], [31, 31], [30, 31], [-1, 0]]}
    hole = {"name": "hole", "kind": "exclusion", "polygon": [[1, 1], [29, 1], [29, 29], [1, 29]], "keep": "centre"}
    raw = {"uav": "a", "start_x_m": 0.0, "start_y_m": 0.0, "target_x_m": 30.0, "target_y_m": 30.0}
    fields = {"goals": "lifelong", "roster": [raw], "zone": [tight]}
    mission = complete_mission(mission_from_dict(fields))
    closed = msgspec.structs.replace(mission, zone=[*mission.zone, msgspec.convert(hole, Zone)])
    assert next_goal(closed, "a", 1, (30.0, 30.0)) == (0.0, 0.0)
    assert next_goal(closed, "a", 2, (0.0, 0.0)) == (30.0, 30.0)


# --- take-over -------------------------------------------------------------------------------


def recorded(*messages: Goal | Fix | Event) -> list[Goal]:
    """What the next operator finds unanswered in a record of these messages."""
    recording = Recording(missions=[MESSAGE])
    for message in messages:
        recording.lists()[type(message)].append(message)
    return unanswered_goals(recording)


def test_the_next_operator_goes_on_giving_goals_without_an_answer() -> None:
    """Accepted, refused and given-up goals are not given again; the newest of a UAV is, under its number."""
    other = goal(uav="u002")
    refusal = msgspec.json.encode(GoalAnswer("u001", 1, "far")).decode()
    refused = Event(source="u001", kind=EventKind.GOAL_REFUSED, detail=refusal)
    given_up = Event(source="operator", kind=EventKind.GOAL_UNANSWERED, detail=refusal)
    assert recorded(goal(), other, goal(), goal(2)) == [goal(2), other]
    assert recorded(goal(), other, fix(Course(goal=1, route=ROUTE))) == [other]
    for answer in (refused, given_up):
        assert recorded(goal(), other, answer) == [other]
        assert recorded(goal(2), answer) == [goal(2)]
    assert recorded(goal(source="stranger")) == []
    pending = PendingGoals(MISSION)
    pending.resume(goal(7), 30)
    assert pending.due(31) == [goal(7)]
    pending.give("u001", [(1.0, 1.0)], 31)
    assert [each.number for each in pending.due(32)] == [8]
