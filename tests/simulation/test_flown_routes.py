"""Routes in flight: no stop at each point, the place in the route over fail-overs and restarts, metrics and times."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import pytest

from edc_swarm.analysis.guarantees.check import check
from edc_swarm.analysis.metrics import Deadline, compute_metrics
from edc_swarm.analysis.outcome import not_home_of
from edc_swarm.analysis.replanning import replan
from edc_swarm.analysis.tables import metric_rows
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.validation import load_mission, mission_from_dict
from edc_swarm.planner.registry import make_planner
from edc_swarm.protocol.messages import Fix, Message, MissionMessage, mission_message
from edc_swarm.recording.model import Recording
from edc_swarm.simulation.simulator import Simulation

STRIPS = [[30.0, 0.0], [30.0, 6.0], [0.0, 6.0], [0.0, 12.0], [30.0, 12.0]]


def roster(**fields: Any) -> list[dict[str, Any]]:
    """Three UAVs that fly strips 40 m apart."""
    return [
        {
            "uav": f"u{k}",
            "start_x_m": 0.0,
            "start_y_m": 40.0 * k,
            "route": [[x_m, y_m + 40.0 * k] for x_m, y_m in STRIPS],
            **fields,
        }
        for k in range(3)
    ]


def flown(*faults: str, **fields: Any) -> Recording:
    """The recording of a simulated mission of three UAVs with routes."""
    mission = complete_mission(mission_from_dict({"roster": roster(), "r_m": 3.0, **fields, "fault": list(faults)}))
    return recorded(mission_message(mission))


def recorded(message: MissionMessage) -> Recording:
    """The recording of a simulated mission."""
    said: list[Message] = []
    Simulation(message, lambda: make_planner("edc", message), lambda _key, now, _ns: said.append(now)).run()
    return Recording.from_messages(said)


def legs(recording: Recording, uav: str) -> list[int]:
    """The numbers of points reached, fix by fix."""
    return [fix.course.leg for fix in recording.fixes if fix.uav == uav]


def held(recording: Recording) -> set[str]:
    """Guarantees that held."""
    return {result.guarantee for result in check(recording) if result.status == "held"}


def steps_m(recording: Recording, uav: str) -> list[float]:
    """Lengths of the steps of a UAV, slot by slot: a UAV may publish its fix again for a new head."""

    def step_m(fix: Fix) -> float:
        return math.dist((fix.from_x_m, fix.from_y_m), (fix.waypoint_x_m, fix.waypoint_y_m))

    return list({fix.slot: step_m(fix) for fix in recording.fixes if fix.uav == uav and fix.executing}.values())


def test_a_uav_does_not_stop_at_each_point() -> None:
    """In the open only the last step is short: the corners are cut within the acceptance radius."""
    recording = flown()
    for uav in ("u0", "u1", "u2"):
        moving = [step_m for step_m in steps_m(recording, uav) if step_m > 0]
        assert min(moving[:-1]) > 0.6 * 2.5
        assert sorted(moving)[len(moving) // 5] == pytest.approx(2.5)
        assert legs(recording, uav)[-1] == len(STRIPS) - 1
    metrics = compute_metrics(recording)
    assert metrics.straight_m == 3 * 102.0
    assert metrics.completed
    assert metrics.path_m is not None
    assert 0.9 * 306 < metrics.path_m < 306
    assert metrics.makespan_ratio is not None
    assert 1.0 <= metrics.makespan_ratio < 1.15
    assert held(recording) >= {"G1", "G2", "G3", "G4", "G5", "G7"}


def test_every_point_is_passed_within_the_radius() -> None:
    """The true steps, not the UAV's word: each point is within `accept_m` of the way flown, in order."""
    recording = flown()
    for k, uav in enumerate(("u0", "u1", "u2")):
        places = [(f.waypoint_x_m, f.waypoint_y_m) for f in recording.fixes if f.uav == uav]
        nearest = []
        for x_m, y_m in STRIPS:
            point = (x_m, y_m + 40.0 * k)
            away_m = [_away_m(point, a, b) for a, b in pairwise(places)]
            nearest.append(min(range(len(away_m)), key=away_m.__getitem__))
            assert min(away_m) <= 1.0
        assert nearest == sorted(nearest)


def _away_m(point: tuple[float, float], a: tuple[float, float], b: tuple[float, float]) -> float:
    return min(math.dist(point, (a[0] + s / 50 * (b[0] - a[0]), a[1] + s / 50 * (b[1] - a[1]))) for s in range(51))


