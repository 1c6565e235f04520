"""Speeds and radii of single UAVs: what a roster entry inherits, and every place that knows the speed of a UAV."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np
import pytest

from edc_swarm.agent.flight import Flight
from edc_swarm.agent.knowledge import HullRules, Knowledge
from edc_swarm.agent.vehicle import Vehicle, first_airframe, first_promise
from edc_swarm.analysis.guarantees.check import check
from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.emulation.energy import propulsion_power_w, stranded
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.prospect import prospect_of
from edc_swarm.mission.roster import complete_mission, random_roster
from edc_swarm.mission.validation import load_mission, mission_from_dict
from edc_swarm.planner.interface import PlanRequest
from edc_swarm.planner.registry import make_planner
from edc_swarm.protocol.admission import Admission
from edc_swarm.protocol.messages import Command, Fix, Message, mission_message
from edc_swarm.recording.model import Recording
from edc_swarm.simulation.simulator import Simulation
from edc_swarm.solver.certificate import limited_waypoints

FAST, SLOW = "fast", "slow"
MISSION = complete_mission(
    mission_from_dict(
        {
            "v_max_mps": 4.0,
            "roster": [
                {"uav": FAST, "start_x_m": 0, "start_y_m": 0, "target_x_m": 100, "target_y_m": 0, "v_max_mps": 20.0},
                {"uav": SLOW, "start_x_m": 0, "start_y_m": 50, "target_x_m": 60, "target_y_m": 50},
            ],
        }
    )
)
"""Longest steps of 10 m and of 2 m."""


def test_an_entry_inherits_what_it_leaves_out() -> None:
    """Radii and speed are the mission's; the charges are those of a random mission of that seed, by index."""
    entry = {"start_x_m": 0.0, "target_x_m": 0.0}
    raw = [{**entry, "uav": f"v{k}", "start_y_m": 20.0 * k, "target_y_m": 20.0 * k + 9} for k in range(3)]
    raw[1] |= {"r_m": 2.0, "energy_j": 7e4}
    mission = complete_mission(mission_from_dict({"seed": 5, "r_m": 4.0, "body_m": 0.5, "roster": raw}))
    drawn_j = [drawn.energy_j for drawn in random_roster(Mission(seed=5, uavs=3))]
    assert [e.r_m for e in mission.roster] == [4.0, 2.0, 4.0]
    assert [e.body_m for e in mission.roster] == [0.5] * 3
    assert [e.energy_j for e in mission.roster] == [drawn_j[0], 7e4, drawn_j[2]]
    assert mission.speeds_mps == [5.0] * 3
    assert complete_mission(mission) == mission


def test_a_mission_without_roster_has_one_speed_for_all() -> None:
    """A planner can be made before the roster is drawn."""
    assert Mission(uavs=3, v_max_mps=4.0).steps_m == [2.0] * 3


def test_the_limit_of_progress_is_that_of_the_slowest_flight() -> None:
    """100 m at 20 m/s take less time than 60 m at 4 m/s."""
    assert prospect_of(MISSION, []).limit_slots == 20 * 60 / 2 + 200


def test_no_uav_is_farther_than_its_own_speed_takes_it() -> None:
    """A fix of the slow UAV that only the fast one could send is rejected."""
    message = mission_message(MISSION)
    admission = Admission(message)

    def reason(uav: str, to_m: float) -> str | None:
        start_y_m = next(e.start_y_m for e in MISSION.roster if e.uav == uav)
        sent_ns = message.epoch_ns + 2 * message.slot_ns
        return admission.refusal(
            Fix(uav=uav, slot=1, x_m=0, y_m=0, r_m=5, sent_ns=sent_ns, waypoint_x_m=to_m, waypoint_y_m=start_y_m)
        )

    assert reason(FAST, 20.0) is None
    assert reason(SLOW, 4.0) is None
    assert "from the start" in (reason(SLOW, 4.1) or "")
    assert "from the start" in (reason(FAST, 20.1) or "")


@pytest.mark.parametrize(("uav", "radius_m"), [(FAST, 30.0), (SLOW, 6.0)])
def test_a_hull_grows_by_the_step_of_its_own_uav(uav: str, radius_m: float) -> None:
    """Three slots without news: three longest steps of that UAV."""
    rules = HullRules({e.uav: MISSION.step_m(e) for e in MISSION.roster}, 0)
    assert Knowledge(MISSION.roster).hull(uav, (1, "a"), 1, {}, rules).radius_m == radius_m


