"""UAVs that no longer fly keep another from its target: they cover it, hold the UAV, or close it in."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from edc_swarm.geometry import Barriers, point_segment_distance_m
from edc_swarm.mission.zone import Zone
from edc_swarm.mission.zones import barriers
from edc_swarm.planner import edc
from edc_swarm.protocol.completion import MissionMonitor
from edc_swarm.protocol.hindrance import BUFFER_M, TOUCH_M, Place, Point, hindrance, hindrances, places_of
from edc_swarm.solver.barrier_rows import Airspace
from edc_swarm.solver.hull_rows import Obstacles
from edc_swarm.solver.normals import DELTA_M
from edc_swarm.solver.slot_qp import slot_problem
from tests.builders import entry, fix, hulls, mission, report

R_M = 5.0
HERE: Point = (0.0, 0.0)
FAR: Point = (100.0, 0.0)


def disc(uav: str, x_m: float, y_m: float) -> Place:
    """The disc of a dead UAV."""
    return Place(uav, "disc", (x_m, y_m), (x_m, y_m), 0.0, R_M)


def hull(uav: str, a_m: Point, b_m: Point, radius_m: float = 0.0) -> Place:
    """Where a dead UAV can be."""
    return Place(uav, "hull", a_m, b_m, radius_m, R_M)


def ring(radius_m: float, count: int, centre_m: Point = HERE) -> list[Place]:
    """Discs about a point."""
    turns = [math.tau * k / count for k in range(count)]
    return [
        disc(f"u{k}", centre_m[0] + radius_m * math.cos(turn), centre_m[1] + radius_m * math.sin(turn))
        for k, turn in enumerate(turns)
    ]


def kind(position_m: Point, target_m: Point, places: list[Place]) -> str:
    """The kind of hindrance, "" for none."""
    found = hindrance(position_m, target_m, R_M, places)
    return "" if found is None else found.kind


def test_heads_of_other_clusters_keep_a_step_more_away() -> None:
    """A dead UAV covers targets of its own cluster as its disc, those of others as that and its longest step."""
    roster = [
        msgspec.structs.replace(entry(uav), target_x_m=100.0, target_y_m=0.0, r_m=R_M, cluster=cluster)
        for uav, cluster in (("own", "a"), ("other", "b"))
    ]
    dead = msgspec.structs.replace(entry("dead"), r_m=R_M, cluster="a")
    for gap_m, hindered in ((-0.1, {"own", "other"}), (0.1, {"other"}), (1.9, {"other"}), (2.1, set[str]())):
        (place,) = places_of(dead, (100.0, 2 * R_M + gap_m), None, step_m=2.0)
        found = hindrances([(each, HERE) for each in roster], [place])
        assert found.keys() == hindered
        assert {each.kind for each in found.values()} <= {"covered"}


def test_the_buffer_is_that_of_the_planner() -> None:
    """What the slot QP cannot fly through is no passage."""
    assert BUFFER_M == DELTA_M
    assert TOUCH_M == edc.TOUCH_M


@pytest.mark.parametrize(
    ("places", "expected"),
    [
        ([], ""),
        ([disc("a", 100, 9.99)], "covered by a's disc"),
        ([disc("a", 100, 10.01)], ""),
        ([hull("a", (90, 12), (110, 12), 2.5), disc("b", 0, 9)], "covered by a's hull"),
        # One place alone holds nobody that is outside it, two on opposite sides do.
        ([hull("a", (-3, -8), (-3, 8), 2.5)], ""),
        ([hull("a", (-3, -8), (-3, 8), 3.5)], "held by a's hull"),
        ([hull("a", (-8, -8), (-8, 8), 1), hull("b", (8, -8), (8, 8), 1)], "held by a's hull and b's hull"),
        # Seen to the left and below: away from both is up and to the right.
        ([disc("a", -8, 0), disc("b", 0, -8)], ""),
        ([disc("a", -8, 0), disc("b", 4, -6), disc("c", 4, 6)], "held by a's disc and b's disc and c's disc"),
        # Across the direction of 180 degrees.
        ([disc("a", -8, 0.1), disc("b", -8, -0.1)], ""),
    ],
)
def test_covered_and_held(places: list[Place], expected: str) -> None:
    """By R about the target, and by the directions in which the near places are seen."""
    found = hindrance(HERE, FAR, R_M, places)
    assert ("" if found is None else str(found)) == expected


def test_held_is_what_the_slot_qp_holds() -> None:
    """In random places: held exactly where no direction keeps all rows of the slot QP, or the UAV is within a hull."""
    random = np.random.default_rng(5)
    held = 0
    turns = np.linspace(0, math.tau, 20001)
    direction = np.stack([np.cos(turns), np.sin(turns)], axis=-1)
    for _ in range(300):
        count = int(random.integers(1, 4))
        a_m = random.uniform(-12, 12, (count, 2))
        b_m, radius_m = a_m + random.uniform(-6, 6, (count, 2)), random.uniform(0, 4, count)
        places = [
            hull(str(k), tuple(a_m[k].tolist()), tuple(b_m[k].tolist()), float(radius_m[k])) for k in range(count)
        ]
        problem = slot_problem(
            np.zeros((1, 2)), np.zeros((1, 2)), np.array([R_M]), 1.0, Obstacles(a_m, b_m, radius_m, np.full(count, R_M))
        )
        normal = problem.row_normal[problem.row_room_m == 0]
        expected = bool(problem.frozen[0]) or not (direction @ normal.T >= 0).all(axis=1).any()
        held += expected
        assert (kind(HERE, FAR, places) == "held") is expected
    assert 50 < held < 250, "the places show both"


def test_closed_in() -> None:
    """A ring without a gap about the UAV or about its target; not one about both, nor an open one."""
    closed = ring(30.0, 10)  # 18.5 m apart
    assert kind(HERE, FAR, closed) == "closed in"
    assert kind(FAR, HERE, closed) == "closed in"
    assert kind((5.0, 0.0), HERE, closed) == ""
    assert kind(HERE, FAR, closed[1:]) == ""
    assert kind((200.0, 0.0), FAR, closed) == ""
    chain = hindrance(HERE, FAR, R_M, [*closed, disc("elsewhere", 300, 0)])
    assert chain is not None
    assert chain.uavs == [f"u{k}" for k in range(10)]


@pytest.mark.parametrize(("spare_m", "expected"), [(-1e-3, "closed in"), (2 * DELTA_M + 1e-3, "")])
def test_the_passage_is_twice_r_and_buffer(spare_m: float, expected: str) -> None:
    """Between neighbours of a ring a disc must fit, with the slot QP's buffer on either side."""
    radius_m = (4 * R_M + spare_m) / (2 * math.sin(math.pi / 8))
    assert kind(HERE, FAR, ring(radius_m, 8)) == expected


