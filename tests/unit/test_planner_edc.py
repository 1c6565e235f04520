"""The planner "edc" in closed loop: complete, disjoint, deterministic, robust to who is there."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest

from edc_swarm.errors import InputError
from edc_swarm.geometry import closest_approach_m, length_m, point_segment_distance_m
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import complete_mission
from edc_swarm.planner import guidance_kernel as kernel
from edc_swarm.planner.edc import Edc, weights
from edc_swarm.planner.guidance import Tuning
from edc_swarm.planner.interface import Hull, Plan, Planner, PlanRequest, stopped
from edc_swarm.planner.registry import make_planner

R_M = 5.0


class Flight:
    """A mission flown by the planner alone, all commands executed unless `lost` says otherwise."""

    def __init__(self, mission: Mission) -> None:
        self.mission = complete_mission(mission)
        self.planner: Planner = make_planner("edc", self.mission)
        roster = self.mission.roster
        self.position_m = np.array([(e.start_x_m, e.start_y_m) for e in roster])
        self.previous_m = self.position_m.copy()
        self.target_m = np.array([(e.target_x_m, e.target_y_m) for e in roster])
        self.r_m = np.array([e.r_m for e in roster])
        self.slot = 0
        self.least_gap_m = math.inf

    def request(self, uav: np.ndarray, hulls: list[Hull]) -> PlanRequest:
        """The request of a head."""
        late = self.previous_m[uav] if self.mission.lag_slots else None
        return PlanRequest(
            self.slot, uav.tolist(), self.position_m[uav], self.target_m[uav], self.r_m[uav], hulls, late
        )

    def step(self, unheard: tuple[int, ...] = (), lost: np.ndarray | None = None) -> Plan:
        """One slot; the unheard are hulls where they stand."""
        everyone = np.arange(len(self.r_m))
        uav = np.setdiff1d(everyone, unheard)
        where = [(k, *self.position_m[k].tolist()) for k in unheard]
        hulls = [Hull(k, x_m, y_m, x_m, y_m, 0.0, float(self.r_m[k])) for k, x_m, y_m in where]
        plan = self.planner.plan(self.request(uav, hulls))
        after_m = self.position_m.copy()
        after_m[uav] = plan.waypoint_m
        if lost is not None:
            after_m[lost] = self.position_m[lost]
        k, l_ = np.triu_indices(len(self.r_m), 1)
        if len(k):
            near_m = closest_approach_m(self.position_m[k], after_m[k], self.position_m[l_], after_m[l_])
            self.least_gap_m = min(self.least_gap_m, float((near_m - self.r_m[k] - self.r_m[l_]).min()))
        self.previous_m, self.position_m = self.position_m, after_m
        self.slot += 1
        return plan

    def done(self) -> bool:
        """Return True if all have arrived."""
        return bool((length_m(self.position_m - self.target_m) < 0.1).all())

    def slots(self) -> Iterator[int]:
        """Slots until all have arrived or the mission is given up."""
        while not self.done() and self.slot < self.mission.max_slots:
            yield self.slot


@pytest.mark.parametrize(("uavs", "area_m2", "seed"), [(20, 6000.0, 1), (15, 3500.0, 2), (10, 10_000.0, 3)])
def test_missions_complete_without_overlap(uavs: int, area_m2: float, seed: int) -> None:
    """Everyone arrives at the target and no two discs ever overlap."""
    flight = Flight(Mission(uavs=uavs, area_m2=area_m2, seed=seed))
    for _ in flight.slots():
        flight.step()
    assert flight.done()
    assert flight.least_gap_m >= -1e-9


def test_arrival_is_exact() -> None:
    """A lone UAV flies straight at full speed and stops on the target's very floats."""
    flight = Flight(Mission(uavs=1, seed=4))
    straight_m = length_m(flight.target_m - flight.position_m)[0]
    plans = [flight.step() for _ in range(math.ceil(straight_m / 2.5) + 1)]
    assert flight.position_m.tolist() == flight.target_m.tolist()
    assert {plan.status for plan in plans} == {"no-qp-needed"}
    assert flight.step().waypoint_m == plans[-1].waypoint_m


def test_lost_commands_do_not_stop_the_mission() -> None:
    """With a fifth of all commands lost the mission still completes, still without overlap."""
    flight = Flight(Mission(uavs=12, area_m2=5000, seed=5))
    rng = np.random.default_rng(5)
    for _ in flight.slots():
        flight.step(lost=rng.random(12) < 0.2)
    assert flight.done()
    assert flight.least_gap_m >= -1e-9


def test_a_gap_that_only_looks_wide_enough_is_not_waited_at_for_ever() -> None:
    """Two at their targets leave 20.03 m, R + delta twice being 20.04 m: they make room at once."""
    flight = Flight(Mission(uavs=3, seed=0))
    flight.position_m = np.array([[134.9184378, 174.96121213], [151.54445429, 186.13179676], [143.94, 179.42]])
    flight.target_m = np.array([*flight.position_m[:2].tolist(), [134.32324946, 194.5395387]])
    for _ in range(30):
        flight.step()
    assert flight.done()
    assert flight.least_gap_m >= -1e-9


