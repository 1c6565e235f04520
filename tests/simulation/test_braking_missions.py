"""UAVs that cannot stop at once: missions complete, no discs overlap, and the fuzzer finds each planted defect."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from functools import partial
from typing import Any

import msgspec
import numpy as np
import pytest

from edc_swarm.agent import flight, knowledge, vehicle
from edc_swarm.agent.vehicle import Promise, Vehicle
from edc_swarm.experiments.fuzz_scenarios import scenario
from edc_swarm.experiments.fuzzing import fly, search
from edc_swarm.geometry import Floats, length_m
from edc_swarm.mission.braking import Point
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.validation import mission_from_dict
from edc_swarm.planner.registry import make_planner
from edc_swarm.protocol.messages import Command, Message, mission_message
from edc_swarm.simulation.simulator import Simulation
from edc_swarm.solver.stopping import ROOM_M, Momentum

Patch = pytest.MonkeyPatch
Defect = Callable[[Patch], None]
AS_BEFORE = [
    ({"uavs": 6, "seed": 3, "max_slots": 40, "fault": ["kill head @4s"]}, "257839e28f4a037a0539de92b8d8b61b"),
    (
        {
            "uavs": 5,
            "seed": 4,
            "lag_slots": 1,
            "max_slots": 40,
            "link": [{"loss": 0.3}],
            "fault": ["partition halves @6s for 5"],
        },
        "a7b24f834413e082b75c9e7e750db7fb",
    ),
]
"""Missions of ideal vehicles, and a digest of their commands by the version before there were others; that with lost
messages is of the version in which standbys stay while fixes are late."""
INERT = [seed for seed in range(60) if not scenario(seed).vehicle.is_ideal]
"""Seeds whose vehicles have inertia."""


def braking_ignored_in_the_rows(patch: Patch) -> None:
    """Solver and certificate take every UAV for one that stops at its waypoint."""
    patch.setattr(Momentum, "rest_m", property(lambda self: self.position_m))
    patch.setattr(Momentum, "stops_m", lambda _self, waypoint_m: waypoint_m)
    patch.setattr(Momentum, "waypoints_m", lambda _self, stop_m: stop_m)


def step_change_unlimited(patch: Patch) -> None:
    """Neither the planner nor the UAV limits the change between two steps."""

    def towards(self: Momentum, wish_m: Floats) -> Floats:
        step_m = wish_m - self.position_m
        share = np.minimum((self.u_max_m - ROOM_M) / np.maximum(length_m(step_m), 1e-12), 1.0)
        return np.asarray(self.position_m + share[:, None] * step_m)

    def allows(self: Momentum, waypoint_m: Floats, _slack: float = 0.0) -> Any:
        return length_m(waypoint_m - self.position_m) <= self.u_max_m

    patch.setattr(Momentum, "towards_m", towards)
    patch.setattr(Momentum, "allows", allows)
    patch.setattr(vehicle, "allows", lambda *_: True)


def hull_without_its_braking_path(patch: Patch) -> None:
    """A head takes an unheard UAV for one that stops at once."""

    def stops(_from_m: Point, to_m: Point, _change_m: float) -> Point:
        return to_m

    patch.setattr(knowledge, "rest_point", stops)
    patch.setattr(knowledge, "reach_m", lambda _length_m, slots, u_max_m, _change_m: u_max_m * max(slots, 0))


def last_step_forgotten_over_a_restart(patch: Patch) -> None:
    """The promise on the disk loses the start of the step: a restarted UAV stands still at once."""
    write = flight.Flight.promise

    def mutant(self: flight.Flight, slot: int, grant: Any) -> Promise | None:
        promise = write(self, slot, grant)
        return None if promise is None else msgspec.structs.replace(promise, from_x_m=None, from_y_m=None)

    patch.setattr(flight.Flight, "promise", mutant)


def frozen_uav_stands_still(patch: Patch) -> None:
    """A UAV whose process misses slots goes on from where it was, instead of from where it has braked."""

    def mutant(self: Vehicle, slot: int) -> None:
        self.slot = max(self.slot, slot - 1)

    patch.setattr(Vehicle, "brake_until", mutant)


DEFECTS: list[tuple[Defect, int]] = [
    (braking_ignored_in_the_rows, 3),
    (step_change_unlimited, 3),
    (hull_without_its_braking_path, 20),
    (last_step_forgotten_over_a_restart, 20),
    (frozen_uav_stands_still, 20),
]


@pytest.mark.parametrize(("defect", "runs"), DEFECTS, ids=[defect.__name__ for defect, _ in DEFECTS])
def test_the_fuzzer_finds(defect: Defect, runs: int, monkeypatch: Patch) -> None:
    """A planted defect breaks a guarantee within the stated number of runs with inertia, which hold without it."""
    with monkeypatch.context() as patch:
        defect(patch)
        seed = next((seed for seed in INERT[:runs] if search(seed)), None)
    assert seed is not None, f"{defect.__name__} went unnoticed in {runs} runs"
    assert search(seed) is None
    print(defect.__name__, INERT.index(seed) + 1)


@pytest.mark.parametrize("seed", [300131, 300443])
def test_braking_in_every_other_slot_without_a_fix_is_no_command(seed: int) -> None:
    """A head that plans for two slots says every other fix; where it brakes in between, it flies no late command."""
    mission = scenario(seed, (0, 2))
    assert mission.fault[0].startswith("slow")
    assert mission.vehicle.model == "multirotor"
    assert fly(mission) == []


def _commands(mission: Mission) -> list[Command]:
    message, said = mission_message(complete_mission(mission)), list[Message]()
    make = partial(make_planner, mission.planner, message)
    Simulation(message, make, lambda _key, said_now, _ns: said.append(said_now)).run()
    return [heard for heard in said if isinstance(heard, Command)]


@pytest.mark.parametrize(("fields", "digest"), AS_BEFORE)
def test_ideal_vehicles_fly_as_before(fields: dict[str, Any], digest: str) -> None:
    """Every command of a seed is the same to the last bit."""
    text = "".join(
        f"{c.slot} {c.uav} {c.start_x_m!r} {c.start_y_m!r} {c.target_x_m!r} {c.target_y_m!r};"
        for c in _commands(mission_from_dict({"area_m2": 2500, **fields}))
    )
    assert hashlib.sha256(text.encode()).hexdigest()[:32] == digest


def test_vehicles_with_inertia_complete_a_dense_mission() -> None:
    """Ten UAVs on 50 m x 50 m arrive, every guarantee holds, and the UAVs reach their full speed."""
    mission = mission_from_dict({"uavs": 10, "area_m2": 3600, "seed": 5, "r_m": 3, "vehicle": {"model": "multirotor"}})
    assert fly(mission) == []
    lengths_m = [math.dist((c.start_x_m, c.start_y_m), (c.target_x_m, c.target_y_m)) for c in _commands(mission)]
    assert max(lengths_m) > 0.99 * mission.u_max_m
