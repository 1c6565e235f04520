"""Planner `edc` against the solver of the paper's eq. 13-21, and that solver against what is known without it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import ArrayLike

from edc_swarm.errors import InputError
from edc_swarm.geometry import Floats, closest_approach_m, length_m
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import random_roster
from edc_swarm.mission.roster_entry import ARRIVED_M
from edc_swarm.planner.interface import PlanRequest
from edc_swarm.planner.registry import make_planner
from edc_swarm.reference.problem import TOLERANCE_M, Problem
from edc_swarm.reference.program import Programme
from edc_swarm.reference.search import Reference, solve

U_MAX_M = 2.5
ENOUGH = 8
"""Starts that suffice for the small problems here."""


def problem_of(start_m: ArrayLike, target_m: ArrayLike, slots: int, r_m: float = 5.0) -> Problem:
    """Return a problem of UAVs that are all alike."""
    start, target = np.array(start_m, float), np.array(target_m, float)
    return Problem(start, target, np.full(len(start), r_m), np.full(len(start), U_MAX_M), slots)


def swap(aside_m: float = 0.0) -> Problem:
    """Two UAVs 60 m apart that change places, the targets moved aside by `aside_m` each."""
    start_m = np.array([[-30.0, 0.0], [30.0, 0.0]])
    return problem_of(start_m, -start_m + np.array([[0.0, aside_m], [0.0, -aside_m]]), 30)


def found(problem: Problem, starts: int = ENOUGH, **options: str) -> Reference:
    """Return the reference, which must exist."""
    reference = solve(problem, starts=starts, **options)  # type: ignore[arg-type]
    assert reference is not None
    return reference


def flown(planner: str, seed: int, uavs: int) -> tuple[Problem, float, Floats]:
    """Fly a dense random mission; return it as a problem with the slots of that flight, its distance and its path.

    What is missing to a target counts as flown, since a UAV may end up to `ARRIVED_M` from it.
    """
    mission = Mission(uavs=uavs, area_m2=650.0 * uavs, seed=seed, fence="none", planner=planner)
    roster = random_roster(mission)
    start_m = np.array([(entry.start_x_m, entry.start_y_m) for entry in roster])
    target_m = np.array([(entry.target_x_m, entry.target_y_m) for entry in roster])
    flying, path = make_planner(planner, mission), [start_m]
    while (length_m(path[-1] - target_m) > ARRIVED_M).any():
        assert len(path) < 200
        request = PlanRequest(len(path), range(uavs), path[-1], target_m, np.full(uavs, 5.0))
        path.append(np.array(flying.plan(request).waypoint_m))
    path_m = np.array(path)
    distance_m = float(length_m(np.diff(path_m, axis=0)).sum() + length_m(path_m[-1] - target_m).sum())
    return problem_of(start_m, target_m, len(path_m)), distance_m, path_m


def test_two_uavs_that_change_places_have_the_optimum_of_geometry() -> None:
    """Both tangents and the arc of the relative way round a disc of radius R, which pairs of half ways attain."""
    optimum_m = 2 * math.sqrt(60**2 - 10**2) + 2 * 10 * math.asin(10 / 60)
    reference = found(swap())
    assert reference.bound_m == pytest.approx(optimum_m, abs=1e-9)
    assert reference.distance_m >= optimum_m - 2 * TOLERANCE_M
    assert reference.distance_m == pytest.approx(optimum_m, rel=1e-3)


def test_the_shorter_side_is_found() -> None:
    """With both targets 4 m to the left of the others' starts, passing on the left is shorter."""
    reference = found(swap(aside_m=4.0))
    assert reference.distance_m == pytest.approx(reference.bound_m, rel=1e-3)


@pytest.mark.parametrize("count", [3, 4])
def test_plan_is_feasible_at_every_time(count: int) -> None:
    """Eq. 14-21 for UAVs that meet in the middle of a circle: ends, steps, discs; and no shorter than the bound."""
    angle = np.arange(count) * 2 * np.pi / count
    start_m = 30 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    reference = found(problem_of(start_m, -start_m, 36), starts=3)
    path_m = reference.path_m
    first, second = np.triu_indices(count, 1)
    near_m = closest_approach_m(path_m[:-1, first], path_m[1:, first], path_m[:-1, second], path_m[1:, second])
    assert near_m.min() >= 10 - TOLERANCE_M
    assert near_m.min() - 10 == pytest.approx(reference.least_gap_m, abs=1e-12)
    assert length_m(np.diff(path_m, axis=0)).max() <= U_MAX_M + TOLERANCE_M
    assert path_m[0].tolist() == start_m.tolist()
    assert path_m[-1].tolist() == (-start_m).tolist()
    assert reference.straight_m - 1e-9 <= reference.bound_m <= reference.distance_m + TOLERANCE_M