def test_two_face_to_face_do_not_wait_for_each_other_for_ever() -> None:
    """One insists on a step that the QP refuses, the other waits for it to go: the first ends that, dense as it is."""
    flight = Flight(Mission(uavs=50, seed=28))
    for _ in range(200):
        flight.step()
        if flight.done():
            break
    assert flight.done()
    assert flight.least_gap_m >= -1e-9


def test_exact_symmetry_is_broken() -> None:
    """Ten UAVs that swap places across a circle, perfectly symmetric, all get there."""
    flight = Flight(Mission(uavs=10, area_m2=10_000, seed=6, fence="none"))
    angle = np.arange(10) * np.pi / 5
    flight.position_m = 40 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    flight.target_m = -flight.position_m
    for _ in flight.slots():
        flight.step()
    assert flight.done()
    assert flight.least_gap_m >= -1e-9


def test_one_at_its_target_steps_aside_and_comes_back() -> None:
    """A UAV that stands in the only gap makes way for another and returns to its target."""
    flight = Flight(Mission(uavs=6, area_m2=10_000, seed=7))
    wall = np.array([[30.0, y] for y in (-21.0, -10.5, 0.0, 10.5, 21.0)])
    flight.position_m = np.vstack([[0.0, 0.0], wall])
    flight.target_m = np.vstack([[60.0, 0.0], wall])
    moved_m = 0.0
    for _ in flight.slots():
        flight.step()
        moved_m = max(moved_m, float(length_m(flight.position_m[1:] - wall).max()))
    assert flight.done()
    assert moved_m > 1.0
    assert flight.slot < 100


def test_unheard_uavs_are_avoided_and_may_return() -> None:
    """Two UAVs fall silent for a while: the others keep clear of them, and all finish afterwards."""
    flight = Flight(Mission(uavs=12, area_m2=5000, seed=8))
    for slot in flight.slots():
        silent = (2, 9) if 5 <= slot < 30 else ()
        before_m = flight.position_m[[2, 9]].copy()
        plan = flight.step(unheard=silent)
        assert len(plan.waypoint_m) == 12 - len(silent)
        assert not silent or flight.position_m[[2, 9]].tolist() == before_m.tolist()
    assert flight.done()
    assert flight.least_gap_m >= -1e-9


def test_a_new_head_starts_cold_in_the_middle() -> None:
    """A planner that takes over in flight finishes the mission."""
    flight = Flight(Mission(uavs=12, area_m2=4500, seed=9))
    for slot in flight.slots():
        if slot == 8:
            flight.planner = make_planner("edc", flight.mission)
        flight.step()
    assert flight.done()
    assert flight.least_gap_m >= -1e-9


def test_the_first_plan_of_a_new_head_in_flight_is_short() -> None:
    """It ends with the search in which its share of the budget does; those before and after have the whole budget.

    It is a safe plan like any other.
    """
    flight = Flight(Mission(uavs=30, area_m2=6000, seed=9, fence="none"))
    whole, share = (Tuning().limits(30, part).budget for part in (1.0, Tuning().first_share))
    steps = []
    for _ in range(2):
        flight.planner = planner = Edc(flight.mission, stopped)
        for _ in range(2):
            flight.step()
            steps.append(planner.priced_steps)
    at_start, after, taking_over, next_one = steps
    assert share <= taking_over < whole / 2
    assert min(at_start, after, next_one) >= whole
    assert flight.least_gap_m >= -1e-9


def test_late_vehicles_complete_too() -> None:
    """With lag_slots = 1 missions complete, and any mix of this and the previous step is disjoint."""
    flight = Flight(Mission(uavs=8, area_m2=4500, seed=10, lag_slots=1))
    for _ in flight.slots():
        older_m = flight.previous_m.copy()
        now_m = flight.position_m.copy()
        flight.step()
        k, l_ = np.nonzero(~np.eye(8, dtype=bool))
        crossed = point_segment_distance_m(older_m[k], now_m[l_], flight.position_m[l_]) - 2 * R_M
        assert crossed.min() >= -1e-9
    assert flight.done()


def test_a_ball_is_left_and_its_inside_holds() -> None:
    """Nearer than R to a hull a UAV gets away from it at full speed; inside the hull it holds."""
    planner = make_planner("edc", Mission(uavs=3))
    ball = Hull(2, 0.0, 0.0, 0.0, 0.0, 7.5, R_M)
    plan = planner.plan(
        PlanRequest(0, [0, 1], [(12.0, 9.0), (3.0, -4.0)], [(-60.0, -45.0), (60.0, 0.0)], [R_M, R_M], [ball])
    )
    away = np.array(plan.waypoint_m[0]) - [12.0, 9.0]
    assert away @ [0.8, 0.6] > 0.5 * 2.5
    assert length_m(away) == pytest.approx(2.5)
    assert plan.waypoint_m[1] == (3.0, -4.0)


