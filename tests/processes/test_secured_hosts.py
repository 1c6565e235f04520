"""A secured mission on several hosts: each has only the certificates of the UAVs that it may fly, and its own."""

from __future__ import annotations

import shutil
import signal
from collections.abc import Callable
from pathlib import Path

import pytest
import zenoh

from edc_swarm.errors import InputError
from edc_swarm.mission.roles import JOIN
from edc_swarm.protocol.keys import Keys
from edc_swarm.recording.reader import read_recording
from processes.bus.address import free_endpoint
from processes.bus.credentials import HOST, Credentials, certified_hosts
from processes.bus.operator_presence import OperatorPresence
from processes.bus.session import hand_over, open_router, put
from processes.cli.main import main
from processes.host.certificates import write_certificates
from processes.services.access_rules import access_control
from processes.services.orders import await_found
from tests.processes.conftest import Fly, Started
from tests.processes.test_join import FAST, claimed

UAVS = [f"u00{number}" for number in range(1, 6)]
Host = Callable[..., str]
BETA = f"{HOST}beta"


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


@pytest.mark.long
def test_a_host_with_a_router_and_a_recorder_of_its_own(
    start: Fly, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its router speaks for its own UAVs alone, and hears no truth of others; both recordings make a whole one.

    A second router with its certificate lies about UAVs: the mission's router lets through what is about its own.
    """
    certs, folder, kept, whole = (tmp_path / name for name in ("certs", "beta", "beta.mcap", "all.mcap"))
    write_certificates(certs, UAVS, joined={"beta": UAVS[2:]})
    folder.mkdir()
    for path in (path for name in (JOIN, BETA, *UAVS[2:]) for path in certs.glob(f"{name}.*")):
        shutil.copy(path, folder)
    shutil.copy(certs / "ca.pem", folder)
    address = free_endpoint("tls")
    run = start("run", *FAST, "--secure", "--certs", str(certs), "--listen", address, "--remote", "3")
    options = ("--uavs", "3", "--router", "--certs", str(folder), "--record", str(kept))
    joined = start("join", address, *options)
    with open_router(free_endpoint("tls"), Credentials(folder, BETA), link=address) as rogue:
        presence, heard = OperatorPresence(rogue), set[str]()

        def note(sample: zenoh.Sample) -> None:
            heard.add(str(sample.key_expr))

        keys = Keys(await_found(lambda: presence.only_mission(address), "the mission"))
        for key in (keys.fix("u001"), keys.truth("u001"), keys.commands_to("u001"), keys.commands_to("u003")):
            rogue.declare_subscriber(key, hand_over(note))
        run.await_file(lambda: keys.fix("u001") in heard and any(key.endswith("/command/u003") for key in heard))
        for uav in ("u001", "u003"):
            put(rogue, keys.fix(uav), b"a lie about " + uav.encode())
        ended, left = run.end(), joined.end()
    assert (ended.json["arrived"], left.status) == (5, 0), ended.stderr + left.stderr
    assert {key for key in heard if "u001" in key and "/head/" not in key} == {keys.fix("u001")}
    assert not [key for key in heard if key.endswith("/command/u001")]
    assert {found.topic for found in ended.recording.garbage} == {keys.fix("u003")}

    own = read_recording(kept)
    assert {fix.uav for fix in own.fixes} == {truth.uav for truth in own.truths} == set(UAVS[2:])
    assert main(["merge", str(run.path), str(kept), "-o", str(whole)]) == 0
    assert main(["check", str(whole)]) == 0, capsys.readouterr().out


def test_who_may_have_a_router_of_its_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A host without its own certificate, and a wrong list of UAVs, get one line."""
    write_certificates(tmp_path / "certs", UAVS)
    certs = ("--certs", str(tmp_path / "certs"))
    for arguments, field in (
        (("join", "tls/localhost:1", *certs, "--router"), "--certs"),
        (("join", "tls/localhost:1", *certs, "--record", str(tmp_path / "a.mcap")), "--certs"),
        (("certs", "--uavs", "2", "-o", str(tmp_path / "other"), "--joined", "beta=u001,u003"), "--joined"),
        (("certs", "--uavs", "2", "-o", str(tmp_path / "other"), "--joined", "be.ta=u001"), "--joined"),
        (("certs", "--uavs", "2", "-o", str(tmp_path / "other"), "--joined", "beta"), "--joined"),
    ):
        assert main([*arguments]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith(f"error: {field} = ")
    (tmp_path / "certs" / f"{BETA}.json").write_text('["**"]')
    with pytest.raises(InputError, match=r"host\.beta\.json lists UAVs"):
        certified_hosts(tmp_path / "certs")


def test_the_rules_of_a_host_name_its_uavs_alone() -> None:
    """The mission's router takes from another one what that one's UAVs may say, and gives it no truth of others."""
    access = access_control("m", UAVS, {BETA: UAVS[2:]})
    rules = {rule["id"]: rule for rule in access["rules"]}
    own = [rule for name, rule in rules.items() if name.startswith(f"{BETA} ")]
    assert not [key for rule in own for key in rule["key_exprs"] if "u001" in key or "u002" in key]
    for uav in UAVS[2:]:
        assert set(rules[f"{uav} says"]["key_exprs"]) <= set(rules[f"{BETA} says"]["key_exprs"])
    wide = {key for key in rules[f"{BETA} hears"]["key_exprs"] if not any(uav in key for uav in UAVS)}
    assert wide == {
        f"swarm/m/{key}" for key in ("mission", "event/operator", "event/recorder", "uav/*/fix", "head/*/report")
    }
    assert not [key for key in rules[f"{BETA} says"]["key_exprs"] if "recorder" in key or "operator" in key]
    assert {subject["id"] for subject in access["subjects"]} > {BETA, *UAVS}
