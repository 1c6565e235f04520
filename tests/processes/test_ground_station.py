"""The swarm in a ground station of others: MAVSDK finds the UAVs and reads what the record says."""

from __future__ import annotations

import json
import math
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from edc_swarm.protocol.events import EventKind
from edc_swarm.recording.model import Recording
from tests.processes.conftest import Fly

pytest.importorskip("mavsdk")
SUCCESS = "1"
"""Result of a command in MAVSDK; a command that is denied raises an exception there."""
CLIENT = Path(__file__).with_name("mavsdk_client.py")


class Ground:
    """MAVSDK in a process of its own, listening on a free port."""

    def __init__(self, systems: int, seconds: float, *more: str) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = probe.getsockname()[1]
        command = [sys.executable, str(CLIENT), str(self.port), str(systems), str(seconds), *more]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        assert self.process.stderr is not None
        while "ready" not in (line := self.process.stderr.readline()):
            assert line, "the client ended before it listened"

    def seen(self) -> dict[str, Any]:
        """Return what the client saw, by the end of its time."""
        stdout, stderr = self.process.communicate(timeout=120)
        assert self.process.returncode == 0, stderr
        found: dict[str, Any] = json.loads(stdout.strip().splitlines()[-1])
        return found


@pytest.fixture
def grounds() -> Iterator[list[Ground]]:
    """Return a list for clients; those that are left at the end are killed."""
    started: list[Ground] = []
    yield started
    for ground in started:
        ground.process.kill()
        ground.process.wait()


def check_against(recording: Recording, seen: dict[str, Any]) -> None:
    """Compare what the client saw of each UAV with the recording: every position, every charge, the mission."""
    for number, entry in enumerate(recording.mission.roster, 1):
        about = seen["systems"][str(number)]
        fixes = [fix for fix in recording.fixes if fix.uav == entry.uav]
        places = {(round(fix.lat_deg * 1e7), round(fix.lon_deg * 1e7)) for fix in fixes}
        told = {(round(lat_deg * 1e7), round(lon_deg * 1e7)) for lat_deg, lon_deg in about["positions"]}
        assert told, f"no position of {entry.uav}"
        assert told <= places
        charges = {int(100 * fix.energy_j / entry.energy_j) for fix in fixes}
        assert about["battery"], f"no battery of {entry.uav}"
        assert set(about["battery"]) <= charges
        assert [item[0] for item in about["mission"]] == [16] * len(entry.points)
        assert len(about["fence"]) == sum(zone.corners for zone in recording.mission.zone)


def checked(path: Path) -> str:
    """Return what `edc-swarm check` says of a recording."""
    command = [sys.executable, "-m", "processes.cli.main", "check", str(path)]
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout


def test_a_replay_shows_what_the_recording_says(start: Fly, grounds: list[Ground]) -> None:
    """Four UAVs, one of them killed; arming, taking off and landing are denied."""
    flown = start("sim", "--uavs", "4", "--seed", "3", "--fault", "kill u002 @8").end()
    grounds.append(Ground(4, 2.0, "arm"))
    shown = start("replay", str(flown.path), "--mavlink", f"udp:127.0.0.1:{grounds[0].port}", "--speed", "2", "--json")
    seen = grounds[0].seen()
    check_against(flown.recording, seen)
    assert sorted(seen["tried"]) == ["arm", "land", "takeoff"]
    assert all("DENIED" in answer for answer in seen["tried"].values())
    assert json.loads(shown.process.communicate(timeout=60)[0])["denied"] == {
        "command 21": 1,
        "command 22": 1,
        "command 400": 1,
    }


def test_a_run_of_ten_is_found_and_commands_have_no_effect(start: Fly, grounds: list[Ground]) -> None:
    """Real processes: the client finds all UAVs in flight; what it tries is in the record, and nobody obeys."""
    grounds.append(Ground(10, 2.0, "arm"))
    flight = start(
        "run", "--uavs", "10", "--time-scale", "2", "--mavlink", f"udp:127.0.0.1:{grounds[0].port}", "--json"
    )
    seen, flown = grounds[0].seen(), flight.end()
    assert flown.status == 0, flown.stderr
    check_against(flown.recording, seen)
    denied = [event for event in flown.recording.events if event.kind == EventKind.GROUND_DENIED]
    assert denied[-1].detail == "command 21: 1, command 22: 1, command 400: 1"
    assert flown.json["completed"] is True
    assert "G5 No loss in the record: held" in checked(flown.path)


def test_commands_go_through_the_operator(start: Fly, grounds: list[Ground]) -> None:
    """With permission, MAVSDK pauses a UAV, lets it go on, gives another one a goal and lands a third: all is told."""
    grounds.append(Ground(4, 1.0, "steer"))
    address = f"udp:127.0.0.1:{grounds[0].port}"
    far = ("--uavs", "4", "--seed", "3", "--speed-max", "2", "--mavlink", address)
    flight = start("run", *far, "--mavlink-commands", "--json")
    seen, flown = grounds[0].seen(), flight.end()
    assert seen["tried"] == dict.fromkeys(["pause", "start", "goto", "land"], SUCCESS)
    recording = flown.recording
    orders = [json.loads(event.detail) for event in recording.events if event.kind == EventKind.GROUND_COMMAND]
    assert [(order["uav"], order["wish"]) for order in orders] == [
        ("u001", "pause"),
        ("u001", "go on"),
        ("u002", "goal"),
        ("u003", "land"),
    ]
    done = [event.detail.split()[:2] for event in recording.events if event.kind == EventKind.FAULT]
    assert done == [["goal", "u001"], ["goal", "u001"], ["goal", "u002"], ["land", "u003"]]
    landed = [event.source for event in recording.events if event.kind == EventKind.LANDED]
    assert landed == ["u003"]
    last = {fix.uav: fix for fix in recording.fixes}
    entry = recording.mission.roster[0]
    assert last["u001"].arrived
    assert last["u001"].course.route[-1] == (entry.target_x_m, entry.target_y_m)
    assert math.dist((last["u002"].waypoint_x_m, last["u002"].waypoint_y_m), last["u002"].course.route[-1]) < 0.2
    verdicts = checked(flown.path)
    assert [line for line in verdicts.splitlines() if "broken" in line] == []


def test_a_bridge_that_dies_ends_no_mission(start: Fly) -> None:
    """The mission goes on without its bridge, and the record says that it ended."""
    flight = start("run", "--uavs", "3", "--time-scale", "4", "--mavlink", "udp:127.0.0.1:9", "--json")
    flight.await_flight(3)
    (bridge,) = flight.pids("processes.services.ground_station")
    subprocess.run(["kill", "-9", str(bridge)], check=True)
    flown = flight.end()
    exits = [event.detail for event in flown.recording.events if event.kind == EventKind.EXITED]
    assert exits
    assert exits[0].startswith("ground")
    assert flown.json["completed"] is True
