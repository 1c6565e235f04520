"""The compiled guidance against plain numpy: prices, tracks and the lattice search, move by move."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from edc_swarm.geometry import length_m, segment_distance_m
from edc_swarm.planner import guidance_kernel as kernel
from edc_swarm.planner.answers import answers
from edc_swarm.planner.guidance import Guidance, Scene, Tuning, coverage
from edc_swarm.planner.ways import walls_of
from edc_swarm.solver.hull_rows import Obstacles

TUNING = Tuning(look_ahead=8, greed=1.0, expand=10**6)


def guidance_of(seed: int, tuning: Tuning) -> Guidance:
    """Guidance of up to sixteen UAVs with steps of 2.5 m."""
    return Guidance(np.full(16, 2.5), np.full((16, 2), 0.5), seed, tuning)


def world_of(seed: int, count: int = 9) -> tuple[kernel.World, kernel.Plans]:
    """A crowded slot with random late UAVs and an obstacle."""
    rng = np.random.default_rng(seed)
    grid = np.array(list(itertools.product(range(4), range(4))))[rng.permutation(16)[:count]]
    position_m = 11.0 * grid + rng.uniform(-0.4, 0.4, (count, 2))
    goal_m = position_m[rng.permutation(count)]
    wall = Obstacles(np.array([[11.0, -10.0]]), np.array([[19.0, -7.0]]), np.full(1, 0.4), np.full(1, 0.6))
    scene = Scene(3, np.arange(count), position_m, goal_m, rng.uniform(3, 5, count), wall)
    guidance = guidance_of(seed, TUNING)
    guidance._remember(scene, length_m(goal_m - position_m))
    guidance._memory.late[:] = rng.uniform(0, 40, count)
    world = guidance._world(scene, goal_m, walls_of(position_m, scene.r_m, wall))
    plans = guidance._memory.plans_of(scene.uav)
    kernel.populate(world, plans, TUNING.delay)
    return world, plans


def gap_m(step_m: np.ndarray, other_m: np.ndarray) -> float:
    """Least distance between two vehicles however unevenly they fly their steps (2, 2), by least squares."""
    moves = np.stack([step_m[1] - step_m[0], other_m[0] - other_m[1]], axis=1)
    apart = step_m[0] - other_m[0]
    share = lsq_linear(moves, -apart, (-1e-12, 1 + 1e-12), method="bvls", tol=1e-14).x
    return float(np.hypot(*(apart + moves @ share)))


def price(world: kernel.World, k: int, t: int, point_m: np.ndarray, before_m: np.ndarray | None = None) -> float:
    """The conflict term of the cost, by its formula over all other vehicles: at a point, or for a step."""
    rules, total = world.rules, 0.0
    for other in range(len(world.r_m)):
        if other == k:
            continue
        radii = world.r_m[k] + world.r_m[other]
        distance = math.dist(point_m, world.track[other, t])
        if before_m is not None:
            distance = gap_m(np.stack([before_m, point_m]), world.track[other, t - 1 : t + 1])
        sep = min(radii + rules.delta_m, 0.9995 * math.dist(world.start_m[k], world.start_m[other])) - 1e-6
        way = (world.luck[other] + rules.patience) / (world.luck[k] + rules.patience)
        way = min(max(way, 1 / rules.cap), rules.cap)
        way = max(way, world.imminent[k]) if t == 1 else way
        if distance < sep:
            total += way * world.gamma[t] * (rules.touch + rules.depth * (sep - distance) / radii)
    return total + wall_price(world, k, np.stack([point_m if before_m is None else before_m, point_m]))


def wall_price(world: kernel.World, k: int, step_m: np.ndarray) -> float:
    """The price of the obstacles, by the exact distance of two segments."""
    rules, total = world.rules, 0.0
    for w, (a_m, b_m) in enumerate(zip(world.walls.a_m, world.walls.b_m, strict=True)):
        distance = float(segment_distance_m(step_m[0], step_m[1], a_m, b_m))
        keep, bar = world.walls.keep_m[k, w], world.walls.bar_m[k, w]
        if distance < bar:
            total += kernel.UNYIELDING * (rules.touch + rules.depth * (bar - distance) / keep)
        elif distance < keep - 1e-6:
            total += rules.cap * (rules.touch + rules.depth * (keep - distance) / keep)
    return total


def lattice(world: kernel.World, k: int) -> tuple[float, np.ndarray]:
    """Least f = g + h over the last layer, by dynamic programming layer by layer; and all f."""
    half, layers = TUNING.side // 2, TUNING.layers
    spacing = 2 * 2.5 / math.sqrt(20)
    goal = np.rint((world.goal_m[k] - world.start_m[k]) / spacing).astype(int)
    axis = np.arange(-half, half + 1)
    best = np.full((len(axis), len(axis)), np.inf)
    best[half, half] = 0.0
    moves = [
        (a, b) for a in range(-4, 5) for b in range(-4, 5) if a * a + b * b in {0, 4, 5} or 13 <= a * a + b * b <= 20
    ]
    for layer in range(1, layers + 1):
        best = best_of_layer(best, moves, goal + half, spacing / 2.5)
        for a, b in np.argwhere(np.isfinite(best)):
            point = world.start_m[k] + spacing * np.array([axis[a], axis[b]])
            slots = [t for t in range(2 * layer - 1, 2 * layer + 2) if t < len(world.gamma)]
            best[a, b] += 2 / 3 * sum(price(world, k, t, point) for t in slots)
    ahead = np.hypot(axis[:, None] - goal[0], axis[None] - goal[1]) * spacing / 2.5
    return float((best + ahead).min()), best


def best_of_layer(before: np.ndarray, moves: list[tuple[int, int]], goal: np.ndarray, unit: float) -> np.ndarray:
    """Cheapest way into every cell of the next layer, without the cells' own prices."""
    after = np.full_like(before, np.inf)
    for a, b in np.argwhere(np.isfinite(before)):
        for da, db in moves:
            na, nb, length = a + da, b + db, math.hypot(da, db) * unit
            if not (0 <= na < len(before) and 0 <= nb < len(before)):
                continue
            step = 0.5 * length + 1.0
            if (na, nb) == tuple(goal):
                step = 0.0 if (a, b) == (na, nb) else length
            after[na, nb] = min(after[na, nb], before[a, b] + step)
    return after


