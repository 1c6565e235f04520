"""Whole missions of vehicles with inertia: everything holds in wind, and every planted defect is noticed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from edc_swarm.analysis.guarantees.check import check
from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.emulation.multirotor import Multirotor
from edc_swarm.mission import roster, vehicle_budget
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.validation import mission_from_dict
from edc_swarm.planner.registry import make_planner
from edc_swarm.protocol.messages import Message, MissionMessage, mission_message
from edc_swarm.recording.model import Recording
from edc_swarm.simulation.simulator import Simulation

Patch = pytest.MonkeyPatch


def flown(**fields: Any) -> Recording:
    """Simulate a mission of four multirotors whose discs have no room to spare."""
    basis = {"uavs": 4, "area_m2": 2500.0, "vehicle": {"model": "multirotor"}, "gps_model": "white", "r_m": 3.0}
    message: MissionMessage = mission_message(complete_mission(mission_from_dict({**basis, **fields})))
    said: list[Message] = []
    planner = make_planner(message.planner, message)
    Simulation(message, lambda: planner, lambda _key, now, _ns: said.append(now)).run()
    return Recording.from_messages(said)


def broken(recording: Recording) -> dict[str, list[str]]:
    """The broken guarantees, with their violations."""
    return {result.guarantee: result.where for result in check(recording) if result.broken}


FAULTS = ["gps u002 outage @6 for 5s", "gust u003 5mps @5s for 3s", "gps u001 gauss-markov @8", "kill u004 @12 for 3s"]


@pytest.mark.parametrize("gps_model", ["white", "gauss-markov"])
def test_everything_holds_in_wind_and_with_faults(gps_model: str) -> None:
    """Outage, gust, another GPS model and a process that dies: the true paths stay inside their discs."""
    wind = {"mean_mps": 4.0, "gust_mps": 3.0}
    recording = flown(wind=wind, gps_model=gps_model, fault=FAULTS, seed=2)
    metrics = compute_metrics(recording)
    assert broken(recording) == {}
    assert (metrics.completed, metrics.true_collisions, metrics.potential_collisions) == (True, 0, 0)
    assert metrics.max_deviation_m is not None
    assert 0.5 < metrics.max_deviation_m < 3.0
    assert max(fix.r_m for fix in recording.fixes if fix.uav == "u002") > 3.5
    assert {fix.r_m for fix in recording.fixes if fix.uav != "u002"} == {3.0}


def halved_tracking(patch: Patch) -> None:
    """The budget has half of the tracking bound."""
    whole = vehicle_budget._budget

    def mutant(vehicle: Any, dt_s: float, speed_mps: float, winds: Any, disc: Any, has_outage: bool) -> Any:
        honest = whole(vehicle, dt_s, speed_mps, winds, (disc[0], disc[1], 0.05), has_outage)
        stated = (*disc[:2], disc[0] - disc[1] - 0.5 * honest.tracking_m)
        return whole(vehicle, dt_s, speed_mps, winds, stated, has_outage)

    patch.setattr(vehicle_budget, "_budget", mutant)
    patch.setattr(roster, "check_vehicles", lambda _: None)


def disc_that_does_not_grow(patch: Patch) -> None:
    """Without GPS the fix still says `r_m`."""
    fly = Multirotor.fly

    def mutant(self: Multirotor, *step: Any) -> Any:
        return replace(fly(self, *step), grown_m=0.0)

    patch.setattr(Multirotor, "fly", mutant)


def reference_without_inertia(patch: Patch) -> None:
    """The vehicle follows its steps as if it could turn at once."""
    patch.setattr(vehicle_budget, "a_max_mps2", lambda *_: 100.0)


OUTAGE = {"fault": ["gps u002 outage @2 for 15s"], "gps_model": "bias"}
DEFECTS: list[tuple[Callable[[Patch], None], dict[str, Any], str]] = [
    (halved_tracking, {"gps_model": "bias"}, "tracking_m was too small"),
    (disc_that_does_not_grow, OUTAGE, "gps_m was too small"),
    (reference_without_inertia, {"gps_model": "bias"}, "acceleration was too small"),
]


@pytest.mark.parametrize(("plant", "fields", "cause"), DEFECTS, ids=[plant.__name__ for plant, *_ in DEFECTS])
def test_planted_defects_are_found(plant: Callable[[Patch], None], fields: dict[str, Any], cause: str) -> None:
    """G3 names UAV, time, deviation, and the bound that was too small, in one of the first missions."""
    for seed in range(8):
        with pytest.MonkeyPatch.context() as patch:
            plant(patch)
            found = broken(flown(**fields, seed=seed)).get("G3", [])
        told = [line for line in found if "from its declared path" in line]
        if told:
            assert cause in told[0]
            return
    pytest.fail("no violation")


def test_a_weak_motor_is_named() -> None:
    """A UAV whose motors fail leaves its disc, and the check says why."""
    recording = flown(fault=["motor u001 weak 0.05 @5"], gps_model="bias", r_m=2.0, seed=1)
    lines = [line for line in broken(recording)["G3"] if "u001 is" in line]
    assert "its acceleration was too small, the controller asked for more than the vehicle had" in lines[0]
