"""`docker compose up`, for real: a container for every UAV, containers killed, cut off and started again."""

from __future__ import annotations

import subprocess
from collections.abc import Callable

import pytest

from edc_swarm.analysis.guarantees.check import check
from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.recording.sequences import unknown_tails
from processes.bus.address import free_endpoint
from tests.docker.conftest import USER, Swarm, logs, said

pytestmark = pytest.mark.timing

Make = Callable[..., Swarm]
FAST = {"TIME_SCALE": "2"}


def broken(swarm: Swarm) -> set[str]:
    """Guarantees that the recording shows broken."""
    return {result.guarantee for result in check(swarm.recording) if result.broken}


@pytest.mark.parametrize("uavs", [10, 40])
def test_compose_up(swarm: Make, uavs: int) -> None:
    """The mission's status, its summary, a recording that belongs to the user, and everything stops."""
    flown = swarm(UAVS=str(uavs))
    up = flown.compose("up", "--exit-code-from", "operator", check=False)
    assert up.returncode == 0, up.stdout[-3000:]
    assert f"{uavs} of {uavs}" in up.stdout
    assert "G3 Separation: held" in up.stdout
    assert flown.containers(running=True) == []
    (path,) = flown.folder.iterdir()
    assert (path.stat().st_uid, path.suffix) == (flown.folder.stat().st_uid, ".mcap")
    metrics = compute_metrics(flown.recording)
    assert (metrics.arrived, metrics.potential_collisions, metrics.true_collisions) == (uavs, 0, 0)
    assert len({fix.instance[-16:] for fix in flown.recording.fixes}) == uavs
    assert broken(flown) == set()


def test_everything_stops_without_being_told(swarm: Make) -> None:
    """Also where nobody asked compose for the operator's status."""
    flown = swarm(UAVS="4", **FAST)
    flown.compose("up", "--detach")
    assert flown.await_end() == 0


@pytest.mark.parametrize("arguments", [("--exit-code-from", "operator"), ()], ids=["status", "plain"])
def test_a_bad_option_ends_everything(swarm: Make, arguments: tuple[str, ...]) -> None:
    """Its one line is seen, and nobody waits for an operator that will not come."""
    flown = swarm(UAVS="3", PLANNER="nonsense")
    up = flown.compose("up", *arguments, check=False)
    assert "error: --planner = 'nonsense': must be" in up.stdout
    assert flown.await_end() == 2
    assert up.returncode == (2 if arguments else 0)
    assert list(flown.folder.iterdir()) == []


def test_latency_experiments(swarm: Make) -> None:
    """Tables, plots and page, where recordings go, and as their owner."""
    grid = "--delays 0,300 --jitters 0 --losses 0 --slots 0.5 --uavs 3 --repeats 1 --max-slots 60 --hold-slots 10"
    flown = swarm(OPTIONS=grid)
    flown.compose("build", "latency")
    said_by = flown.compose("run", "--rm", "latency")
    assert "2 runs: 0 overlaps of discs" in said_by.stdout
    assert "atplotlib" not in said_by.stdout + said_by.stderr
    files = {path.name: path.stat().st_uid for path in (flown.folder / "latency").iterdir()}
    assert {"index.html", "cells.csv", "held_pct-by-delay.svg"} <= files.keys()
    assert set(files.values()) == {flown.folder.stat().st_uid}
    assert len((flown.folder / "latency" / "cells.csv").read_text().splitlines()) == 3


def test_the_heads_container_is_killed(swarm: Make) -> None:
    """The others finish the mission without it; it is not home, which the status says."""
    flown = swarm(**FAST)
    flown.compose("up", "--detach")
    head = flown.await_slot(6).reports[-1].head
    said("docker", "kill", flown.container_of(head))
    assert flown.await_end() == 1
    metrics = compute_metrics(flown.recording)
    assert metrics.not_living == [who.uav for who in metrics.not_home] == [head]
    assert (metrics.arrived, metrics.potential_collisions) == (9, 0)
    assert broken(flown) == set()


def test_a_container_is_cut_off_and_connected_again(swarm: Make) -> None:
    """Its UAV holds meanwhile, and arrives in the end; what was on the wire is fetched again and recorded.

    It comes back with another address, since another container has taken its own: its connections are lost for good.
    """
    flown = swarm(UAVS="4", AREA="90000", OPTIONS="--failsafe hold")  # Finding out takes Zenoh its lease, 4 s.
    flown.compose("up", "--detach")
    cut = flown.await_slot(6)
    head = cut.reports[-1].head
    container, network = flown.container_of(head), f"{flown.name}_default"
    said("docker", "network", "disconnect", network, container)
    other = said("docker", "run", "--detach", "--network", network, "--entrypoint", "sleep", "edc-swarm", "600").strip()
    try:
        flown.await_slot(cut.fixes[-1].slot + 10)
        said("docker", "network", "connect", network, container)
    finally:
        said("docker", "rm", "--force", other)
    flown.await_end()
    metrics = compute_metrics(flown.recording)
    assert (metrics.arrived, metrics.gaps) == (4, 0)
    assert metrics.fetched is not None
    assert metrics.fetched > 0
    assert broken(flown) == set()
    assert len({report.head for report in flown.recording.reports if report.has_quorum}) > 1