def test_two_long_hulls_close_in_a_uav_near_one_of_them() -> None:
    """Two V shapes that overlap form a ring; nearer than R to one of them a UAV may leave, but not through it."""
    box = [hull("a", (-20, -20), (20, -20), 1), hull("b", (20, -20), (20, 20), 1)]
    box += [hull("c", (20, 20), (-20, 20), 1), hull("d", (-20, 20), (-20, -20), 1)]
    assert kind((0.0, -11.0), FAR, box) == "closed in"
    assert kind((0.0, -11.0), FAR, box[:3]) == ""


def test_a_uav_that_is_held_is_in_the_way_of_others() -> None:
    """Its disc covers another one's target; where it is free to move, it does not."""
    held = entry("h", target_m=(90.0, 0.0), r_m=R_M)
    other = entry("o", target_m=(9.0, -3.0), r_m=R_M)
    away = [(other, (60.0, 60.0)), (held, HERE)]
    sides = [hull("a", (-8, -8), (-8, 8), 1), hull("b", (-8, 9), (8, 9), 1)]
    found = hindrances(away, sides)
    assert {uav: str(why) for uav, why in found.items()} == {
        "o": "covered by h's disc", "h": "held by a's hull and b's hull"
    }  # fmt: skip
    assert hindrances(away, sides[:1]) == {}


# --- the end of the mission --------------------------------------------------------------------

ROSTER = [
    entry(uav, start_m, (60.0 * k, 90.0), r_m=R_M)
    for k, (uav, start_m) in enumerate(zip("abcde", ((0, 0), (-8, 3), (8, 3), (0, -8), (90, 0)), strict=True))
]


def monitor(scale: int = 1) -> MissionMonitor:
    """A monitor that has heard in slot 9 that e is at its target, and the others `scale` times as far out as above."""
    judge = MissionMonitor(mission(ROSTER, failsafe="hold"))
    for one in ROSTER:
        place_m = (scale * one.start_x_m, scale * one.start_y_m)
        judge.hear_fix(fix(one.uav, 9, place_m, r_m=R_M, arrived=one.uav == "e"))
    return judge


def test_a_mission_does_not_wait_for_a_uav_that_dead_ones_hold() -> None:
    """Complete for the living: as soon as all three neighbours are gone for good, and not before."""
    judge = monitor()
    for uav in "bcd":
        assert not judge.complete(9)
        judge.end(uav)
    assert judge.complete(9)
    judge.revive("c")
    assert not judge.complete(9)


def test_the_newest_hulls_hold() -> None:
    """By where it can be as the newest plan says, not only by where the dead UAV was seen last."""
    judge = monitor(scale=4)
    for uav in "bcd":
        judge.end(uav)
    assert not judge.complete(9)
    places = {"b": ((-32.0, 12.0), (-8.0, 0.0), 1.0), "c": ((32.0, 12.0), (8.0, 0.0), 1.0)}
    judge.hear_report(report(9, 2, "e", quorum=3, grants=["a", "d", "e"], **hulls(places)))
    assert judge.complete(9)


