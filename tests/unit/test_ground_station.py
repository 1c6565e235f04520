"""The swarm as MAVLink systems: what a ground station is told, and what it is denied."""

from __future__ import annotations

import socket
from typing import Any

import pytest

from edc_swarm.errors import InputError
from edc_swarm.ground_station.frames import Frame, Request
from edc_swarm.ground_station.vehicle import FLIGHT_HEIGHT_M, HEARTBEAT_NS
from edc_swarm.ground_station.view import GroundView
from edc_swarm.mission.routes import Course
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.messages import Event
from processes.services.mavlink_link import MavlinkLink, ground_address
from tests import builders

SLOT_NS = 500_000_000
ROSTER = [
    builders.entry("a", (0.0, 0.0), (0.0, 100.0), energy_j=1000.0),
    builders.entry("b", (50.0, 0.0), route=[(50.0, 40.0), (90.0, 40.0)], hover_s=[3.0, 0.0], accept_m=2.0),
]


@pytest.fixture
def view() -> GroundView:
    """Return the view of a mission of two UAVs."""
    view = GroundView()
    view.hear(builders.mission_message(ROSTER), 0)
    return view


def asks(name: str, system: int = 1, **fields: Any) -> Request:
    """Return a request of the ground station 245."""
    return Request(245, 190, system, name, fields)


def named(frames: list[Frame], name: str) -> list[Frame]:
    """Return the frames with a name."""
    return [frame for frame in frames if frame.name == name]


def test_position_and_velocity_are_those_of_the_fix(view: GroundView) -> None:
    """A step of 2 m to the north-east in a slot of 0.5 s without guard is 4 m/s on course 45."""
    fix = builders.fix(
        "a", 4, (2**0.5, 2**0.5), from_x_m=0.0, from_y_m=0.0, executing=True, lat_deg=60.5, lon_deg=24.25, r_m=2.0
    )
    frames = view.hear(fix, 4 * SLOT_NS)
    (position,), (gps,) = named(frames, "global_position_int"), named(frames, "gps_raw_int")
    assert position.system == 1
    wanted = {"lat": 605_000_000, "lon": 242_500_000, "time_boot_ms": 2000, "vx": 283, "vy": 283, "hdg": 4500}
    assert {name: position.fields[name] for name in wanted} == wanted
    assert position.fields["relative_alt"] == FLIGHT_HEIGHT_M * 1000
    assert (gps.fields["h_acc"], gps.fields["vel"]) == (2000, 400)
    assert view.hear(builders.fix("a", 3), 5 * SLOT_NS) == []


def test_a_uav_that_is_not_heard_has_no_heartbeat(view: GroundView) -> None:
    """Heartbeats come once a second while fixes come, and end two slots after the last one."""
    view.hear(builders.fix("a", 0), 0)
    assert [frame.system for frame in named(view.advance(0), "heartbeat")] == [1]
    assert view.advance(HEARTBEAT_NS - 1) == []
    assert len(named(view.advance(HEARTBEAT_NS), "heartbeat")) == 1
    assert view.advance(4 * SLOT_NS) == []
    view.hear(builders.fix("a", 9), 9 * SLOT_NS)
    assert len(named(view.advance(9 * SLOT_NS), "heartbeat")) == 1


def test_the_battery_is_the_fixs_charge(view: GroundView) -> None:
    """Percent are those of the charge at the start, rounded down; energy is in hectojoules."""
    view.hear(builders.fix("a", 0, energy_j=499.0), 0)
    (battery,) = named(view.advance(0), "battery_status")
    assert (battery.fields["battery_remaining"], battery.fields["energy_consumed"]) == (49, 5)


def test_a_landed_uav_is_disarmed_on_the_ground(view: GroundView) -> None:
    """The event `landed` says so; before it, the UAV is armed in the air."""
    view.hear(builders.fix("a", 0), 0)
    flying = {frame.name: frame.fields for frame in view.advance(0)}
    texts = view.hear(Event(source="a", kind=EventKind.LANDED, detail="no accepted step since slot 3"), 1)
    landed = {frame.name: frame.fields for frame in view.advance(HEARTBEAT_NS)}
    armed = [bool(int(fields["heartbeat"]["base_mode"]) & 128) for fields in (flying, landed)]  # type: ignore[arg-type]
    assert armed == [True, False]
    assert [fields["extended_sys_state"]["landed_state"] for fields in (flying, landed)] == [2, 1]
    assert b"".join(frame.fields["text"] for frame in texts) == b"a landed no accepted step since slot 3"  # type: ignore[misc]