@pytest.mark.parametrize(("seed", "uavs"), [(0, 2), (1, 3), (1, 4)])
def test_edc_never_flies_less_than_the_reference(seed: int, uavs: int) -> None:
    """A planner that keeps discs apart cannot undercut the optimum for the same slots, nor the bound."""
    problem, distance_m, path_m = flown("edc", seed, uavs)
    assert problem.least_gap_m(path_m) >= -TOLERANCE_M
    reference = found(problem)
    assert problem.bound_m() <= reference.distance_m + TOLERANCE_M
    assert reference.distance_m <= distance_m + uavs * TOLERANCE_M


def test_a_planner_that_avoids_nothing_undercuts_the_reference() -> None:
    """The comparison finds planner `straight`, which flies through others, as shorter than possible."""
    problem, distance_m, path_m = flown("straight", 1, 4)
    assert problem.least_gap_m(path_m) < -1.0
    assert distance_m < found(problem, starts=4).distance_m - 0.05


def test_a_programme_that_forgets_a_pair_yields_no_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    """Defect: no half-planes for the pair. The path overlaps, and is refused by the exact check, not reported."""
    whole = Programme.solve
    monkeypatch.setattr(Programme, "solve", lambda self, normal, near: whole(self, normal, near & False))
    assert solve(swap(), starts=2) is None


def test_least_objective_of_eq_13() -> None:
    """Alone: equal steps. In a pair: never more squares than the plan of least distance, and never less distance."""
    alone = found(problem_of([[0.0, 0.0]], [[30.0, 0.0]], 20), objective="squares", starts=1)
    assert length_m(np.diff(alone.path_m, axis=0)) == pytest.approx(np.full((20, 1), 1.5), abs=1e-5)
    assert alone.squares_m2 == pytest.approx(30**2 / 20)
    assert alone.least_gap_m == math.inf
    squares, distance = found(swap(3.0), objective="squares"), found(swap(3.0))
    assert squares.squares_m2 <= distance.squares_m2 + 1e-6
    assert distance.distance_m <= squares.distance_m + 1e-4


def test_too_little_time_for_all_is_no_plan() -> None:
    """Two UAVs whose straight ways take every slot cannot go round one another: None, and no invented plan."""
    start_m = np.array([[-30.0, 0.0], [30.0, 0.0]])
    assert solve(problem_of(start_m, -start_m, 24), starts=2) is None


def test_one_slot() -> None:
    """The shortest horizon has no place between start and target."""
    reference = found(problem_of([[0.0, 0.0], [20.0, 0.0]], [[2.0, 0.0], [22.0, 0.0]], 1), starts=1)
    assert reference.distance_m == pytest.approx(4.0)


def test_same_arguments_same_plan() -> None:
    """The search draws from its seed alone."""
    assert np.array_equal(found(swap(2.0), starts=6).path_m, found(swap(2.0), starts=6).path_m)


@pytest.mark.parametrize(
    ("start_m", "target_m", "slots", "field"),
    [
        ([[0.0, 0.0], [9.0, 0.0]], [[50.0, 0.0], [50.0, 20.0]], 30, "start_m"),
        ([[0.0, 0.0], [30.0, 0.0]], [[50.0, 0.0], [50.0, 5.0]], 30, "target_m"),
        ([[0.0, 0.0]], [[50.0, 0.0]], 19, "slots"),
        ([[0.0, 0.0]], [[50.0, 0.0]], 401, "slots"),
        ([[0.0, 0.0]], [[math.nan, 0.0]], 30, "target_m"),
        ([[20.0 * k, 0.0] for k in range(7)], [[20.0 * k, 9.0] for k in range(7)], 30, "start_m"),
    ],
)
def test_impossible_problems_are_refused(start_m: Floats, target_m: Floats, slots: int, field: str) -> None:
    """One line with the field and what is allowed."""
    with pytest.raises(InputError, match=rf"reference\.{field} = .*: must be "):
        problem_of(start_m, target_m, slots)
