"""Making room in tight places: UAVs that block each other between zones move aside, and all get home."""

from __future__ import annotations

import itertools
import math
import tomllib
from collections import deque
from pathlib import Path
from random import Random

import msgspec
import numpy as np
import pytest

from edc_swarm.geometry import Floats, Indices, closest_approach_m, length_m, segment_distance_m
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.roster_entry import ARRIVED_M, RosterEntry
from edc_swarm.mission.validation import mission_from_dict
from edc_swarm.mission.zone import Zone
from edc_swarm.mission.zones import barriers
from edc_swarm.planner import room as room_module
from edc_swarm.planner.charts import Charts
from edc_swarm.planner.interface import PlanRequest
from edc_swarm.planner.registry import make_planner
from edc_swarm.planner.roadmap import Box, Roadmap, roadmap
from edc_swarm.planner.room import Room, Script, _moves, _script_of
from edc_swarm.planner.ways import walls_of
from edc_swarm.solver.barrier_rows import Airspace
from edc_swarm.solver.hull_rows import Obstacles

R_M = 3.0
HALF_M = R_M + 0.05
"""Half the width of a lane for one disc."""
Pair = tuple[tuple[float, float], tuple[float, float]]


def fence(*corners: tuple[float, float], kind: str = "inclusion") -> Zone:
    """Return a zone that keeps whole discs."""
    return msgspec.convert({"name": f"{kind} {corners[0]}", "kind": kind, "keep": "disc", "polygon": corners}, Zone)


def square(low_m: float, high_m: float, kind: str = "inclusion") -> Zone:
    """Return a square zone."""
    return fence((low_m, low_m), (high_m, low_m), (high_m, high_m), (low_m, high_m), kind=kind)


def mission_of(ways: list[Pair], zones: list[Zone]) -> Mission:
    """Return a mission of UAVs that fly from the first to the second point of each pair."""
    roster = [
        RosterEntry(
            uav=f"u{k}", start_x_m=x, start_y_m=y, target_x_m=tx, target_y_m=ty, r_m=R_M, body_m=1, energy_j=1e9
        )
        for k, ((x, y), (tx, ty)) in enumerate(ways)
    ]
    return Mission(roster=roster, uavs=len(roster), zone=zones)


def slots_of(mission: Mission, most: int) -> int:
    """Fly a mission with the planner alone, check each step, and return the slots until all are at home."""
    planner, edges = make_planner("edc", mission), barriers(mission.zone)
    position_m = np.array([(entry.start_x_m, entry.start_y_m) for entry in mission.roster])
    target_m = np.array([(entry.target_x_m, entry.target_y_m) for entry in mission.roster])
    r_m, uavs = np.array([entry.r_m for entry in mission.roster]), range(len(mission.roster))
    for slot in range(most):
        end_m = np.array(planner.plan(PlanRequest(slot, uavs, position_m, target_m, r_m)).waypoint_m)
        kept_m = segment_distance_m(position_m[:, None], end_m[:, None], edges.a_m, edges.b_m) - edges.least_m(r_m)
        assert kept_m.min() >= 0
        i, j = np.triu_indices(len(r_m), 1)
        assert (closest_approach_m(position_m[i], end_m[i], position_m[j], end_m[j]) >= r_m[i] + r_m[j]).all()
        position_m = end_m
        if (length_m(position_m - target_m) < ARRIVED_M).all():
            return slot + 1
    return most


def alley(niche_m: float) -> Zone:
    """Return an alley of 80 m, one disc wide, with one niche for a disc that begins at `niche_m`."""
    low, deep = -HALF_M, -HALF_M - 8
    niche = [(niche_m, low), (niche_m, deep), (niche_m + 8, deep), (niche_m + 8, low)]
    return fence((0, low), *niche, (80, low), (80, HALF_M), (0, HALF_M))


LAY_BY = fence(
    (-30, -20), (0, -20), (0, -HALF_M), (36, -HALF_M), (36, -11), (44, -11), (44, -HALF_M), (80, -HALF_M), (80, -20),
    (110, -20), (110, 20), (80, 20), (80, HALF_M), (0, HALF_M), (0, 20), (-30, 20),
)  # fmt: skip
"""Two yards, and between them a lane one disc wide with a lay-by in its middle."""
RING = [square(0, 60), square(2 * HALF_M, 60 - 2 * HALF_M, "exclusion")]
CORNERS = [(HALF_M, HALF_M), (60 - HALF_M, HALF_M), (60 - HALF_M, 60 - HALF_M), (HALF_M, 60 - HALF_M)]
COURT = fence(
    (-60, -30), (0, -30), (0, -HALF_M), (4, -HALF_M), (4, -14), (32, -14), (32, 14), (4, 14), (4, HALF_M), (0, HALF_M),
    (0, 30), (-60, 30),
)  # fmt: skip
"""A field in the west, and a court in the east whose door lets one disc through."""
INNER, OUTER = [(10.0, -8.0), (18.0, -8.0), (26.0, -8.0), (10.0, 0.0)], [(-50.0 + 8 * k, 20.0) for k in range(4)]
SOUTH = [(x, -y) for x, y in OUTER]


