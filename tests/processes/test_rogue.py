"""Rogue processes on a secured bus during a mission: their possible and impossible actions."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import zenoh

from edc_swarm.analysis.guarantees.check import check
from edc_swarm.mission.roles import JOIN, OPERATOR
from edc_swarm.protocol.keys import Keys
from edc_swarm.protocol.messages import Command, Fix, MissionMessage, Truth
from edc_swarm.recording.model import Recording
from edc_swarm.recording.reader import read_recording
from processes.bus.address import free_endpoint
from processes.bus.credentials import Credentials
from processes.bus.session import hand_over, open_client
from tests.processes.conftest import start_command
from tests.processes.rogue import INSTANCE, TERM

ROGUE = "u002"
POSE = """
import pathlib, sys
from processes.bus.session import open_router
from processes.bus.credentials import Credentials
session = open_router(sys.argv[1], Credentials(pathlib.Path(sys.argv[2]), sys.argv[3]))
print("ready", flush=True)
sys.stdin.read()
"""
"""Program of a router with the certificate of another name, which runs until its standard input ends."""


@dataclass
class Flight:
    """A secured mission of five, and the printed reports of its rogues."""

    recording: Recording
    strangers: dict[str, dict[str, Any]]
    insider: dict[str, Any]
    joiner: dict[str, Any]
    tokens: set[str]

    def of_rogue(self) -> list[Any]:
        """Return every recorded message of the insiders."""
        return [m for messages in self.recording.lists().values() for m in messages if m.instance == INSTANCE]


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Flight]:
    """Fly one mission for all tests: four strangers, a UAV and a joiner attack it at the same time."""
    folder = tmp_path_factory.mktemp("secured")
    certs, endpoint = _certs(folder / "certs"), free_endpoint("tls")
    flown = start_command(
        *("run", "--json", "--secure", "--certs", str(certs), "--listen", endpoint),
        *("--uavs", "5", "--seed", "3", "--time-scale", "1.5", "--speed-max", "2.5"),
        path=folder / "run.mcap",
    )
    try:
        flown.await_flight(5)
        recorded = folder / "heard"
        shutil.copy(folder / "run.mcap.part", recorded)
        strangers = {
            "another authority": (endpoint, _certs(folder / "other")),
            "its certificate, ours believed": (endpoint, _with_our_authority(folder, certs)),
            "no certificate": (endpoint, _bare(folder, certs)),
            "no encryption": (endpoint.replace("tls/", "tcp/"), certs),
        }
        started = {name: _rogue(*where, recorded) for name, where in strangers.items()}
        with _tokens_seen(endpoint, certs, recorded) as tokens:
            insiders = [_rogue(endpoint, certs, recorded, name) for name in (ROGUE, JOIN)]
            insider, joiner = (json.loads(process.communicate()[0]) for process in insiders)
        said = {name: json.loads(process.communicate()[0]) for name, process in started.items()}
        yield Flight(flown.end().recording, said, insider, joiner, tokens)
    finally:
        for pid in flown.pids():
            os.kill(pid, 9)


def test_who_has_no_certificate_of_this_swarm_is_not_connected(flight: Flight) -> None:
    """The router rejects a missing certificate, another authority's, a false one of ours, and plain TCP."""
    assert {name: said["connected"] for name, said in flight.strangers.items()} == dict.fromkeys(
        flight.strangers, False
    )
    assert flight.insider["connected"]


def test_the_router_refuses_to_speak_for_others(flight: Flight) -> None:
    """The router rejects messages under the keys of another UAV, another head, the operator, or many at once."""
    assert {_speaker(message) for message in flight.of_rogue()} == {ROGUE}
    assert flight.recording.garbage == []
    assert all(topic.startswith("/viz/") for topic in flight.recording.unknown)
    assert [event.detail for event in flight.recording.events if event.kind == "end"] == ["completed"]