def test_the_mission_is_the_route(view: GroundView) -> None:
    """Points of the route with hover and acceptance; a new goal takes its place; out of range is refused."""
    (count,) = view.answer(asks("mission_request_list", 2, mission_type=0))
    assert (count.name, count.fields["count"], count.fields["target_system"]) == ("mission_count", 2, 245)
    (item,) = view.answer(asks("mission_request_int", 2, seq=0, mission_type=0))
    assert (item.fields["param1"], item.fields["param2"], item.fields["command"]) == (3.0, 2.0, 16)
    (over,) = view.answer(asks("mission_request_int", 2, seq=2, mission_type=0))
    assert (over.name, over.fields["type"]) == ("mission_ack", 13)
    view.hear(builders.fix("b", 5, course=Course(goal=1, route=[(1.0, 2.0)])), 5 * SLOT_NS)
    (count,) = view.answer(asks("mission_request_list", 2, mission_type=0))
    assert count.fields["count"] == 1


@pytest.mark.parametrize(
    ("request_", "answer"),
    [
        (asks("command_long", command=400, param1=1.0), "command_ack"),
        (asks("command_int", command=192), "command_ack"),
        (asks("mission_count", count=3), "mission_ack"),
        (asks("mission_clear_all"), "mission_ack"),
        (asks("set_mode", base_mode=1), "statustext"),
        (asks("set_position_target_local_ned"), "statustext"),
        (asks("manual_control"), "statustext"),
    ],
)
def test_what_would_steer_is_denied_and_counted(view: GroundView, request_: Request, answer: str) -> None:
    """The ground station hears so, and the caller can report it."""
    frames = view.answer(request_)
    assert frames[0].name == answer
    assert "statustext" in {frame.name for frame in frames}
    assert view.denied.total() == 1
    if answer == "command_ack":
        assert frames[0].fields["result"] == 2


def test_a_request_to_all_is_answered_by_each_and_one_to_a_stranger_by_nobody(view: GroundView) -> None:
    """System 0 is every UAV; the numbers of the UAVs are 1 and 2."""
    request = asks("command_long", 0, command=512, param1=242.0)
    assert [frame.system for frame in named(view.answer(request), "home_position")] == [1, 2]
    assert view.answer(asks("command_long", 3, command=400)) == []
    assert view.denied.total() == 0
    assert dict(view.ignored) == {"for a system that is no UAV": 1}


def test_kinds_of_denied_requests_are_bounded(view: GroundView) -> None:
    """A flood of different commands is counted in bounded memory."""
    for command in range(1000, 3000):
        view.answer(asks("command_long", command=command))
    assert view.denied.total() == 2000
    assert len(view.denied) <= 101


@pytest.mark.parametrize("text", ["udp:127.0.0.1", "tcp:127.0.0.1:14550", "udp:127.0.0.1:0", "udp:127.0.0.1:70000", ""])
def test_bad_addresses_are_refused(text: str) -> None:
    """One line, with the form that is allowed."""
    with pytest.raises(InputError, match="udp:HOST:PORT"):
        ground_address(text)


def test_more_uavs_than_systems_are_refused() -> None:
    """MAVLink numbers systems from 1 to 255."""
    with pytest.raises(InputError, match="at most 250"):
        GroundView().hear(builders.mission_message(builders.row(map(str, range(251)), 1.0, 5.0)), 0)


def test_hostile_datagrams_are_counted_and_dropped() -> None:
    """Garbage, a torn message and a stranger's message are no requests; each is counted."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ground:
        ground.bind(("127.0.0.1", 0))
        link = MavlinkLink("127.0.0.1", ground.getsockname()[1])
        mav = link._dialect.MAVLink(None, 245, 190)
        good = link._dialect.MAVLink_command_long_message(1, 1, 400, 0, *[0.0] * 7).pack(mav)
        assert [request.name for request in link.requests(good)] == ["command_long"]
        broken = good[:-1] + bytes([good[-1] ^ 1])
        for payload in (b"", b"\x00" * 60_000, good[:-3], broken, b"\xfd" * 500):
            assert link.requests(payload) == []
        assert link.dropped["not MAVLink"] > 0
        assert len(link.requests(good * 500)) == 200
        assert link.dropped["too many in one datagram"] == 300
        assert sum(link._has_room(7) for _ in range(5000)) == 1000
        assert link.dropped["too many in one second"] == 4000
        assert link._has_room(8)
        link.close()