@pytest.mark.parametrize(
    ("ways", "zones", "most"),
    [
        # Two from either side meet in the lane: one side's UAVs back out, or one waits in the lay-by.
        ([((-10, 0), (90, 0)), ((90, 2), (-10, 2)), ((-20, 10), (100, 10)), ((100, -10), (-20, -10))], [LAY_BY], 200),
        # Ends are exchanged: the UAV on the far side of the niche backs out through the whole alley.
        ([((4, 0), (76, 0)), ((76, 0), (4, 0))], [alley(36)], 120),
        ([((4, 0), (76, 0)), ((76, 0), (4, 0))], [alley(6)], 150),
        # A UAV at home between another one and its target makes room and comes back.
        ([((70, 0), (10, 0)), ((40, 0), (40, 0))], [alley(52)], 150),
        # A ring: all must turn the same way, though each wishes to go either way. Four take 469 slots without that.
        ([(CORNERS[0], CORNERS[2]), (CORNERS[2], CORNERS[0])], RING, 180),
        ([(CORNERS[k], CORNERS[(k + 2) % 4]) for k in range(4)], RING, 180),
        # Four leave the court while four enter it.
        ([*zip(INNER, OUTER, strict=True), *zip(SOUTH, INNER, strict=True)], [COURT], 250),
    ],
    ids=["lay-by", "niche", "niche-at-the-end", "at-home-in-the-way", "ring-of-two", "ring-of-four", "court"],
)  # fmt: skip
def test_uavs_that_block_each_other_make_room(ways: list[Pair], zones: list[Zone], most: int) -> None:
    """Each mission jams, some for ever, if guidance plans for one UAV at a time."""
    assert slots_of(mission_of(ways, zones), most) < most


def test_a_city_in_which_two_met_in_a_lane_for_ever_completes() -> None:
    """Two UAVs meet head-on in the lane between two blocks."""
    text = Path("scenarios/city_blocks.toml").read_text(encoding="utf-8")
    mission = complete_mission(mission_from_dict({**tomllib.loads(text), "seed": 5}))
    assert slots_of(mission, 300) < 300


def dead_end() -> Zone:
    """Return an alley without a niche."""
    return fence((0, -HALF_M), (80, -HALF_M), (80, HALF_M), (0, HALF_M))


def test_nobody_makes_room_where_no_order_of_moves_exists() -> None:
    """In an alley without a niche two UAVs cannot change ends, and no script pretends that they can."""
    room = Room(Charts.of(Airspace.of(barriers([dead_end()]), R_M, 5.0)), np.full(2, 2.5))
    at_m, r_m = np.array([(36.0, 0.0), (44.0, 0.0)]), np.full(2, R_M)
    goal_m = np.array([(76.0, 0.0), (4.0, 0.0)])
    walls = walls_of(at_m, r_m, Obstacles.none())
    for slot in range(200):
        aims_m = room.aims(slot, np.arange(2), at_m, goal_m, goal_m, length_m(goal_m - at_m), r_m, walls)
        assert (aims_m == goal_m).all()
    assert not room.scripts
    assert room.watches[0].tries > 2


@pytest.mark.parametrize("half_m", [HALF_M, 3.3, 3.8])
@pytest.mark.parametrize("place", [10.0, 16.8])
def test_a_roadmap_leads_round_the_corners_of_a_lane(half_m: float, place: float) -> None:
    """In a ring of lanes hardly wider than a disc, and past another UAV the other way round."""
    lanes = [square(0, 60), square(2 * half_m, 60 - 2 * half_m, "exclusion")]
    charts = Charts.of(Airspace.of(barriers(lanes), R_M, 5.0))
    at_m, goal_m = np.array([(60 - half_m, place)]), np.array([(half_m, half_m)])
    other_m, r_m = at_m - np.array([[0.0, 6.5]]), np.full(1, R_M)
    walls = walls_of(at_m, r_m, Obstacles(other_m, other_m, np.zeros(1), r_m))
    found = roadmap(charts, np.zeros(1, np.int64), r_m, at_m, goal_m, walls, Box.about(at_m, 2.0))
    assert 130 < found.left_m[0, 0] < 180