def test_a_container_started_again_flies_the_same_uav(swarm: Make) -> None:
    """Its promise is in the container's file system."""
    flown = swarm(**FAST)
    flown.compose("up", "--detach")
    flown.await_slot(4)
    container = flown.container_of("u003")
    said("docker", "kill", container)
    said("docker", "start", container)
    assert flown.await_end() == 0
    assert logs(container).count("flies u003 of mission") == 2
    assert len({fix.instance for fix in flown.recording.fixes if fix.uav == "u003"}) == 2
    assert compute_metrics(flown.recording).arrived == 10


def test_faults_reach_containers(swarm: Make) -> None:
    """The operator's faults are carried out by whoever flies the UAV."""
    flown = swarm(UAVS="6", OPTIONS="--fault 'kill head @8' --fault 'freeze u002 @8 for 2s'", **FAST)
    up = flown.compose("up", "--exit-code-from", "operator", check=False)
    assert up.returncode == 1, up.stdout[-3000:]
    metrics = compute_metrics(flown.recording)
    assert len(metrics.not_living) == 1
    assert [who.cause for who in metrics.not_home] == ["killed"]


def test_secured(swarm: Make) -> None:
    """With certificates made beforehand in a volume; whoever is on the network without one is not let in."""
    flown = swarm(UAVS="5", **FAST)
    flown.secure()
    flown.compose("up", "--detach")
    flown.await_slot(2)
    assert _gets_in(flown, "tls/router:7447", "Credentials(Path('certs'), 'join')")
    assert not _gets_in(flown, "tls/router:7447", "None")
    assert not _gets_in(flown, "tcp/router:7447", "None")
    assert flown.await_end() == 0
    assert compute_metrics(flown.recording).arrived == 5
    assert broken(flown) == set()


def test_each_service_has_its_own_key_alone(swarm: Make) -> None:
    """Its volume holds nothing else; all UAVs share theirs, the router knows them by their certificates."""
    flown = swarm(UAVS="2")
    flown.secure()
    flown.secure()
    own = {name: {f"{name}.key", f"{name}.pem"} for name in ("operator", "recorder", "router", "viz")}
    uavs = {"u001.pem", "u002.pem"}
    expected = {
        "operator": own["operator"],
        "recorder": own["recorder"],
        "router": own["router"] | uavs,
        "visualiser": own["viz"],
        "uavs": uavs | {"u001.key", "u002.key", "join.key", "join.pem"},
    }
    for volume, names in expected.items():
        options = ["--rm", "--network", "none", "--volume", f"{flown.name}_certs-{volume}:/certs:ro"]
        found = said("docker", "run", *options, "--entrypoint", "ls", "edc-swarm", "/certs")
        assert set(found.split()) == names | {"ca.pem"}


def _gets_in(flown: Swarm, endpoint: str, credentials: str) -> bool:
    """Whether another container on the swarm's network can connect to its router."""
    script = (
        "from pathlib import Path; from processes.bus.session import open_client;"
        "from processes.bus.credentials import Credentials;"
        f"open_client('{endpoint}', {credentials}, timeout_ms=3000).close()"
    )
    options = ["--rm", "--network", f"{flown.name}_default", "--volume", f"{flown.name}_certs-uavs:/swarm/certs:ro"]
    command = ["docker", "run", *options, "--entrypoint", "python", "edc-swarm", "-c", script]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


def test_stopped_by_hand(swarm: Make) -> None:
    """All services are told at once, as by Ctrl-C; what was flown is recorded, and none has to be killed."""
    flown = swarm(UAVS="4")
    flown.compose("up", "--detach")
    slot = flown.await_slot(4).fixes[-1].slot
    flown.compose("stop")
    assert max(fix.slot for fix in flown.recording.fixes) >= slot
    assert broken(flown) == set()
    assert unknown_tails(flown.recording) == []
    statuses = said("docker", "inspect", "--format", "{{.State.ExitCode}}", *flown.containers()).split()
    assert set(statuses) <= {"0", "1"}


@pytest.mark.parametrize("secured", [False, True], ids=["open", "secured"])
def test_watched_live(swarm: Make, secured: bool) -> None:
    """The profile adds a service that viewers connect to, and changes nothing else."""
    from tests.processes.test_live import connected, first_scene  # noqa: PLC0415  (skips where its client is missing)

    port = free_endpoint().rpartition(":")[2]
    flown = swarm(UAVS="4", LIVE_PORT=port)
    if secured:
        flown.secure()
    flown.compose("--profile", "live", "up", "--detach")
    flown.await_slot(0)
    viewer, channels = connected(int(port))
    assert len(first_scene(viewer, channels["/viz/uavs"]).entities) == 4
    viewer.close()
    assert flown.await_end() == 0
    assert broken(flown) == set()


def test_the_image(image: str) -> None:
    """Not root, no wheels left, and the guidance is compiled: no compiler is there."""

    def run(script: str, *options: str) -> str:
        return said("docker", "run", "--rm", "--network", "none", "--entrypoint", "sh", *options, image, "-c", script)

    assert run("id -u").strip() == str(USER)
    assert run("find /opt /home /root /tmp /var /swarm -name '*.whl' 2>/dev/null || true") == ""
    planned = (
        "from edc_swarm.mission.configuration import Mission;"
        "from edc_swarm.planner.compiler import is_ready;"
        "from processes.uav.planner_loader import warm_planner; warm_planner(Mission());"
        "import importlib.util; print(is_ready(), importlib.util.find_spec('numba'))"
    )
    assert run(f'python -c "{planned}"', "--user", "4711:4711").split() == ["True", "None"]
    waited_for = run('python -c "from processes.host.pool import THE_PLANNER; print(THE_PLANNER)"')
    assert waited_for == "the planner\n"  # Not that a first run compiles it.
