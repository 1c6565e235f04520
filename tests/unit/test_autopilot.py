"""An autopilot as a body: what it is told and when, what is checked, and what makes its UAV stray."""

from __future__ import annotations

import math
import struct
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from msgspec import UNSET

from edc_swarm.agent.effects import Publish, Tick
from edc_swarm.agent.vehicle import first_promise
from edc_swarm.autopilot.body import AutopilotBody
from edc_swarm.autopilot.path import Step, set_point
from edc_swarm.autopilot.pilot import Pilot, Stage
from edc_swarm.emulation.body import Flown, PastFlight
from edc_swarm.errors import MissionError
from edc_swarm.geodesy import from_wgs84, to_wgs84
from edc_swarm.mission.autopilots import address, autopilots
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.validation import mission_from_dict
from edc_swarm.mission.vehicle_budget import vehicle_of
from edc_swarm.protocol.messages import Truth
from tests import builders
from tests.builders import mission_message, row

S = 1_000_000_000
EPOCH_NS = 100 * S
SENDER = (7, 1)
GUIDED, LOITER, LAND = 4, 5, 9


def mission(**fields: Any) -> Mission:
    """Return a mission of one UAV that an autopilot flies, from the origin to the east."""
    vehicle = {"model": "mavlink", "autopilot": "udpin:127.0.0.1:{14550+10*i}", **fields.pop("vehicle", {})}
    roster = [{"uav": "a", "start_x_m": 0.0, "start_y_m": 0.0, "target_x_m": 50.0, "target_y_m": 0.0}]
    return complete_mission(mission_from_dict({"roster": roster, "vehicle": vehicle, **fields}))


class Told:
    """A vehicle that stays where it is, and tells what a test lets it."""

    state = None
    next_measured_m = (0.0, 0.0)
    standing = Flown((0.0, 0.0), (0.0, 0.0), None, (0.0, 0.0), 0.0, past=[])

    def __init__(self) -> None:
        self.past: list[PastFlight] = []

    def fly(self, slot: int, from_m: Any, to_m: Any) -> Flown:
        """Return what is to be told."""
        del slot, from_m
        return Flown(to_m, to_m, None, to_m, 0.0, past=self.past)

    def brake(self, slot: int, from_m: Any, to_m: Any) -> None:
        """Do nothing."""

    def disturb(self, fault: Any) -> None:
        """Do nothing."""