@pytest.mark.parametrize(("length_m", "flown"), [(2.0, True), (math.nextafter(2.0, 3), False), (10.0, False)])
def test_a_uav_rejects_a_step_beyond_its_own_longest(length_m: float, flown: bool) -> None:
    """The slow UAV flies 2 m and no more, although the fast one may fly 10 m."""
    entry = MISSION.roster[1]
    vehicle = Vehicle(MISSION, entry, first_promise(entry), first_airframe(entry))
    flight = Flight(vehicle, voter=True)
    to: dict[str, Any] = {"target_x_m": length_m, "target_y_m": 50.0}
    flight.keep(Command(head="a", uav=SLOW, slot=1, term=1, start_x_m=0, start_y_m=50.0, **to))
    flight.begin_slot(1, 1, (1, "a"), late=False)
    assert (flight.flown is not None) == flown
    assert vehicle.waypoint_m == ((length_m, 50.0) if flown else (0.0, 50.0))


@pytest.mark.parametrize("planner", ["edc", "straight"])
def test_every_planner_uses_the_speed_of_each_uav(planner: str) -> None:
    """In the open each UAV flies its own longest step, whichever UAVs the request has."""
    made = make_planner(planner, MISSION)
    both = made.plan(PlanRequest(1, [0, 1], [(0, 0), (0, 50)], [(100, 0), (60, 50)], [5, 5]))
    one = made.plan(PlanRequest(2, [1], [(2, 50)], [(60, 50)], [5]))
    assert [x_m for x_m, _ in both.waypoint_m] == pytest.approx([10.0, 2.0])
    assert both.waypoint_m[0][0] <= 10.0
    assert one.waypoint_m[0][0] == pytest.approx(4.0)


def test_the_paper_flies_all_for_as_long_as_the_slowest() -> None:
    """F is the longest flight in slots, 1.1 * 60 / 2: in it each UAV flies equal steps."""
    plan = make_planner("paper", MISSION).plan(PlanRequest(1, [0, 1], [(0, 0), (0, 50)], [(100, 0), (60, 50)], [5, 5]))
    assert [x_m for x_m, _ in plan.waypoint_m] == pytest.approx([100 / 33, 60 / 33], rel=1e-4)


def test_waypoints_are_limited_one_by_one() -> None:
    """A wish beyond the own longest step ends there."""
    here_m = np.zeros((2, 2))
    waypoint_m = limited_waypoints(here_m, np.array([[50.0, 0.0], [50.0, 0.0]]), np.array([10.0, 2.0]))
    assert waypoint_m[:, 0] == pytest.approx([10.0, 2.0])
    assert (waypoint_m[:, 0] <= [10.0, 2.0]).all()


def test_energy_is_that_of_the_own_speed() -> None:
    """A charge for 100 m at 20 m/s is too little for 60 m at 4 m/s, which take three times as long."""
    slow_j, fast_j = (propulsion_power_w(v, MISSION.energy) * (way_m - 0.1) / v for v, way_m in ((4, 60), (20, 100)))
    assert fast_j < slow_j
    roster = [msgspec.structs.replace(e, energy_j=fast_j) for e in MISSION.roster]
    assert stranded(msgspec.structs.replace(MISSION, roster=roster)) == {SLOW: pytest.approx(slow_j)}


def flown(mission: Mission) -> Recording:
    """The recording of a simulated mission."""
    message, said = mission_message(mission), list[Message]()
    Simulation(message, lambda: make_planner("edc", message), lambda _key, now, _ns: said.append(now)).run()
    return Recording.from_messages(said)


def test_a_helicopter_among_slow_uavs_flies_well() -> None:
    """All arrive, no step is longer than its UAV flies, and the last arrival is close to the least possible."""
    recording = flown(complete_mission(load_mission("scenarios/mixed_speeds.toml")))
    metrics = compute_metrics(recording)
    longest_m = {entry.uav: recording.mission.step_m(entry) for entry in recording.mission.roster}
    steps_m: dict[str, float] = {}
    for fix in recording.fixes:
        step_m = math.dist((fix.from_x_m, fix.from_y_m), (fix.waypoint_x_m, fix.waypoint_y_m))
        steps_m[fix.uav] = max(step_m, steps_m.get(fix.uav, 0.0))
    assert all(0.99 * longest_m[uav] <= steps_m[uav] <= longest_m[uav] for uav in longest_m)
    assert (metrics.completed, metrics.potential_collisions) == (True, 0)
    assert metrics.makespan_ratio is not None
    assert 1.0 <= metrics.makespan_ratio < 1.1
    assert {result.guarantee: result.status for result in check(recording)} == {
        **dict.fromkeys(["G1", "G2", "G3", "G4", "G5", "G7"], "held"),
        "G8": "not-applicable",
    }


def test_the_judge_knows_the_speed_of_each_uav() -> None:
    """G2 is broken by a step of the slow UAV that the fast one may fly."""
    recording = flown(MISSION)
    longer = msgspec.structs.replace(
        recording.mission,
        roster=[msgspec.structs.replace(e, v_max_mps=4.0 if e.uav == FAST else 0.0) for e in MISSION.roster],
    )
    messages: list[Any] = [longer, *recording.commands, *recording.fixes, *recording.reports, *recording.events]
    result = {result.guarantee: result for result in check(Recording.from_messages(messages))}["G2"]
    assert {violation.kind for violation in result.violations} >= {"too-long"}
