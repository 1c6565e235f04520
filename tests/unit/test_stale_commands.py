"""No autopilot flies a command that came too late, or from a head that its UAV does not grant."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from edc_swarm.agent.effects import Effect, Publish, Received, Tick
from edc_swarm.agent.node import UavNode
from edc_swarm.agent.vehicle import Promise
from edc_swarm.autopilot.body import AutopilotBody
from edc_swarm.autopilot.path import Step
from edc_swarm.autopilot.pilot import Pilot, Stage
from edc_swarm.mission.vehicle_model import VehicleModel
from edc_swarm.protocol.messages import Command, Fix
from tests import builders
from tests.builders import mission_message, row
from tests.set_points import set_points_off_m
from tests.unit.test_autopilot import SENDER, Copter

TICK_NS = 50_000_000
SLOT_TICKS, SLOTS = 10, 8
MISSION = msgspec.structs.replace(
    mission_message(row(("a", "b"), gap_m=40.0, north_m=90.0, energy_j=1e4), gps_model="none"),
    vehicle=VehicleModel(model="mavlink", autopilot="udpin:127.0.0.1:{14550+i}", a_max_mps2=4.0),
    lag_slots=1,
)
START_M = (40.0, 0.0)
LATE_SLOT = 4


def step(slot: int, from_m: float, to_m: float, **fields: Any) -> Command:
    """Return a command to UAV b for a step to the north."""
    return builders.command("b", slot, (40.0, from_m), (40.0, to_m), **fields)


COMMANDS = {
    15: step(2, 0.0, 0.6),
    25: step(3, 0.6, 1.2, term=9, head="c"),
    LATE_SLOT * SLOT_TICKS + 1: step(LATE_SLOT, 0.6, 1.2),
    LATE_SLOT * SLOT_TICKS + 12: step(LATE_SLOT, 0.6, 1.2),
}
"""By the tick at which each comes: one in time, one of another head, one a tick too late, and the same a slot later."""


def flown() -> tuple[float, list[int]]:
    """Fly UAV b; return how far its set-points are from its declared path, and the slots of its steps."""
    vehicle = Copter(Pilot(MISSION, MISSION.roster[1], MISSION.epoch_ns, arm=True), MISSION)
    vehicle.at_m = START_M
    for tick in range(-300, 0):
        vehicle.say(MISSION.epoch_ns + tick * TICK_NS)
        vehicle.obey(MISSION.epoch_ns + tick * TICK_NS)
    assert vehicle.pilot.stage is Stage.FLYING
    assert vehicle.pilot.telemetry.system == SENDER
    body = AutopilotBody(MISSION, MISSION.epoch_ns, MISSION.roster[1], vehicle.pilot, START_M)
    promise = Promise(slot=-1, term=1, head="a", waypoint_x_m=START_M[0], waypoint_y_m=START_M[1])
    node = builders.node(MISSION, "b", promise, body=body)
    vehicle.sent.clear()
    effects: list[Effect] = []
    for tick in range(SLOTS * SLOT_TICKS):
        now_ns = MISSION.epoch_ns + tick * TICK_NS
        if tick % SLOT_TICKS == 0:
            effects += node.step(Tick(), now_ns)
        if tick in COMMANDS:
            effects += node.step(Received(COMMANDS[tick]), now_ns)
        vehicle.say(now_ns)
        vehicle.obey(now_ns)
    fixes = [effect.message for effect in effects if isinstance(effect, Publish) and isinstance(effect.message, Fix)]
    points = [fields for name, fields in vehicle.sent if name == "set_position_target_global_int"]
    received = [(fields["time_boot_ms"], fields["lat_int"], fields["lon_int"]) for fields in points]
    off_m = set_points_off_m(MISSION, MISSION.epoch_ns, "b", fixes, received)
    return off_m, [fix.slot for fix in fixes if fix.executing]


def test_stale_commands_are_never_flown() -> None:
    """One step of four commands: the set-points stay on the path that the fixes declare."""
    off_m, steps = flown()
    assert steps == [2]
    assert off_m < 0.02


def test_a_late_command_that_is_passed_on_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """A planted defect: a command for the slot that has begun goes straight to the pilot, while the fix says hold."""
    take = UavNode._take_command

    def leak(node: UavNode, command: Command) -> None:
        take(node, command)
        if command.slot == node.slot:
            here_m, there_m = (command.start_x_m, command.start_y_m), (command.target_x_m, command.target_y_m)
            start_ns = MISSION.epoch_ns + command.slot * MISSION.slot_ns
            node._vehicle._body._pilot.step = Step(start_ns, here_m, here_m, there_m)  # type: ignore[attr-defined]

    monkeypatch.setattr(UavNode, "_take_command", leak)
    off_m, steps = flown()
    assert steps == [2], "the fixes show nothing of it"
    assert off_m > 0.1