def random_roadmap(rng: Random, uavs: int) -> tuple[Roadmap, Floats]:
    """Return a map of few places, random legs, starts that are apart and ends, and the least distances."""
    while True:
        node_m = np.array([(rng.uniform(0, 10), rng.uniform(0, 10)) for _ in range(8)])
        apart_m = np.full((uavs, uavs), rng.uniform(1.0, 4.0))
        if length_m(node_m[:uavs, None] - node_m[:uavs])[np.triu_indices(uavs, 1)].min() > apart_m[0, 0]:
            break
    near: list[list[int]] = [[] for _ in node_m]
    for i, j in itertools.combinations(range(len(node_m)), 2):
        if rng.random() < 0.4:
            near[i].append(j)
            near[j].append(i)
    leg = np.array([j for row in near for j in row], dtype=np.int64)
    begin = np.cumsum([0, *(len(row) for row in near)])
    goals = rng.sample(range(len(node_m)), uavs)
    end = np.zeros((uavs, len(node_m)), dtype=bool)
    end[np.arange(uavs), goals] = True
    left_m = np.array([ways_left_m(node_m, near, goal) for goal in goals])
    return Roadmap(node_m, np.tile(begin, (uavs, 1)), np.tile(leg, 1), left_m, end), apart_m


def ways_left_m(node_m: Floats, near: list[list[int]], goal: int) -> Floats:
    """Return the shortest ways to the goal, by relaxing all legs as often as there are nodes."""
    left_m = np.full(len(node_m), math.inf)
    left_m[goal] = 0.0
    for _ in node_m:
        for i, row in enumerate(near):
            for j in row:
                left_m[i] = min(left_m[i], left_m[j] + float(length_m(node_m[i] - node_m[j])))
    return left_m


def solvable(found: Roadmap, apart_m: Floats) -> bool:
    """Return True if some order of moves brings all UAVs to their ends, by trying all states."""
    uavs = len(apart_m)
    start = tuple(range(uavs))
    seen, waiting = {start}, deque([start])
    while waiting:
        state = waiting.popleft()
        if all(found.end[k, v] for k, v in enumerate(state)):
            return True
        for k, v in enumerate(state):
            for w in found.leg[found.begin[k, v] : found.begin[k, v + 1]].tolist():
                child = (*state[:k], w, *state[k + 1 :])
                if child not in seen and free_move(found, apart_m, state, k, w):
                    seen.add(child)
                    waiting.append(child)
    return False


def free_move(found: Roadmap, apart_m: Floats, state: tuple[int, ...], k: int, to: int) -> bool:
    """Return True if UAV k may move to a node while all others stand still."""
    from_m, to_m = found.node_m[state[k]], found.node_m[to]
    others = [other for other in range(len(state)) if other != k]
    points_m = found.node_m[[state[other] for other in others]]
    away_m = segment_distance_m(from_m, to_m, points_m, points_m)
    return bool((away_m >= apart_m[k, others]).all())


def test_moves_are_found_if_and_only_if_some_exist_and_each_is_free() -> None:
    """The search agrees with one through all states, and any order of flight that a script allows is safe."""
    found_some = refused_some = 0
    for seed in range(60):
        rng = Random(seed)
        uavs = rng.choice([2, 3])
        found, apart_m = random_roadmap(rng, uavs)
        moved, to, _ = _moves(found, apart_m, 100_000)
        at = tuple(range(uavs))
        if len(moved) == 0:
            done = all(found.end[k, v] for k, v in enumerate(at))
            assert done or not solvable(found, apart_m)
            refused_some += not done
            continue
        for k, node in zip(moved.tolist(), to.tolist(), strict=True):
            assert free_move(found, apart_m, at, k, node)
            at = (*at[:k], node, *at[k + 1 :])
        assert all(found.end[k, v] for k, v in enumerate(at))
        found_some += 1
        fly_in_any_order(_script_of(0, np.arange(uavs), np.zeros((uavs, 2)), apart_m, found.node_m, moved, to), rng)
    assert found_some > 10
    assert refused_some > 10


def fly_in_any_order(script: Script, rng: Random) -> None:
    """Fly a script with UAVs that begin and end their moves at random times; all end, and no two come too near."""
    flying: dict[int, int] = {}
    while not script.ended:
        k = rng.randrange(len(script.uav))
        if k in flying:
            script.flown[k] += 1
            del flying[k]
        elif len(allowed := script.allowed(k)):
            flying[k] = int(allowed[0])
        for one, other in itertools.combinations(flying, 2):
            p, q = flying[one], flying[other]
            away_m = segment_distance_m(script.from_m[p], script.to_m[p], script.from_m[q], script.to_m[q])
            assert away_m >= script.apart_m[one, other]
        # Somebody can always go on.
        assert script.ended or flying or any(len(script.allowed(k)) for k in range(len(script.uav)))


def test_the_effort_of_one_slot_is_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    """No search goes beyond what is left of the expansions of its slot."""
    spent: list[int] = []

    def counted(found: Roadmap, apart_m: Floats, limit: int) -> tuple[Indices, Indices, int]:
        moved, to, effort = _moves(found, apart_m, limit)
        spent.append(effort)
        assert effort <= limit
        return moved, to, effort

    monkeypatch.setattr(room_module, "_moves", counted)
    monkeypatch.setattr(room_module, "EXPANSIONS", 50)
    ways = [(CORNERS[k], CORNERS[(k + 2) % 4]) for k in range(4)]
    assert slots_of(mission_of(ways, RING), 60) == 60
    assert spent
    assert sum(spent) <= 60 * 50