@pytest.mark.parametrize("seed", range(2))
def test_search_finds_the_optimum_of_dynamic_programming(seed: int) -> None:
    """With an admissible heuristic and no limit, A* ends in the cheapest node, at its exact cost."""
    world, _ = world_of(seed)
    guidance = guidance_of(0, TUNING)
    slot, point_m = np.empty(TUNING.layers, np.int64), np.empty((TUNING.layers, 2))
    spacing = 2 * 2.5 / math.sqrt(20)
    for k in (0, 4):
        count, spent, found = kernel.search(world, guidance._scratch, TUNING.limits(9), k, math.inf, slot, point_m)
        least, cells = lattice(world, k)
        assert count == TUNING.layers
        assert slot.tolist() == [2, 4, 6, 8]
        assert 0 < spent <= TUNING.expand
        offset = np.rint((point_m[-1] - world.start_m[k]) / spacing).astype(int)
        goal = np.rint((world.goal_m[k] - world.start_m[k]) / spacing).astype(int)
        end = offset + TUNING.side // 2
        ahead = math.hypot(*(offset - goal)) * spacing / 2.5
        assert found == pytest.approx(cells[end[0], end[1]], abs=1e-9)
        assert found + ahead == pytest.approx(least, abs=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_search_path_costs_what_it_says(seed: int) -> None:
    """Following the returned way points move by move adds up to the returned cost."""
    world, _ = world_of(seed, count=12)
    guidance = guidance_of(0, TUNING)
    slot, point_m = np.empty(TUNING.layers, np.int64), np.empty((TUNING.layers, 2))
    spacing = 2 * 2.5 / math.sqrt(20)
    goal = np.rint((world.goal_m[1] - world.start_m[1]) / spacing)
    count, _, found = kernel.search(world, guidance._scratch, TUNING.limits(9), 1, math.inf, slot, point_m)
    cell, total = np.zeros(2), 0.0
    for layer in range(1, count + 1):
        after = np.rint((point_m[layer - 1] - world.start_m[1]) / spacing)
        squared = int(((after - cell) ** 2).sum())
        assert squared in {0, 4, 5} or 13 <= squared <= 20
        length = math.sqrt(squared) * spacing / 2.5
        if (after == goal).all():
            total += length
        else:
            total += 0.5 * length + 1.0
        point = world.start_m[1] + spacing * after
        total += 2 / 3 * sum(price(world, 1, t, point) for t in range(2 * layer - 1, min(2 * layer + 1, 8) + 1))
        cell = after
    assert total == pytest.approx(found, abs=1e-9)


def drafted(world: kernel.World, k: int, slots: np.ndarray, points_m: np.ndarray) -> tuple[kernel.Draft, float]:
    """A draft with these way points, and its cost."""
    draft = guidance_of(0, TUNING)._draft
    draft.slot[: len(slots)], draft.point_m[: len(slots)] = slots, points_m
    return draft, kernel.begin(world, k, draft, len(slots))


@pytest.mark.parametrize("seed", range(3))
def test_conflicts_are_those_of_the_formula_after_any_changes_of_plan(seed: int) -> None:
    """The grid finds every vehicle within reach of a step, also after plans were installed and removed."""
    world, plans = world_of(seed)
    rng = np.random.default_rng(seed)
    for _ in range(30):
        k = int(rng.integers(len(plans.size)))
        slots = np.sort(rng.choice(np.arange(1, 9), 2, replace=False))
        draft, _ = drafted(world, k, slots, world.start_m[k] + rng.normal(0, 8, (2, 2)))
        kernel.install(world, plans, k, 2, draft)
    found = 0.0
    for k in range(len(plans.size)):
        track = world.track[k]
        draft, _ = drafted(world, k, plans.slot[k, : plans.size[k]], plans.point_m[k, : plans.size[k]])
        expected = [price(world, k, t, track[t], track[t - 1]) for t in range(1, 9)]
        assert draft.price[1:9] == pytest.approx(expected, abs=1e-6)
        found += sum(expected)
    assert found > 10


@pytest.mark.parametrize("seed", range(4))
def test_a_change_costs_what_the_whole_plan_costs(seed: int) -> None:
    """Flying only the slots that a change touches gives the track and the cost of flying all of them."""
    world, _ = world_of(seed)
    rng = np.random.default_rng(seed)
    slots, points_m = np.array([2, 4, 7]), world.start_m[0] + rng.normal(0, 4, (3, 2))
    draft, cost = drafted(world, 0, slots, points_m)
    for _ in range(60):
        n, kind, limit = int(rng.integers(3)), int(rng.integers(3)), math.inf if rng.random() < 0.5 else cost
        kept = draft.slot.copy(), draft.point_m.copy()
        if kind == 0:
            draft.point_m[n] += rng.normal(0, 1.0, 2)
            trial = kernel.attempt(world, 0, draft, 3, n, 0, limit)
        else:
            kernel.drop(3, draft.slot, draft.point_m, n)
            trial = kernel.attempt(world, 0, draft, 2, n, -1, math.inf)
            slot, point_m = int(kept[0][n]), kept[1][n] + rng.normal(0, 1.0, 2)
            kernel.insert(2, draft.slot, draft.point_m, n, slot, *point_m)
            trial = kernel.attempt(world, 0, draft, 3, n, 1, math.inf)
        if trial == math.inf:
            draft.slot[:], draft.point_m[:] = kept
        else:
            cost = trial
        fresh, whole = drafted(world, 0, draft.slot[:3], draft.point_m[:3])
        assert cost == pytest.approx(whole, abs=1e-9)
        assert draft.track.tolist() == fresh.track.tolist()
        assert draft.aim[1:].tolist() == fresh.aim[1:].tolist()


def test_a_straight_way_that_is_free_needs_no_way_points() -> None:
    """Local search takes the detour out of a plan that has nothing to go round."""
    world, _ = world_of(1)
    world.start_m[0], world.goal_m[0] = (300.0, 300.0), (300.0, 330.0)
    draft, detour = drafted(world, 0, np.array([2, 4]), np.array([[302.0, 304.0], [301.0, 308.0]]))
    count, cost = kernel.polish(world, 0, draft, 2, detour, 3, 1.0)
    assert (count, cost) == (0, pytest.approx(12.0))
    assert cost < detour


def test_the_slot_to_come_is_nobodys_to_insist_on() -> None:
    """However late a UAV is, a step that the slot QP will refuse costs it the full price."""
    world, _ = world_of(2)
    world.luck[:] = [1e6, *([0.0] * 8)]
    at_once, later = (kernel.toll(world.rules, world.luck, world.imminent, world.r_m, 0, 1, t, 0.0) for t in (1, 2))
    assert at_once == TUNING.imminent * TUNING.touch
    assert later == TUNING.touch / TUNING.cap


def test_who_has_stood_still_for_long_no_longer_insists() -> None:
    """After `stuck` slots of not moving everyone has the right of way in the slot to come; moving ends it."""
    position_m, goal_m = np.array([[0.0, 0.0], [20.0, 0.0]]), np.array([[0.0, 20.0], [20.0, 5.0]])
    guidance, seen = guidance_of(0, TUNING), []
    for slot in range(TUNING.stuck + 2):
        moved_m = np.array([[0.0, float(slot > TUNING.stuck)], [0.0, 0.1 * slot]])
        scene = Scene(slot, np.arange(2), position_m + moved_m, goal_m, np.full(2, 5.0), Obstacles.none())
        guidance._remember(scene, length_m(goal_m - scene.position_m))
        seen.append(guidance._imminent(scene).tolist())
    mild, hard = TUNING.imminent, kernel.UNYIELDING
    assert seen == [[mild, mild]] * TUNING.stuck + [[hard, mild], [mild, mild]]


def test_who_was_unheard_for_a_while_keeps_its_lateness() -> None:
    """With lost fixes everybody is unheard now and then; who has waited is still late, unless it was away for long."""
    goal_m = np.array([[0.0, 200.0], [20.0, 0.0]])
    guidance = guidance_of(0, TUNING)

    def late_at(slot: int, *uav: int) -> float:
        position_m = np.array([[0.0, 0.0], [20.0, 0.0]])
        who = [*uav]
        scene = Scene(slot, np.array(who), position_m[who], goal_m[who], np.full(len(who), 5.0), Obstacles.none())
        guidance._remember(scene, length_m(goal_m[who] - position_m[who]))
        return float(guidance._memory.late[0])

    assert [late_at(0, 0, 1), late_at(1, 0, 1), late_at(2, 1), late_at(3, 0, 1)] == [0.0, 1.0, 1.0, 3.0]
    assert late_at(3 + TUNING.look_ahead, 0, 1) == 3.0 + TUNING.look_ahead
    assert late_at(4 + 2 * TUNING.look_ahead, 0, 1) == 0.0


def test_those_with_the_longest_way_go_first_where_it_is_dense() -> None:
    """Right of way grows with the way to go, by the square of the share that the discs cover."""
    position_m, goal_m = np.array([[0.0, 0.0], [20.0, 0.0]]), np.array([[0.0, 20.0], [20.0, 5.0]])
    scene = Scene(0, np.arange(2), position_m, goal_m, np.full(2, 5.0), Obstacles.none())
    assert coverage(scene) == pytest.approx(2 * math.pi * 25 / 30**2)
    guidance = guidance_of(0, TUNING)
    guidance._remember(scene, length_m(goal_m - position_m))
    assert guidance._luck(scene) == pytest.approx(TUNING.far_first * coverage(scene) ** 2 * np.array([8, 2]))


def test_plans_are_flown_in_time_and_end_at_the_goal() -> None:
    """Constant speed to each way point, exactly there in its slot, then full speed to the goal."""
    world, _ = world_of(0)
    world.start_m[0], world.goal_m[0] = (0.0, 0.0), (11.0, 0.0)
    track = np.empty((9, 2))
    kernel.fly(world, 0, 1, np.array([4]), np.array([[4.0, 0.0]]), track)
    assert track[:, 0] == pytest.approx([0, 1, 2, 3, 4, 6.5, 9, 11, 11])
    assert track[4].tolist() == [4.0, 0.0]
    assert track[8].tolist() == [11.0, 0.0]
    draft, cost = drafted(world, 0, np.array([4]), np.array([[4.0, 0.0]]))
    assert draft.effort[1:].sum() == pytest.approx(0.5 * (6 + 2 / 2.5) + 0.5 * 11 / 2.5)
    assert cost == pytest.approx((draft.effort + draft.price)[1:].sum())


def test_plans_that_cannot_be_kept_are_put_off_then_dropped() -> None:
    """A held UAV's way points move into the future, and after too many slots the plan is dropped."""
    world, plans = world_of(0)
    plans.size[0], plans.slot[0, :2] = 2, [1, 4]
    plans.point_m[0, :2] = world.start_m[0] + [[7.0, 0.0], [9.0, 0.0]]
    kernel.put_off(world, plans, 0, 4)
    assert plans.slot[0, :2].tolist() == [3, 6]
    plans.slot[0, :2] -= 3
    kernel.put_off(world, plans, 0, 4)
    assert plans.size[0] == 0


def test_hash_is_uniform_and_depends_on_every_argument() -> None:
    """Ten thousand numbers have the mean and spread of U(0, 1); no argument is ignored."""
    numbers = np.array([kernel.uniform(1, a, b) for a in range(100) for b in range(100)])
    assert numbers.mean() == pytest.approx(0.5, abs=0.01)
    assert numbers.std() == pytest.approx(12**-0.5, abs=0.01)
    assert len({kernel.uniform(*seeds) for seeds in itertools.product(range(4), repeat=3)}) == 64


@pytest.mark.parametrize("seed", range(20))
def test_foreign_uavs_answer_where_they_meet_an_own_one_or_have_a_plan(seed: int) -> None:
    """Whoever is in conflict with an own track answers; two foreign UAVs that meet far away do not."""
    world, plans = world_of(seed)
    own = 3
    answering = answers(world, plans, len(world.track) - own)
    assert answering[:own].all()
    meets = [
        any(
            gap_m(world.track[k, t - 1 : t + 1], world.track[other, t - 1 : t + 1])
            < world.r_m[k] + world.r_m[other] + world.rules.delta_m
            for k in range(own)
            for t in range(1, world.track.shape[1])
        )
        for other in range(own, len(world.track))
    ]
    assert meets == (answering[own:] & meets).tolist()
    world.track[own:] += 1e4
    assert not answers(world, plans, len(world.track) - own)[own:].any()
    plans.size[own] = 1
    assert answers(world, plans, len(world.track) - own)[own:].tolist() == [True] + [False] * (
        len(world.track) - own - 1
    )