class Copter:
    """The messages of an obedient ArduCopter, which a test bends."""

    def __init__(self, pilot: Pilot, plan: Mission) -> None:
        self.pilot, self.plan = pilot, plan
        self.at_m = (0.0, 0.0)
        self.beat: dict[str, Any] = {"type": 2, "autopilot": 3, "base_mode": 1, "custom_mode": 0}
        self.height_mm, self.fix_type, self.battery = 0, 4, 87
        self.sent: list[tuple[str, dict[str, Any]]] = []
        self.arms = True
        self.parameters = {"GUID_TIMEOUT": 0.5, "FS_GCS_ENABLE": 5, "FS_GCS_TIMEOUT": 5, "SYSID_MYGCS": 255}

    def say(self, now_ns: int) -> None:
        """Send everything that a ground station hears."""
        lat_deg, lon_deg = to_wgs84(*self.at_m, self.plan.origin_lat_deg, self.plan.origin_lon_deg)
        lat, lon = round(lat_deg * 1e7), round(lon_deg * 1e7)
        for name, fields in (
            ("HEARTBEAT", self.beat),
            ("GLOBAL_POSITION_INT", {"lat": lat, "lon": lon, "relative_alt": self.height_mm}),
            ("GPS_RAW_INT", {"fix_type": self.fix_type}),
            ("BATTERY_STATUS", {"id": 0, "battery_remaining": self.battery}),
            ("HOME_POSITION", {"latitude": lat, "longitude": lon, "altitude": 12_000}),
        ):
            self.pilot.telemetry.hear(name, fields, SENDER, now_ns)

    def obey(self, now_ns: int) -> None:
        """Do at once what the pilot sends."""
        for name, fields in self.pilot.advance(now_ns):
            self.sent.append((name, dict(fields)))
            match name, fields.get("command"):
                case "param_request_read", _ if (name := fields["param_id"].decode()) in self.parameters:
                    told = {"param_id": name, "param_value": self.parameters[name], "param_type": 9}
                    self.pilot.telemetry.hear("PARAM_VALUE", told, SENDER, now_ns)
                case "command_long", 176:
                    self.beat["custom_mode"] = int(fields["param2"]) << (16 if self.beat["autopilot"] == 12 else 0)
                case "set_position_target_global_int", _ if (
                    self.beat["autopilot"] == 12 and self.beat["base_mode"] == 129
                ):
                    self.height_mm = round(1000 * fields["alt"])
                case "command_long", 400 if self.arms:
                    self.beat["base_mode"] = 129
                case "command_long", 22:
                    self.height_mm = round(1000 * fields["param7"])
                case "command_long", 21:
                    self.beat["custom_mode"] = LAND

    def run(self, from_s: float, to_s: float) -> None:
        """Let time pass."""
        for tick in range(round(from_s * 20), round(to_s * 20)):
            self.say(tick * S // 20)
            self.obey(tick * S // 20)

    def commands(self) -> list[int]:
        """Return the commands that steer, in the order of their first time."""
        steering = [f["command"] for n, f in self.sent if n == "command_long" and f["command"] not in {511, 512}]
        return list(dict.fromkeys(steering))


def copter(*, arm: bool = True, **fields: Any) -> Copter:
    """Return an autopilot and its pilot."""
    plan = mission(**fields)
    return Copter(Pilot(plan, plan.roster[0], EPOCH_NS, arm=arm), plan)


def kinds(flown: Copter) -> list[str]:
    """Return the kinds of the news."""
    return [said.kind for said in flown.pilot.take_news()]


def test_it_arms_and_climbs_before_slot_0_and_lands_at_the_end() -> None:
    """Mode, arming, take-off, in this order; set-points only in flight; then the landing, until the motors are off."""
    flown = copter()
    flown.run(80, 100)
    assert flown.commands() == [176, 400, 22]
    assert flown.pilot.stage is Stage.FLYING
    assert flown.sent[0][0] == "heartbeat"
    points = [index for index, (name, _) in enumerate(flown.sent) if name.startswith("set_position")]
    assert points
    assert points[0] > [f.get("command") for _, f in flown.sent].index(22)
    flown.pilot.land(100 * S)
    flown.run(100, 102)
    assert flown.commands() == [176, 400, 22, 21]
    flown.beat["base_mode"] = 1
    flown.run(102, 103)
    assert flown.pilot.stage is Stage.DONE


FAILSAFES: list[tuple[dict[str, float], str, str]] = [
    ({}, "stops after 0.5 s, without its process it lands after 5 s", ""),
    ({"GUID_TIMEOUT": 3}, "stops after 3 s", "flies on for 3 s with its last velocity: set GUID_TIMEOUT to the length"),
    ({"FS_GCS_ENABLE": 0}, "without its process it hovers", "takes it for landed: set FS_GCS_ENABLE to 5"),
    ({"FS_GCS_ENABLE": 1}, "returns home after 5 s", "returns home across the others' ways"),
    ({"FS_GCS_ENABLE": 9}, "does what FS_GCS_ENABLE 9 says", "does what FS_GCS_ENABLE 9 says: set FS_GCS_ENABLE to 5"),
    ({"FS_GCS_TIMEOUT": 30}, "lands after 30 s", "set FS_GCS_TIMEOUT to at most 10"),
    ({"SYSID_MYGCS": 252}, "lands after 5 s", "watches the ground station 252, not its process"),
]


@pytest.mark.parametrize(("values", "does", "wrong"), FAILSAFES)
def test_what_arducopter_does_by_itself_is_told_before_it_is_armed(
    values: dict[str, float], does: str, wrong: str
) -> None:
    """Its parameters are read; the event before the arming says what they mean, a second one what is wrong with it."""
    flown = copter()
    flown.parameters |= values
    flown.run(80, 100)
    checked, *others = [said.text for said in flown.pilot.take_news()]
    assert does in checked
    warned = [text for text in others if text.startswith("warning: ")]
    assert len(warned) == bool(wrong)
    assert wrong in "".join(warned)
    assert flown.pilot.stage is Stage.FLYING


@pytest.mark.parametrize(
    ("action", "timeout_s", "does", "wrong"),
    [
        (4, 0.5, "without set-points it lands after 0.5 s", ""),
        (5, 0.5, "it hovers", 'set COM_OBL_RC_ACT to 4 (land), or failsafe = "hold"'),
        (3, 0.5, "it returns home", "across the others' ways"),
        (0, 0.5, "it goes to Position (COM_OBL_RC_ACT 0)", "set COM_OBL_RC_ACT to 4"),
        (4, 1.0, "lands after 1 s", "flies on for 1 s"),
    ],
)
def test_what_px4_does_by_itself_is_told(action: int, timeout_s: float, does: str, wrong: str) -> None:
    """PX4 puts the bytes of an integer into the field of a float: 4 would else be read as 0."""
    flown = copter()
    flown.beat |= {"autopilot": 12}
    (as_float,) = struct.unpack("<f", struct.pack("<i", action))
    flown.pilot.telemetry.hear("HEARTBEAT", flown.beat, SENDER, 80 * S)
    for name, value, kind in (("COM_OBL_RC_ACT", as_float, 6), ("COM_OF_LOSS_T", timeout_s, 9)):
        told = {"param_id": name, "param_value": value, "param_type": kind}
        flown.pilot.telemetry.hear("PARAM_VALUE", told, SENDER, 80 * S)
    said, warned = flown.pilot.failsafe
    assert does in said
    assert len(warned) == bool(wrong)
    assert wrong in "".join(warned)


def test_an_autopilot_that_tells_no_failsafe_flies_with_a_warning() -> None:
    """It is asked three times for each parameter, and then no more; a mission that holds counts on no landing."""
    flown = copter()
    flown.parameters.clear()
    flown.run(80, 100)
    asked = [fields["param_id"] for name, fields in flown.sent if name == "param_request_read"]
    assert (len(asked), len(set(asked))) == (15, 5)
    warned = [said.text for said in flown.pilot.take_news() if said.text.startswith("warning: ")]
    assert warned == [
        "warning: it does not tell GUID_TIMEOUT, FS_GCS_ENABLE, FS_GCS_TIMEOUT, SYSID_MYGCS: "
        "what it does without its process is unknown"
    ]
    assert flown.pilot.stage is Stage.FLYING
    holds = copter(failsafe="hold")
    holds.parameters |= {"FS_GCS_ENABLE": 0}
    holds.run(80, 100)
    assert not [said.text for said in holds.pilot.take_news() if said.text.startswith("warning: ")]


def test_an_arming_that_is_broken_off_is_taken_back() -> None:
    """Ctrl-C between the command to arm and the heartbeat that shows it: motors that start are stopped."""
    flown = copter()
    flown.arms = False
    flown.run(80, 90)
    assert flown.pilot.stage is Stage.ARMING
    flown.pilot.land(90 * S)
    flown.sent.clear()
    flown.run(90, 91)
    assert [fields["param1"] for _, fields in flown.sent if fields.get("command") == 400] == [0.0]
    assert flown.pilot.stage is Stage.LANDING
    flown.run(91, 92)
    assert flown.pilot.stage is Stage.DONE
    assert [said.text for said in flown.pilot.take_news()][-1] == "was not armed"


def test_two_counts_of_messages_are_two_autopilots() -> None:
    """A link that loses a third of all messages is one sender; two senders or a doubled one are not."""
    for counts, two in (
        ([count for count in range(600) if count % 3], False),
        ([count for pair in zip(range(600), range(40, 640), strict=True) for count in pair], True),
        ([count for count in range(600) for _ in range(2)], True),
    ):
        flown = copter()
        for count in counts:
            flown.pilot.telemetry.hear("HEARTBEAT", flown.beat, SENDER, 80 * S, number=count % 256)
        found = [text for text in flown.pilot.objections(80 * S) if "two autopilots" in text]
        assert bool(found) == two


def test_px4_gets_set_points_before_its_mode_and_climbs_by_them() -> None:
    """OFFBOARD is refused without a stream of set-points; their height is the take-off."""
    flown = copter()
    flown.beat |= {"autopilot": 12}
    flown.run(80, 100)
    assert flown.commands() == [176, 400]
    names = [name if name != "command_long" else f["command"] for name, f in flown.sent]
    assert names.index("set_position_target_global_int") < names.index(176)
    assert flown.pilot.stage is Stage.FLYING
    assert flown.pilot.telemetry.mode == "OFFBOARD"
    points = [fields for name, fields in flown.sent if name == "set_position_target_global_int"]
    assert {(fields["coordinate_frame"], fields["alt"]) for fields in points} == {(5, 12.0 + 5.0)}, "above the sea"


def test_without_permission_nothing_but_requests_is_sent() -> None:
    """No mode, no arming, no set-point: telemetry is asked for, and heartbeats go out."""
    flown = copter(arm=False)
    flown.run(80, 103)
    assert flown.commands() == []
    assert {name for name, _ in flown.sent} == {"heartbeat", "command_long", "param_request_read"}


@pytest.mark.parametrize(
    ("bend", "why"),
    [
        ({"fix_type": 1}, "no 3D fix"),
        ({"battery": 12}, "its battery has 12 %"),
        ({"battery": -1}, "nothing of its battery"),
        ({"at_m": (30.0, 0.0)}, "30.0 m from its start"),
        ({"beat": {"type": 1, "autopilot": 3, "base_mode": 1, "custom_mode": 0}}, "no multicopter"),
        ({"beat": {"type": 2, "autopilot": 18, "base_mode": 1, "custom_mode": 0}}, "neither ArduPilot nor PX4"),
        ({"beat": {"type": 2, "autopilot": 3, "base_mode": 129, "custom_mode": 4}}, "armed already"),
    ],
)
def test_what_is_not_ready_is_not_armed(bend: dict[str, Any], why: str) -> None:
    """Each check keeps the vehicle on the ground, and says why at the beginning of slot 0."""
    flown = copter()
    for name, value in bend.items():
        setattr(flown, name, value)
    flown.run(80, 100.1)
    assert flown.commands() == []
    (said,) = flown.pilot.take_news()
    assert said.kind == "grounded"
    assert why in said.text


def test_a_second_autopilot_at_the_address_is_not_armed() -> None:
    """Another system that sends heartbeats as an autopilot: nobody knows which one would obey."""
    flown = copter()
    flown.say(80 * S)
    flown.pilot.telemetry.hear("HEARTBEAT", flown.beat, (8, 1), 80 * S)
    flown.run(80.1, 90)
    assert "systems [7, 8]" in flown.pilot.objections(90 * S)[0]
    assert flown.commands() == []


def test_one_that_refuses_to_arm_stays_on_the_ground() -> None:
    """The arming is asked for again and again until slot 0 begins, and then never again."""
    flown = copter()
    flown.arms = False
    flown.pilot.telemetry.hear("HEARTBEAT", flown.beat, SENDER, 80 * S)
    flown.pilot.telemetry.hear("STATUSTEXT", {"text": "PreArm: Compass not calibrated"}, SENDER, 80 * S)
    flown.run(80, 103)
    grounded = [said.text for said in flown.pilot.take_news() if said.kind == "grounded"]
    assert grounded == ["it does not arm (no answer): PreArm: Compass not calibrated"]
    assert 22 not in flown.commands()


@pytest.mark.parametrize("fault", ["mode", "silence", "gps", "disarmed", "path"])
def test_what_does_not_follow_strays_and_is_sent_nothing_more(fault: str) -> None:
    """A pilot takes over; no message; no GPS; motors off; another way: one event, and heartbeats alone from then on."""
    flown = copter()
    flown.run(80, 100)
    flown.pilot.step = Step(EPOCH_NS, (0.0, 0.0), (0.0, 0.0), (2.0, 0.0))
    flown.run(100, 100.4)
    assert "strayed" not in kinds(flown)
    flown.sent.clear()
    match fault:
        case "mode":
            flown.beat["custom_mode"] = LOITER
        case "gps":
            flown.fix_type = 1
        case "disarmed":
            flown.beat["base_mode"] = 1
        case "path":
            flown.at_m = (0.0, 6.0)
    for tick in range(2008, 2060):
        if fault != "silence":
            flown.say(tick * S // 20)
        flown.pilot.step = Step(EPOCH_NS + (tick - 2000) // 10 * S // 2, (0.0, 0.0), (0.0, 0.0), (0.0, 0.0))
        flown.obey(tick * S // 20)
    assert kinds(flown).count("strayed") == 1
    after = [name for name, _ in flown.sent[-3:]]
    assert set(after) <= {"heartbeat"} or fault == "silence"
    assert flown.pilot.stage in {Stage.STRAYING, Stage.DONE}


@pytest.mark.parametrize("moment", ["climb", "landing"])
def test_a_pilot_is_never_fought(moment: str) -> None:
    """Who changes the mode in the climb or in the landing has the vehicle: no command is sent any more."""
    flown = copter()
    flown.run(80, 100 if moment == "landing" else 80.05)
    if moment == "climb":
        while flown.pilot.stage is not Stage.CLIMBING:
            flown.run(81, 81.05)
    else:
        flown.pilot.land(100 * S)
        flown.run(100, 101)
    flown.beat["custom_mode"] = LOITER
    flown.sent.clear()
    flown.run(82 if moment == "climb" else 101, 105)
    assert flown.commands() == []
    assert flown.pilot.stage in {Stage.STRAYING, Stage.DONE}


def test_one_that_falls_silent_in_its_landing_is_told_as_such() -> None:
    """Nobody knows its mode: the event says for how long it has said nothing."""
    flown = copter()
    flown.run(80, 100)
    flown.pilot.land(100 * S)
    flown.pilot.take_news()
    for second in range(100, 130):
        flown.obey(second * S)
    (said,) = flown.pilot.take_news()
    assert said.text.startswith("has not landed in time: it has said nothing for ")
    assert flown.pilot.stage is Stage.DONE


def test_an_old_report_is_not_held_against_a_new_step() -> None:
    """A second without a report, in which the path went on by 8 m: nobody knows yet where the vehicle is."""
    flown = copter()
    flown.run(80, 100)
    flown.pilot.step = Step(EPOCH_NS + S // 2, (6.0, 0.0), (10.0, 0.0), (12.0, 0.0))
    flown.obey(EPOCH_NS + S)
    assert "strayed" not in kinds(flown)


def test_set_points_end_when_steps_end() -> None:
    """One slot after the end of the newest step nothing is sent any more, though the link lives."""
    flown = copter()
    flown.run(80, 100)
    flown.pilot.step = Step(EPOCH_NS, (0.0, 0.0), (0.0, 0.0), (0.0, 0.0))
    flown.sent.clear()
    flown.run(100, 103)
    points = [name for name, _ in flown.sent if name.startswith("set_position")]
    assert len(points) == pytest.approx(20, abs=2)
    assert flown.pilot.stage is Stage.FLYING


def test_a_set_point_is_the_place_on_the_declared_path() -> None:
    """In the middle of a slot that accelerates from rest to 2 m: an eighth of 2 m on, at half of 4 m/s, at 8 m/s²."""
    plan = mission()
    step = Step(EPOCH_NS, (0.0, 0.0), (0.0, 0.0), (0.0, 2.0))
    fields = set_point(plan, 5.0, step, EPOCH_NS + S // 4)
    east_m, north_m = from_wgs84(
        fields["lat_int"] / 1e7, fields["lon_int"] / 1e7, plan.origin_lat_deg, plan.origin_lon_deg
    )
    assert (east_m, north_m) == pytest.approx((0.0, 0.25), abs=0.02)
    assert (fields["vx"], fields["vy"], fields["afx"], fields["afy"]) == pytest.approx((2.0, 0.0, 8.0, 0.0))
    assert (fields["coordinate_frame"], fields["type_mask"], fields["alt"]) == (6, 3072, 5.0)


@pytest.mark.parametrize("origin_deg", [(60.1841, 24.8301), (-89.0, 179.9999), (0.0, -179.99999)])
def test_set_points_are_on_the_exact_path_everywhere(origin_deg: tuple[float, float]) -> None:
    """Near a pole and across the date line, on a step of 12 m: at most the rounding of MAVLink, 1e-7 degrees."""
    plan = mission(origin_lat_deg=origin_deg[0], origin_lon_deg=origin_deg[1])
    step = Step(EPOCH_NS, (-8.0, 3.0), (0.0, 0.0), (12.0, 5.0))
    for part in range(11):
        fields = set_point(plan, 5.0, step, EPOCH_NS + part * S // 20)
        assert abs(fields["lon_int"]) <= 1_800_000_000
        place_m = from_wgs84(fields["lat_int"] / 1e7, fields["lon_int"] / 1e7, *origin_deg)
        exact = step.place(part / 10)[0]
        assert place_m == pytest.approx((exact.real, exact.imag), abs=0.012)


SLOT_NS = S // 2


def flies_east(flown: Copter, slots: int, *, silent: range = range(0)) -> list[PastFlight]:
    """Fly 1 m east a slot, with a position 30 ms after every twentieth of a second, and return the slots told of.

    Each slot is begun at its very start, before the report that follows it.
    """
    flown.run(80, 100)
    body = AutopilotBody(flown.plan, EPOCH_NS, flown.plan.roster[0], flown.pilot, (0.0, 0.0))
    told: list[PastFlight] = []
    for slot in range(slots):
        done = body.fly(slot, (float(slot), 0.0), (slot + 1.0, 0.0))
        assert done.past is not None
        told += done.past
        for part in range(10 if slot not in silent else 0):
            when_ns = slot * SLOT_NS + part * S // 20 + 30_000_000
            flown.at_m = (when_ns / SLOT_NS, 0.0)
            flown.say(EPOCH_NS + when_ns)
    assert flown.pilot.step == Step(
        EPOCH_NS + (slots - 1) * SLOT_NS, (slots - 2.0, 0.0), (slots - 1.0, 0.0), (float(slots), 0.0)
    )
    return told


def test_every_slot_is_told_although_its_last_report_comes_after_the_next_one_has_begun() -> None:
    """Punctual ticks and reports of another phase: the paths join without a gap, and only two slots are still unknown.

    A defect of old told a slot only if a report had come between its end and the next tick: mostly never.
    """
    told = flies_east(copter(), 12)
    assert [past.slot for past in told] == list(range(10))
    assert [past.waypoint_m for past in told] == [(slot + 1.0, 0.0) for slot in range(10)]
    for past in told[1:]:
        assert [x_m for x_m, _ in past.path_m] == pytest.approx(
            np.linspace(past.slot, past.slot + 1, len(past.path_m)), abs=0.01
        )
    assert all(a.path_m[-1] == b.path_m[0] for a, b in pairwise(told))


def test_a_slot_with_too_few_reports_is_never_told() -> None:
    """A second without a position in slots 4 and 5: unknown, as are the ends of the slots beside them; nothing else."""
    told = flies_east(copter(), 12, silent=range(4, 6))
    assert [past.slot for past in told] == [0, 1, 2, 7, 8, 9]


def test_reported_slots_become_truths_without_an_energy_that_nobody_reported() -> None:
    """Each slot told of is a truth of its own slot, with the waypoint at its end; the present slot is none."""
    body = Told()
    plan = mission_message(row(("a", "b"), gap_m=40.0, north_m=90.0, energy_j=1e4), gps_model="none")
    node = builders.node(plan, "a", first_promise(plan.roster[0]), body=body)
    body.past = [PastFlight(slot, [(0.0, slot + part / 4) for part in range(5)], (0.0, slot + 1.0)) for slot in (1, 2)]
    effects = node.step(Tick(), builders.at(4))
    truths = [effect.message for effect in effects if isinstance(effect, Publish) and isinstance(effect.message, Truth)]
    assert [(truth.slot, truth.from_y_m, truth.to_y_m, truth.waypoint_y_m) for truth in truths] == [
        (1, 1.0, 2.0, 2.0),
        (2, 2.0, 3.0, 3.0),
    ]
    assert [truth.between_y_m for truth in truths] == [[1.25, 1.5, 1.75], [2.25, 2.5, 2.75]]
    assert {truth.propulsion_j for truth in truths} == {UNSET}


def test_a_stray_grows_by_what_its_vehicle_can_fly() -> None:
    """Two seconds after its last report at 10 m/s: 20 m; a report resets it; on the ground once its motors are off."""
    flown = copter()
    flown.run(80, 100)
    body = AutopilotBody(flown.plan, EPOCH_NS, flown.plan.roster[0], flown.pilot, (0.0, 0.0))
    body.fly(0, (0.0, 0.0), (0.0, 0.0))
    flown.beat["custom_mode"] = LOITER
    flown.run(100, 100.1)
    heard_s = 100.05
    free_mps = vehicle_of(flown.plan, flown.plan.roster[0]).free_mps
    told = body.fly(3, (0.0, 0.0), (0.0, 0.0))
    assert told.stray_m == pytest.approx(free_mps * (100 + 4 * 0.5 - heard_s))
    assert not told.on_ground
    flown.beat["base_mode"] = 1
    flown.run(102, 102.1)
    assert body.fly(5, (0.0, 0.0), (0.0, 0.0)).on_ground


def test_addresses_are_counted_from_the_pattern() -> None:
    """The place of a UAV in the roster is i, from 0 on."""
    assert address("udpin:0.0.0.0:{14550+10*i}", 3) == "udpin:0.0.0.0:14580"
    assert address("tcp:10.0.0.{1+i}:5760", 2) == "tcp:10.0.0.3:5760"
    assert address("/dev/ttyUSB{i},57600", 1) == "/dev/ttyUSB1,57600"
    assert autopilots(mission()) == {"a": "udpin:127.0.0.1:14550"}


@pytest.mark.parametrize(
    ("fields", "field"),
    [
        ({"vehicle": {"autopilot": ""}}, "vehicle.autopilot"),
        ({"vehicle": {"autopilot": "udpin:127.0.0.1:{14550-i}"}}, "vehicle.autopilot"),
        ({"vehicle": {"autopilot": "udpin:127.0.0.1:99999"}}, "vehicle.autopilot"),
        ({"vehicle": {"altitude_m": 50.0}}, "landing_s"),
        ({"time_scale": 2.0}, "time_scale"),
        ({"fault": ["gps a white @3"]}, "fault"),
    ],
)
def test_missions_that_no_autopilot_can_fly_are_refused(fields: dict[str, Any], field: str) -> None:
    """One line with the field: no address, a bad one, too high to land in time, not in real time, an emulated fault."""
    with pytest.raises(MissionError) as refused:
        mission(**fields)
    assert refused.value.field == field


def test_two_uavs_at_one_address_are_refused() -> None:
    """A pattern without i would let two UAVs command one vehicle."""
    roster = [
        {"uav": uav, "start_x_m": x_m, "start_y_m": 0.0, "target_x_m": x_m, "target_y_m": 50.0}
        for uav, x_m in (("a", 0.0), ("b", 40.0))
    ]
    vehicle = {"model": "mavlink", "autopilot": "udpin:127.0.0.1:14550"}
    with pytest.raises(MissionError, match="another address for each UAV"):
        complete_mission(mission_from_dict({"roster": roster, "vehicle": vehicle}))


def test_one_that_returns_has_its_start_as_its_last_point() -> None:
    """The planner brings it back, so returning UAVs are kept apart."""
    entry = mission(vehicle={"at_end": "return"}).roster[0]
    assert entry.points == [(50.0, 0.0), (0.0, 0.0)]
    assert math.isclose(entry.straight_m, 100.0)
