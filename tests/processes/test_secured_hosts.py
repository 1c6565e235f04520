"""A secured mission on several hosts: each has only the certificates of the UAVs that it may fly."""

from __future__ import annotations

import shutil
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from edc_swarm.mission.roles import JOIN
from processes.bus.address import free_endpoint
from processes.bus.credentials import Credentials
from processes.host.certificates import write_certificates
from tests.processes.conftest import Fly, Started
from tests.processes.test_join import FAST, claimed

UAVS = [f"u00{number}" for number in range(1, 6)]
Host = Callable[..., str]


@pytest.fixture
def certs(tmp_path: Path) -> Path:
    """Make the certificates of five UAVs and all roles."""
    write_certificates(tmp_path / "certs", UAVS)
    return tmp_path / "certs"


@pytest.fixture
def host(certs: Path, tmp_path: Path) -> Host:
    """Make the folder of another host: the files of a joiner, and the certificates of its UAVs."""

    def make(*uavs: str) -> str:
        folder = tmp_path / "-".join(("host", *uavs))
        folder.mkdir()
        for name in (JOIN, *uavs):
            shutil.copy(certs / f"{name}.pem", folder)
            shutil.copy(certs / f"{name}.key", folder)
        shutil.copy(certs / "ca.pem", folder)
        return str(folder)

    return make


@pytest.fixture
def hosted(start: Fly, certs: Path) -> tuple[Started, str]:
    """Start a secured run that leaves three UAVs to joiners; return it and its router's address."""
    address = free_endpoint("tls")
    arguments = ("--secure", "--certs", str(certs), "--listen", address, "--remote", "3")
    return start("run", *FAST, *arguments), address


def test_each_host_flies_what_it_has_certificates_of(start: Fly, hosted: tuple[Started, str], host: Host) -> None:
    """In any order of claims, an id goes only to a claimant with its certificate."""
    run, address = hosted
    folders = {"2": host("u003", "u005"), "1": host("u001", "u004")}
    joined = [start("join", address, "--uavs", uavs, "--certs", folder) for uavs, folder in folders.items()]
    ended = run.end()
    assert ended.status == 0, ended.stderr
    mission = ended.recording.mission
    holders = dict(zip(UAVS, mission.claimants, strict=True))
    assert holders["u001"] == holders["u002"] == ""
    assert holders["u003"] == holders["u005"] != holders["u004"]
    assert {fix.uav for fix in ended.recording.fixes} == set(UAVS)
    assert [command.end().status for command in joined] == [0, 0]


def test_what_a_host_cannot_fly_is_issued_to_nobody(start: Fly, hosted: tuple[Started, str], host: Host) -> None:
    """A claimant without a certificate of a free id gets one line; one that names no certificates gets no id."""
    run, address = hosted
    folder = host("u001", "u004")
    greedy = start("join", address, "--uavs", "2", "--certs", folder).end()
    assert greedy.status == 2
    assert "--uavs = 2: must be at most 1" in greedy.stderr
    assert claimed(address, 1, Credentials(Path(folder), JOIN)) == set()
    run.process.send_signal(signal.SIGINT)
    assert run.end().status == 1