def test_same_requests_same_bytes() -> None:
    """Two planners given the same requests answer with identical floats."""
    mission = Mission(uavs=12, area_m2=4500, seed=11)
    first, second = Flight(mission), Flight(mission)
    for _ in range(15):
        mine, theirs = first.step(), second.step()
        assert mine == theirs


def test_stopwatch_splits_the_time() -> None:
    """Guidance, assembly and solution are timed by the injected stopwatch, and by nothing else."""
    ticks = iter(range(0, 10**9, 2_000_000))
    flight = Flight(Mission(uavs=3, seed=12))
    flight.planner = make_planner("edc", flight.mission, lambda: next(ticks))
    plan = flight.step()
    assert (plan.guidance_ms, plan.assemble_ms, plan.solve_ms) == (2.0, 2.0, 2.0)
    unmeasured = make_planner("edc", flight.mission).plan(flight.request(np.arange(3), []))
    assert (unmeasured.guidance_ms, unmeasured.assemble_ms, unmeasured.solve_ms) == (0.0, 0.0, 0.0)


def test_nobody_to_plan_for() -> None:
    """Zero UAVs give an empty plan."""
    plan = make_planner("edc", Mission()).plan(PlanRequest(0, [], [], [], []))
    assert plan.waypoint_m == []
    assert plan.min_gap_m == 0.0


@pytest.mark.parametrize("name", ["edc", "straight"])
@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_numbers_that_are_not_finite_are_refused(name: str, bad: float) -> None:
    """NaN and infinity raise an error that names the field."""
    planner = make_planner(name, Mission())
    with pytest.raises(InputError, match="position_m"):
        planner.plan(PlanRequest(0, [0], [(bad, 0.0)], [(1.0, 1.0)], [5.0]))
    with pytest.raises(InputError, match="hulls"):
        planner.plan(PlanRequest(0, [0], [(0.0, 0.0)], [(1.0, 1.0)], [5.0], [Hull(1, bad, 0.0, 0.0, 0.0, 0.0, 5.0)]))


def test_lengths_and_indices_are_checked() -> None:
    """Rows that are missing, UAVs named twice and negative radii are refused."""
    planner = make_planner("edc", Mission())
    with pytest.raises(InputError, match="target_m"):
        planner.plan(PlanRequest(0, [0, 1], [(0, 0), (20, 0)], [(1, 1)], [5.0, 5.0]))
    with pytest.raises(InputError, match="uav"):
        planner.plan(PlanRequest(0, [1, 1], [(0, 0), (20, 0)], [(1, 1), (30, 0)], [5.0, 5.0]))
    with pytest.raises(InputError, match="r_m"):
        planner.plan(PlanRequest(0, [0], [(0, 0)], [(1, 1)], [-1.0]))


@pytest.mark.parametrize("r_m", [0.0, 5.0])
def test_coincident_and_overlapping_uavs_do_not_crash(r_m: float) -> None:
    """Impossible positions give a plan in which no UAV closes in."""
    position_m = np.array([(0.0, 0.0), (0.0, 0.0), (3.0, 0.0)])
    target_m = [(40.0, 0.0), (-40.0, 0.0), (0.0, 0.0)]
    planner = make_planner("edc", Mission(uavs=3))
    for slot in range(3):
        plan = planner.plan(PlanRequest(slot, [0, 1, 2], position_m, target_m, [r_m] * 3))
        assert np.isfinite(plan.waypoint_m).all()
        before, position_m = position_m, np.array(plan.waypoint_m)
        if r_m:
            assert length_m(position_m[0] - position_m[2]) >= length_m(before[0] - before[2]) - 1e-9


@pytest.mark.parametrize(("uavs", "rounds"), [(2, 1), (20, 3)])
def test_uavs_answer_again_while_their_tracks_conflict(uavs: int, rounds: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two that change places are free of conflict after one round; a circle of 20 is not after two."""
    sweep, made = kernel.sweep, list[None]()
    monkeypatch.setattr(kernel, "sweep", lambda *arguments: made.append(sweep(*arguments)))
    angle = np.arange(uavs) * 2 * math.pi / uavs
    start_m = 40 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    planner = make_planner("edc", Mission(uavs=uavs, responses=3))
    planner.plan(PlanRequest(0, range(uavs), start_m, -start_m, np.full(uavs, 5.0)))
    assert len(made) == rounds


def test_weights_follow_what_is_minimised() -> None:
    """Time alone; a balance; or the power curve, where hovering dearer than cruising means time."""
    assert weights(Mission(minimise="time"), 5.0) == (1.0, 0.0)
    assert weights(Mission(minimise="distance"), 5.0) == (0.5, 0.5)
    assert weights(Mission(minimise="energy"), 5.0) == (1.0, 0.0)
    wt, wd = weights(Mission(minimise="energy"), 30.0)
    assert 0 < wt < 0.6
    assert wt + wd == pytest.approx(1.0)
