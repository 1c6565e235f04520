"""The body: every reason to refuse a command, and what is flown."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import msgspec
import pytest

from edc_swarm.agent.vehicle import Promise, Situation, Vehicle, first_airframe, first_promise, refusal
from edc_swarm.emulation.energy import propulsion_power_w
from edc_swarm.mission.braking import change_of
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.faults import ChangeGps
from edc_swarm.mission.vehicle_model import VehicleModel
from tests.builders import command, entry

COMMAND = command("a", 7, (0.1, 0.2), (3.1, 4.2), head="h", term=3)
NOW = Situation(
    slot=7, grant=(3, "h"), waypoint_m=(0.1, 0.2), u_max_m=5.0, late_tick=False, energy_j=80.0, step_energy_j=80.0
)
ENTRY = entry("a", (1.0, 2.0), (10.0, 2.0), body_m=0.25, energy_j=1e4)


def test_a_valid_command() -> None:
    """A step of exactly u_max, with exactly the energy that it takes, is flown."""
    assert refusal(COMMAND, NOW) is None


@pytest.mark.parametrize(
    ("command", "now", "reason"),
    [
        ({"slot": 6}, {}, "another slot"),
        ({"slot": 8}, {}, "another slot"),
        ({"term": 2}, {}, "not from the head granted"),
        ({"term": 4}, {}, "not from the head granted"),
        ({"head": "g"}, {}, "not from the head granted"),
        ({}, {"grant": (-1, "")}, "not from the head granted"),
        ({"start_x_m": math.nextafter(0.1, 1)}, {}, "does not start at the own waypoint"),
        ({"start_y_m": math.nextafter(0.2, 0)}, {}, "does not start at the own waypoint"),
        ({"target_x_m": 3.2}, {}, "longer than a slot allows"),
        ({"target_x_m": 1e308}, {}, "longer than a slot allows"),
        ({}, {"u_max_m": math.nextafter(5.0, 0)}, "longer than a slot allows"),
        ({}, {"late_tick": True}, "the tick was late"),
        ({}, {"energy_j": math.nextafter(80.0, 0)}, "the battery does not cover it"),
    ],
)
def test_every_refusal(command: dict[str, Any], now: dict[str, Any], reason: str) -> None:
    """Each condition alone is enough, to the last bit."""
    assert refusal(msgspec.structs.replace(COMMAND, **command), replace(NOW, **now)) == reason


def vehicle(mission: Mission | None = None, promise: Promise | None = None) -> Vehicle:
    """A fresh vehicle."""
    return Vehicle(mission or Mission(), ENTRY, promise or first_promise(ENTRY), first_airframe(ENTRY))


def test_what_a_uav_is_created_with() -> None:
    """Term 0, nobody granted, no slot begun, at the roster start with a full battery."""
    promise = first_promise(ENTRY)
    assert (promise.slot, promise.grant, promise.waypoint_x_m, promise.waypoint_y_m) == (-1, (0, ""), 1.0, 2.0)
    assert first_airframe(ENTRY).energy_j == 1e4


def test_the_promise_says_where_the_disc_is() -> None:
    """After a restart the waypoint on disk counts; without a promise the body is where it is."""
    moved = Promise(waypoint_x_m=4.0, waypoint_y_m=5.0)
    assert vehicle(promise=moved).waypoint_m == (4.0, 5.0)
    lost = Vehicle(Mission(), ENTRY, None, msgspec.structs.replace(first_airframe(ENTRY), x_m=7.0, y_m=8.0))
    assert lost.waypoint_m == (7.0, 8.0)


def test_a_step() -> None:
    """Disc and truth move by the same vector, and the waypoint is the very target."""
    flying = vehicle()
    x0_m, y0_m = flying.flown.to_m
    assert math.hypot(x0_m - 1.0, y0_m - 2.0) <= 4.75
    step = msgspec.structs.replace(COMMAND, start_x_m=1.0, start_y_m=2.0, target_x_m=3.3, target_y_m=2.1)
    flying.begin_slot(1, step)
    assert (flying.from_m, flying.waypoint_m) == ((1.0, 2.0), (3.3, 2.1))
    assert flying.flown.from_m == pytest.approx((x0_m, y0_m))
    assert flying.flown.to_m == pytest.approx((x0_m + 2.3, y0_m + 0.1))
    flying.begin_slot(1, None)
    assert (flying.from_m, flying.waypoint_m) == ((3.3, 2.1), (3.3, 2.1))
    assert flying.airframe.x_m == 3.3


def test_the_next_fix_is_foreseen() -> None:
    """While the GPS error stays, what the next fix will say is known to the bit a slot before."""
    flying = vehicle()
    step = msgspec.structs.replace(COMMAND, start_x_m=1.0, start_y_m=2.0, target_x_m=3.3, target_y_m=2.1)
    flying.begin_slot(1, step)
    foreseen_m = flying.next_position_m
    flying.begin_slot(1, None)
    assert flying.position_m == foreseen_m == pytest.approx((3.3, 2.1))


def test_energy() -> None:
    """A step costs its power for the flown part and hovering for the rest; slept-through slots hover."""
    mission = Mission(guard_s=0.05)
    hover_w, cruise_w = (propulsion_power_w(v, mission.energy) for v in (0.0, 5.0))
    flying = vehicle(mission)
    assert flying.step_energy_j(2.0) == pytest.approx(cruise_w * 0.4 + hover_w * 0.1)
    assert flying.step_energy_j(0.0) == pytest.approx(hover_w * 0.5)
    flying.begin_slot(3, None)
    assert flying.energy_j == pytest.approx(1e4 - 3 * hover_w * 0.5)
    flying.spend(7.0)
    assert flying.energy_j == pytest.approx(1e4 - 3 * hover_w * 0.5 - 7.0)
    flying.spend(1e9)
    assert flying.energy_j == 0.0


@pytest.mark.parametrize(("x_m", "arrived"), [(9.9, True), (10.0, True), (9.899, False), (10.11, False)])
def test_arrived(x_m: float, arrived: bool) -> None:
    """Within a tenth of a metre of the target."""
    assert vehicle(promise=Promise(waypoint_x_m=x_m, waypoint_y_m=2.0)).arrived is arrived


@pytest.mark.parametrize(("step", "arrived"), [(0.0, True), (0.99, True), (1.01, False)])
def test_who_flies_past_has_not_arrived(step: float, arrived: bool) -> None:
    """With inertia a UAV at its target has arrived if its last step, in step changes, lets it rest there."""
    mission = Mission(vehicle=VehicleModel(model="multirotor"), lag_slots=1)
    step_m = step * change_of(mission, ENTRY)
    passing = Promise(waypoint_x_m=10.0, waypoint_y_m=2.0, from_x_m=10.0 - step_m, from_y_m=2.0, slot=3)
    assert vehicle(mission, passing).arrived is arrived
    assert vehicle(promise=passing).arrived


def test_another_gps_model_moves_nothing() -> None:
    """A GPS fault changes reports, neither the disc nor the truth."""
    flying = vehicle()
    before = (flying.flown, flying.waypoint_m)
    flying.disturb(ChangeGps("a", "white"))
    assert (flying.flown, flying.waypoint_m) == before
