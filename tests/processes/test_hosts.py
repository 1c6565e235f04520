"""Several hosts: a network namespace each, with links that are really cut."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from edc_swarm.analysis.head_terms import heads_of
from edc_swarm.errors import RecordingError
from edc_swarm.mission.roles import JOIN
from edc_swarm.mission.roster import uav_ids
from edc_swarm.recording.reader import read_recording
from edc_swarm.recording.sequences import find_gaps
from processes.bus.credentials import HOST
from processes.cli.main import main
from processes.host.certificates import write_certificates
from tests.processes.conftest import Fly, Started

pytestmark = pytest.mark.timing

HOME, NEAR, FAR = (f"edc{os.getpid()}-{name}" for name in ("home", "near", "far"))
PORT = 7447
SETTLED = 12
"""Slots after the cut until the others have a head again, whichever UAV was cut off: a lease and an election."""


def ip(*words: str) -> None:
    """Run `ip`."""
    subprocess.run(["ip", *words], check=True, capture_output=True)


@pytest.fixture
def hosts() -> Iterator[dict[str, str]]:
    """Make three hosts, two of them linked to the first; yield the router's address for each of them."""
    if os.geteuid() != 0 or shutil.which("ip") is None:
        pytest.skip("network namespaces need root and the tool ip (package iproute2)")
    try:
        for name in (HOME, NEAR, FAR):
            ip("netns", "add", name)
            ip("-n", name, "link", "set", "lo", "up")
        yield {name: link(name, f"10.77.{number}") for number, name in enumerate((NEAR, FAR))}
    except subprocess.CalledProcessError as error:
        pytest.skip(f"no network namespaces here: {error.stderr.decode().strip()}")
    finally:
        for name in (HOME, NEAR, FAR):
            subprocess.run(["ip", "netns", "del", name], check=False, capture_output=True)


def link(name: str, net: str) -> str:
    """Link a host with the first one; return the router's address on that link."""
    ip("-n", HOME, "link", "add", end_of(name), "type", "veth", "peer", "name", "eth0", "netns", name)
    for host, device, address in ((HOME, end_of(name), f"{net}.1/24"), (name, "eth0", f"{net}.2/24")):
        ip("-n", host, "addr", "add", address, "dev", device)
        ip("-n", host, "link", "set", device, "up")
    return f"{net}.1:{PORT}"


def end_of(name: str) -> str:
    """Return the first host's end of the link to another host."""
    return f"to-{name.rpartition('-')[2]}"


def on(name: str) -> tuple[str, ...]:
    """Return the words that start a command on a host."""
    return ("ip", "netns", "exec", name)


def newest_slot(run: Started) -> int:
    """Return the newest slot that the recorder has flushed."""
    try:
        recording = read_recording(run.path.with_name(run.path.name + ".part"), salvage=True)
    except RecordingError:
        return -1
    return max((fix.slot for fix in recording.fixes), default=-1)


@pytest.mark.parametrize("secured", [False, True], ids=["open", "secured"])
def test_a_cut_link_between_hosts(hosts: dict[str, str], start: Fly, tmp_path: Path, secured: bool) -> None:
    """The far host's UAVs hold during the cut, the others fly on; finally all arrive and all is recorded."""
    protocol, certs = ("tls", ("--certs", str(tmp_path / "certs"))) if secured else ("tcp", ())
    if secured:
        write_certificates(tmp_path / "certs", uav_ids(9), hosts=[address.split(":")[0] for address in hosts.values()])
    # The cut may last longer than a vehicle waits before it lands.
    options = (
        "--uavs",
        "9",
        "--time-scale",
        "2",
        "--failsafe",
        "hold",
        "--remote",
        "6",
        "--listen",
        f"{protocol}/0.0.0.0:{PORT}",
    )
    run = start("run", "--json", *options, *(("--secure",) if secured else ()), *certs, prefix=on(HOME))
    joined = [
        start("join", f"{protocol}/{address}", "--uavs", "3", *certs, prefix=on(name))
        for name, address in hosts.items()
    ]
    run.await_file(lambda: newest_slot(run) >= 6)
    cut = newest_slot(run)
    ip("-n", HOME, "link", "set", end_of(FAR), "down")
    run.await_file(lambda: newest_slot(run) >= cut + SETTLED + 6)
    ip("-n", HOME, "link", "set", end_of(FAR), "up")
    ended = run.end()
    assert [command.end().status for command in joined] == [0, 0]

    assert ended.json["arrived"] == 9, ended.stdout
    assert [verdict for verdict in ended.json["guarantees"] if verdict["status"] == "broken"] == []
    assert ended.json["fetched"] > 0
    recording = ended.recording
    hosts_of = dict(zip((entry.uav for entry in recording.mission.roster), recording.mission.claimants, strict=True))
    slots = range(cut + SETTLED, cut + SETTLED + 6)
    led = {report.slot: report for report in recording.reports if report.slot in slots and report.has_quorum}
    assert led.keys() == set(slots)
    (far,) = {hosts_of[uav] for report in led.values() for uav in report.unheard}
    cut_off = {uav for uav, host in hosts_of.items() if host == far}
    assert all(set(report.unheard) == cut_off for report in led.values())
    held = [fix for fix in recording.fixes if fix.uav in cut_off and fix.slot in slots]
    assert len(held) >= len(cut_off) == 3
    assert not any(fix.executing for fix in held)