def test_hovering_takes_its_time() -> None:
    """A UAV that hovers 3 s at two points stands still for twelve slots more, within the acceptance radius."""
    plain, hovering = flown(), flown(roster=roster(hover_s=[3.0, 0.0, 3.0, 0.0, 0.0]))
    assert held(hovering) >= {"G3", "G7"}
    more = (compute_metrics(hovering).slots or 0) - (compute_metrics(plain).slots or 0)
    assert 12 <= more <= 16
    assert steps_m(hovering, "u0").count(0.0) >= 10


@pytest.mark.parametrize("at", [12, 17, 25, 33])
def test_a_new_head_plans_on_from_the_place_in_the_route(at: int) -> None:
    """The head dies in mid-route: no UAV flies to a point again, and all that live arrive."""
    recording = flown(f"kill head @{at}")
    metrics = compute_metrics(recording)
    assert len(metrics.heads) == 2
    assert held(recording) >= {"G1", "G2", "G3", "G7"}
    assert metrics.arrived == 2
    for uav in {"u0", "u1", "u2"} - set(metrics.not_living):
        assert legs(recording, uav) == sorted(legs(recording, uav))
        assert sum(steps_m(recording, uav)) < 102 + 5


@pytest.mark.parametrize("who", ["u1", "head"])
@pytest.mark.parametrize("at", [13, 20, 29])
def test_a_restart_keeps_the_place_in_the_route(who: str, at: int) -> None:
    """A process that comes back goes on with the point that it was flying to."""
    recording = flown(f"kill {who} @{at} for 3s", f"restart u2 @{at + 11}")
    metrics = compute_metrics(recording)
    assert metrics.completed
    assert held(recording) >= {"G1", "G2", "G3", "G7"}
    for uav in ("u0", "u1", "u2"):
        assert legs(recording, uav) == sorted(legs(recording, uav))
        assert sum(steps_m(recording, uav)) < 102 + 5


def test_a_plan_of_a_recording_with_routes_is_the_same_again() -> None:
    """The request is rebuilt from the fixes, aims and all."""
    recording = flown("kill u0 @20", roster=roster(hover_s=[0.0, 2.0, 0.0, 0.0, 0.0]))
    again = replan(recording, lambda: make_planner("edc", recording.mission))
    assert again.plans > 40
    assert (again.identical, again.skipped) == (again.commands, 0)


def test_times_to_finish_are_met_or_missed() -> None:
    """Each is told, with how late; a UAV that is not there has missed it; without motion it is unknown."""
    rows = roster()
    for row, finish_by_s in zip(rows, (60.0, 10.0, 60.0), strict=True):
        row["finish_by_s"] = finish_by_s
    recording = flown("kill u2 @20", roster=rows)
    on_time, late, dead = compute_metrics(recording).deadlines
    assert (on_time.uav, on_time.met, late.uav, late.met) == ("u0", True, "u1", False)
    assert late.finished_s is not None
    assert late.finished_s > 15
    assert dead == Deadline("u2", 60.0, None, False)
    told = dict(metric_rows(compute_metrics(recording)))["finish times"]
    assert told.startswith("1 of 3 met; missed by u1 (")
    assert "missed by u2 (not there, by 60 s)" in told
    recording.fixes[:] = [fix for fix in recording.fixes if fix.uav != "u0" or fix.slot % 2]
    assert compute_metrics(recording).deadlines[0].met is None


def test_a_uav_back_at_its_start_is_not_home_before_its_round() -> None:
    """A route that ends where it began is flown; a UAV that never set out has not arrived."""
    row = {"uav": "u0", "start_x_m": 0.0, "start_y_m": 0.0, "route": [[20.0, 0.0], [0.0, 0.0]]}
    recording = flown(roster=[row])
    assert compute_metrics(recording).completed
    assert max(fix.waypoint_x_m for fix in recording.fixes) > 18
    stopped = flown(roster=[row], max_slots=8)
    stopped.fixes[:] = [fix for fix in stopped.fixes if fix.slot == 0]
    stopped.commands.clear()
    stopped.truths.clear()
    assert [away.uav for away in not_home_of(stopped)] == ["u0"]
    assert compute_metrics(stopped).completed is not True


def test_the_survey_completes() -> None:
    """The scenario: a fail-over in mid-route, all back in time."""
    recording = recorded(mission_message(complete_mission(load_mission("scenarios/survey.toml"))))
    metrics = compute_metrics(recording)
    assert (metrics.completed, metrics.potential_collisions, len(metrics.heads)) == (True, 0, 2)
    assert [deadline.met for deadline in metrics.deadlines] == [True] * 5
    assert held(recording) >= {"G1", "G2", "G3", "G7"}