# --- zones -------------------------------------------------------------------------------------

AREA = Zone(name="area", kind="inclusion", polygon=[(-50.0, -50.0), (200.0, -50.0), (200.0, 50.0), (-50.0, 50.0)])
FENCE = barriers([AREA])


def with_zones(position_m: Point, target_m: Point, places: list[Place], walls: Barriers = FENCE) -> str:
    """The hindrance in words, "" for none."""
    return str(hindrance(position_m, target_m, R_M, places, walls) or "")


def test_a_hull_and_a_fence_hold_a_uav() -> None:
    """Fuzz seed 654: a UAV nearer than R to a wide hull may not fly along the fence that it touches."""
    wide, target_m = hull("a", (165.0, 0.0), (165.0, 0.0), 27.5), (180.0, 45.0)
    assert with_zones((199.98, 9.6), target_m, [wide]) == "held by a's hull and zones"
    assert with_zones((199.9, 9.6), target_m, [wide]) == "", "it does not touch the fence"
    assert with_zones((199.98, 9.6), target_m, [disc("a", 190.5, 9.6)]) == "", "it may fly along the fence"
    assert with_zones((199.98, 9.6), target_m, []) == ""
    cornered = hull("a", (165.0, 20.0), (165.0, 20.0), 27.5)
    assert with_zones((199.9, 29.6), (180.0, -40.0), [cornered]) == "closed in by a's hull and zones"


def test_zones_hold_only_whom_no_step_is_left() -> None:
    """In random places at a fence and in its corner: held exactly where no direction keeps the rows of the slot QP."""
    random, turns, held = np.random.default_rng(7), np.linspace(0, math.tau, 20001), 0
    direction = np.stack([np.cos(turns), np.sin(turns)], axis=-1)
    airspace = Airspace.of(FENCE, R_M, 10.0)
    for _ in range(100):
        here_m = np.array([[199.98, random.choice([0.0, 49.98])]])
        a_m = here_m + random.uniform(-12, 12, (1, 2))
        b_m, radius_m = a_m + random.uniform(-6, 6, (1, 2)), random.uniform(0, 4, 1)
        obstacles = Obstacles(a_m, b_m, radius_m, np.full(1, R_M))
        problem = slot_problem(here_m, here_m, np.array([R_M]), 1.0, obstacles, airspace=airspace)
        normal = problem.row_normal[problem.row_room_m < TOUCH_M]
        is_near = bool((point_segment_distance_m(here_m, a_m, b_m) < radius_m + 2 * R_M).all())
        expected = is_near and (bool(problem.frozen[0]) or not (direction @ normal.T >= 0).all(axis=1).any())
        held += expected
        place = hull("a", tuple(a_m[0].tolist()), tuple(b_m[0].tolist()), float(radius_m[0]))
        assert with_zones(tuple(here_m[0].tolist()), (-40.0, -40.0), [place]).startswith("held") is expected
    assert 10 < held < 90, "the places show both"


def test_a_hull_across_a_corridor_closes_in() -> None:
    """It reaches from fence to fence, or leaves a passage; a zone that is no part of the ring does not matter."""
    across = hull("a", (90.0, -30.0), (90.0, 30.0), 10.0)
    assert kind(HERE, (180.0, 0.0), [across]) == ""
    assert with_zones(HERE, (180.0, 0.0), [across]) == "closed in by a's hull and zones"
    assert with_zones(HERE, (60.0, 0.0), [across]) == ""
    short = hull("a", (90.0, -30.0), (90.0, 24.9), 10.0)
    assert with_zones(HERE, (180.0, 0.0), [short]) == "", "20.1 m are left, and a centre needs 20"
    block = Zone(name="block", kind="exclusion", polygon=[(30.0, -5.0), (40.0, -5.0), (40.0, 5.0), (30.0, 5.0)])
    walls = barriers([AREA, block])
    assert with_zones(HERE, (180.0, 0.0), [short], walls) == ""
    assert with_zones(HERE, (60.0, 0.0), [across], walls) == ""


def test_a_mission_ends_when_zones_and_hulls_hold_the_last_uav() -> None:
    """A UAV beside a dead one's hull in a corner of the fence keeps nobody waiting; elsewhere it does."""
    zones = [
        Zone(name="area", kind="inclusion", polygon=[(-40.0, -20.0), (100.0, -20.0), (100.0, 100.0), (-40.0, 100.0)])
    ]
    away = [(entry("h", target_m=(0.0, 90.0), r_m=R_M), (-39.99, -19.99))]
    places = [hull("a", (-31.0, -11.0), (-31.0, -11.0), 5.0)]
    assert {uav: str(why) for uav, why in hindrances(away, places, zones).items()} == {
        "h": "held by a's hull and zones"
    }
    assert hindrances(away, places) == {}
