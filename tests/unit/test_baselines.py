"""The baseline planners, and what they and local control refuse."""

from __future__ import annotations

import dataclasses
import sys
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from edc_swarm import extras
from edc_swarm.errors import InputError, MissionError
from edc_swarm.geometry import DISC_TOLERANCE_M, Floats, closest_approach_m
from edc_swarm.mission.baselines import BASELINES, LOCAL_PLANNERS
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.validation import mission_from_dict
from edc_swarm.planner.discs import Sight
from edc_swarm.planner.interface import Hull, Neighbour, Plan, PlanRequest
from edc_swarm.planner.registry import make_planner
from edc_swarm.protocol.messages import mission_message
from edc_swarm.simulation.closed_loop import closed_loop
from processes.cli.main import main
from tests.builders import entry, mission, row

STEP_M = 2.5


def crossing(**fields: Any) -> Mission:
    """Return four UAVs that meet in the middle of a cross, of two radii and two speeds."""
    ways = [((-30, 0.5), (30, 0.5)), ((30, -0.5), (-30, -0.5)), ((0.7, -30), (0.7, 30)), ((-0.7, 30), (-0.7, -30))]
    roster = [
        entry(f"u{k}", start, to, r_m=5.0 - k % 2, v_max_mps=5.0 - k % 2, energy_j=1e6)
        for k, (start, to) in enumerate(ways)
    ]
    return mission(roster, **fields)


def flown(planner: str, flight: Mission, slots: int = 120, blind: tuple[int, int] | None = None) -> Floats:
    """Return positions (slots + 1, n, 2); each UAV plans for itself among all others as they are.

    `blind` is the defect: the first UAV of it does not see the second one.
    """
    count, minds = len(flight.roster), [make_planner(planner, flight) for _ in flight.roster]
    place = np.array([(e.start_x_m, e.start_y_m) for e in flight.roster])
    path, step = [place], np.zeros_like(place)
    for slot in range(slots):
        here, last = path[-1].tolist(), step.tolist()
        seen = [
            Neighbour(k, here[k][0], here[k][1], last[k][0], last[k][1], flight.roster[k].r_m) for k in range(count)
        ]
        planned = [
            minds[k].plan(
                PlanRequest(
                    slot, [k], [path[-1][k]], [(flight.roster[k].target_x_m, flight.roster[k].target_y_m)],
                    [flight.roster[k].r_m], neighbours=[o for o in seen if o.uav != k and (k, o.uav) != blind],
                )
            ).waypoint_m[0]
            for k in range(count)
        ]  # fmt: skip
        path.append(np.array(planned))
        step = path[-1] - path[-2]
    return np.array(path)


def least_gap_m(path_m: Floats, flight: Mission) -> float:
    """Return the least gap between two discs while all fly evenly."""
    r_m = np.array([e.r_m for e in flight.roster])
    first, second = np.triu_indices(len(r_m), 1)
    away_m = closest_approach_m(path_m[:-1, first], path_m[1:, first], path_m[:-1, second], path_m[1:, second])
    return float((away_m - r_m[first] - r_m[second]).min())


@pytest.mark.parametrize("planner", LOCAL_PLANNERS)
def test_uavs_that_plan_for_themselves_keep_apart_and_arrive(planner: str) -> None:
    """Each knows its own radius and speed; all see all."""
    flight = crossing()
    path_m = flown(planner, flight)
    assert least_gap_m(path_m, flight) >= -DISC_TOLERANCE_M
    target_m = np.array([(e.target_x_m, e.target_y_m) for e in flight.roster])
    assert np.abs(path_m[-1] - target_m).max() < 0.1
    for before, after in pairwise(path_m):
        assert (np.hypot(*(after - before).T) <= np.array(flight.steps_m)).all()


@pytest.mark.parametrize("planner", LOCAL_PLANNERS)
def test_a_uav_that_ignores_one_neighbour_is_found(planner: str) -> None:
    """The defect for which the test above exists."""
    flight = mission(
        [entry("a", (-20, 0.0), (20, 0.0), v_max_mps=5.0), entry("b", (0.0, 0.3), (0.0, 0.3), energy_j=1e6)]
    )
    assert least_gap_m(flown(planner, flight, 40), flight) >= -DISC_TOLERANCE_M
    assert least_gap_m(flown(planner, flight, 40, blind=(0, 1)), flight) < -0.05