CLUSTERS = Path(__file__).parents[2] / "scenarios" / "crossing_clusters.toml"


def certificates(folder: Path, address: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Make the certificates of both hosts; return the options of `run`, and of `join` with those of its host alone."""
    home, near, uavs = folder / "certs", folder / "near", [f"b{number}" for number in range(1, 5)]
    router, joined = address.partition(":")[0], f"near={','.join(uavs)}"
    assert main(["certs", str(CLUSTERS), "--host", router, "--joined", joined, "-o", str(home)]) == 0
    near.mkdir()
    for path in (home / "ca.pem", *(path for name in (JOIN, f"{HOST}near", *uavs) for path in home.glob(f"{name}.*"))):
        shutil.copy(path, near)
    return ("--secure", "--certs", str(home)), ("--certs", str(near))


@pytest.mark.long
@pytest.mark.parametrize("secured", [False, True], ids=["open", "secured"])
def test_a_cluster_on_each_host_with_a_router_each(
    hosts: dict[str, str], start: Fly, tmp_path: Path, capsys: pytest.CaptureFixture[str], secured: bool
) -> None:
    """Cluster b flies on another host with a router and a recorder of its own; the link is cut, and comes back.

    During the cut its head leads on, since its cluster needs nobody else. The recordings of both hosts are one. With
    certificates that host has those of its own UAVs alone.
    """
    near, kept, whole = hosts[NEAR], tmp_path / "near.mcap", tmp_path / "all.mcap"
    protocol = "tls" if secured else "tcp"
    secure, certs = certificates(tmp_path, near) if secured else ((), ())
    run = start(
        *("run", str(CLUSTERS), "--json", "--no-viz", "--remote", "4", "--listen", f"{protocol}/0.0.0.0:{PORT}"),
        *secure,
        prefix=on(HOME),
    )
    joined = start(
        *("join", f"{protocol}/{near}", "--uavs", "4", "--cluster", "b", "--router", "--record", str(kept)),
        *certs,
        prefix=on(NEAR),
    )
    run.await_file(lambda: newest_slot(run) >= 6)
    cut = newest_slot(run)
    ip("-n", HOME, "link", "set", end_of(NEAR), "down")
    run.await_file(lambda: newest_slot(run) >= cut + SETTLED)
    ip("-n", HOME, "link", "set", end_of(NEAR), "up")
    ended, left = run.end(), joined.end()
    assert (ended.json["arrived"], left.status) == (8, 0), ended.stderr + left.stderr

    own = read_recording(kept)
    assert {fix.uav for fix in own.fixes} == {command.uav for command in own.commands} == {"b1", "b2", "b3", "b4"}
    assert main(["merge", str(run.path), str(kept), "-o", str(whole)]) == 0
    assert main(["check", str(whole)]) == 0, capsys.readouterr().out
    merged = read_recording(whole)
    assert not find_gaps(merged)
    (term,) = heads_of(merged)["b"]
    slots = range(cut + 4, cut + SETTLED)
    led = {report.slot for report in merged.reports if report.head == term.head and report.has_quorum}
    assert set(slots) <= led