def test_commands_without_a_quorum_are_not_flown_and_no_term_moves(flight: Flight) -> None:
    """The rogue publishes commands under its own id; the check of the recording accuses it alone."""
    recording = flight.recording
    commands = [message for message in flight.of_rogue() if isinstance(message, Command)]
    assert {command.term for command in commands} > {TERM}
    assert {command.uav for command in commands} == {entry.uav for entry in recording.mission.roster}
    assert max(fix.term for fix in recording.fixes) < TERM
    assert ROGUE not in {fix.head for fix in recording.fixes}
    broken = [result.guarantee for result in check(recording) if result.broken]
    assert broken == ["G1"]
    assert _arrived(recording)
    assert any(event.kind == "malformed" and "without a quorum" in event.detail for event in recording.events)


def test_subscribing_to_what_is_for_others_hears_nothing(flight: Flight) -> None:
    """The rogue hears all fixes and the mission: no command to others, no truth and no retransmission."""
    heard = flight.insider["heard"]
    assert heard.pop("uav/fix") > 5
    assert heard.pop(f"reply swarm/{flight.recording.mission.name}/mission") == 1
    assert heard == {}


def test_a_joiner_cannot_fly_what_it_has_no_certificate_of(flight: Flight) -> None:
    """A joiner may claim and hear the operator; it can publish nothing as a UAV, a head or the operator."""
    assert flight.joiner["connected"]
    assert flight.joiner["heard"] == {"claim answered": 1}


def test_nobody_is_there_in_the_name_of_others(flight: Flight) -> None:
    """A UAV is no joiner and claims nothing; a joiner is no UAV."""
    assert {token.split("/", 2)[2] for token in flight.tokens if INSTANCE in token} == {
        f"alive/{JOIN}/{INSTANCE}-{JOIN}"
    }
    assert "claim answered" not in flight.insider["heard"]


def _arrived(recording: Recording) -> bool:
    last: dict[str, Fix] = {fix.uav: fix for fix in recording.fixes}
    return all(fix.arrived for fix in last.values())


def _speaker(message: Any) -> str:
    """Return the owner of a message's key."""
    assert not isinstance(message, MissionMessage)
    return str(message.uav if isinstance(message, Fix | Truth) else getattr(message, "head", "") or message.source)


def _certs(folder: Path) -> Path:
    """Make certificates for five UAVs with the command."""
    command = [sys.executable, "-m", "processes.cli.main", "certs", "--uavs", "5", "--out", str(folder)]
    subprocess.run(command, check=True, capture_output=True)
    return folder


def _with_our_authority(folder: Path, certs: Path) -> Path:
    mixed = _certs(folder / "mixed")
    shutil.copy(certs / "ca.pem", mixed / "ca.pem")
    return mixed


def _bare(folder: Path, certs: Path) -> Path:
    (folder / "bare").mkdir()
    shutil.copy(certs / "ca.pem", folder / "bare" / "ca.pem")
    return folder / "bare"


@contextmanager
def _tokens_seen(endpoint: str, certs: Path, recorded: Path) -> Iterator[set[str]]:
    """Return all liveliness tokens that appear meanwhile, as the operator sees them."""
    seen = set[str]()
    keys = Keys(read_recording(recorded, salvage=True).mission.name)
    with open_client(endpoint, Credentials(certs, OPERATOR)) as session:

        def take(sample: zenoh.Sample) -> None:
            seen.add(str(sample.key_expr))

        session.liveliness().declare_subscriber(keys.all_alive, hand_over(take))
        yield seen


def _rogue(endpoint: str, folder: Path, recorded: Path, name: str = ROGUE) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "tests.processes.rogue", endpoint, str(folder), name, str(recorded)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def test_no_uav_can_pose_as_the_router(tmp_path: Path) -> None:
    """Its certificate is for a client and for no host: no invited client connects."""
    certs = _certs(tmp_path / "certs")
    for name, comes in (("u001", False), ("router", True)):
        endpoint = free_endpoint("tls")
        command = [sys.executable, "-c", POSE, endpoint, str(certs), name]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as router:
            assert router.stdout is not None
            router.stdout.readline()
            assert _comes(endpoint, Credentials(certs, "u002")) is comes
            router.communicate("")


def _comes(endpoint: str, credentials: Credentials) -> bool:
    try:
        open_client(endpoint, credentials, timeout_ms=1500).close()
    except zenoh.ZError:
        return False
    return True