@pytest.mark.parametrize("planner", BASELINES)
def test_a_head_plans_for_all_and_keeps_clear_of_hulls(planner: str) -> None:
    """A hull ahead; the UAV that flies straight at it stops or turns, and never enters."""
    flight = mission(row("ab", 30.0, 60.0))
    mind, place_m = make_planner(planner, flight), np.array([(0.0, 0.0), (30.0, 0.0)])
    hull = Hull(2, 1.0, 18.0, 3.0, 18.0, 0.5, 5.0)
    for slot in range(30):
        request = PlanRequest(slot, [0, 1], place_m, [(0, 60), (30, 60)], [5.0, 5.0], [hull])
        place_m = np.array(mind.plan(request).waypoint_m)
        x_m, y_m = place_m[0]
        assert np.hypot(x_m - min(max(x_m, 1.0), 3.0), y_m - 18.0) >= 10.5 - 0.02
    assert place_m[1] == pytest.approx((30.0, 60.0), abs=0.1)


@pytest.mark.parametrize("planner", BASELINES)
def test_under_a_head_all_arrive(planner: str) -> None:
    """The same cross, planned for all at once; steps stay within each UAV's own."""
    flight = crossing()
    path_m, _ = closed_loop(mission_message(complete_mission(flight)), make_planner(planner, flight))
    assert least_gap_m(path_m, flight) >= -DISC_TOLERANCE_M
    target_m = np.array([(e.target_x_m, e.target_y_m) for e in flight.roster])
    assert np.abs(path_m[-1] - target_m).max() < 0.1
    assert (np.hypot(*np.moveaxis(np.diff(path_m, axis=0), -1, 0)) <= np.array(flight.steps_m)).all()


@pytest.mark.parametrize(
    ("horizon_slots", "age_slots", "x_m"), [(10, 0, 8.0), (10, 4, 16.0), (10, 11, 8.0), (0, 4, 8.0)]
)
def test_neighbours_without_a_fix_go_on_as_far_as_the_method_says(
    horizon_slots: int, age_slots: int, x_m: float
) -> None:
    """ORCA and barrier certificates extrapolate for their horizon, buffered Voronoi cells use positions alone."""
    other = Neighbour(1, 8.0, 0.0, 2.0, 0.0, 5.0, age_slots)
    request = PlanRequest(5, [0], [(0.0, 0.0)], [(9.0, 0.0)], [5.0], neighbours=[other])
    discs = Sight(mission(row("ab", 30.0, 60.0)), horizon_slots).discs(request)
    assert discs.other_m.tolist() == [[x_m, 0.0]]


def test_the_wheel_of_orca_may_be_missing(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """One line with the command that works."""
    monkeypatch.setattr(extras, "has_package", lambda module: module != "pyrvo")
    assert main(["sim", "--planner", "orca", "--fence", "none"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: --planner = 'orca'")
    assert "[baselines]" in line
    monkeypatch.setitem(sys.modules, "pyrvo", None)
    with pytest.raises(InputError, match="baselines"):
        make_planner("orca", crossing())


@pytest.mark.parametrize(
    ("fields", "field", "said"),
    [
        ({"planner": "bvc"}, "zone", "--fence none"),
        ({"planner": "cbf", "lag_slots": 1}, "lag_slots", "cbf"),
        ({"planner": "orca", "vehicle": {"model": "arducopter"}, "r_m": 9.0}, "planner", "arducopter"),
        ({"control": "local"}, "planner", "orca, bvc, cbf"),
        ({"control": "local", "planner": "straight"}, "planner", "package.module:Class"),
        ({"control": "local", "planner": "bvc", "fault": ["kill head @5"]}, "fault", "no head"),
        ({"control": "local", "planner": "bvc", "fault": ["slow u001 5 @5"]}, "fault", "solver"),
        ({"control": "local", "planner": "bvc", "resends": 4}, "resends", "repeats no message"),
        ({"control": "local", "planner": "bvc", "elect": "response-time"}, "elect", "elects nobody"),
        ({"planner": "priority", "minimise": "energy"}, "minimise", "distance"),
        ({"planner": "bvc", "responses": 3}, "responses", "no best response"),
        ({"control": "locally"}, "control", "head, local"),
    ],
)
def test_what_baselines_and_local_control_lack_is_refused_by_name(
    fields: dict[str, Any], field: str, said: str
) -> None:
    """Never ignored."""
    fence = {} if field == "zone" else {"fence": "none"}
    with pytest.raises(MissionError) as caught:
        complete_mission(mission_from_dict({"uavs": 3, **fence, **fields}))
    assert caught.value.field == field
    assert said in caught.value.allowed


def test_plans_are_the_same_again() -> None:
    """Same seed, same bytes: no planner draws from anything but seed, slot and UAV."""
    flight = crossing()
    request = PlanRequest(
        3, [0, 1, 2, 3], [(e.start_x_m, e.start_y_m) for e in flight.roster],
        [(e.target_x_m, e.target_y_m) for e in flight.roster], [e.r_m for e in flight.roster],
    )  # fmt: skip
    for planner in BASELINES:
        plans: list[Plan] = [make_planner(planner, flight).plan(request) for _ in range(2)]
        assert dataclasses.asdict(plans[0]) == dataclasses.asdict(plans[1])
