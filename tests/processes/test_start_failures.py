"""Deaths of processes while a run starts: the run ends with status 1, and one line that names the process."""

from __future__ import annotations

import os
import re
import signal

import pytest

from tests.processes.conftest import Fly, Started
from tests.processes.failing import FAILING

PLANNER = "tests.processes.failing:Failing"
UAVS = 10


def start_with(start: Fly, failing: str = "") -> Started:
    """Start a run whose UAVs never connect; those of `failing` raise an exception."""
    return start("run", "--uavs", str(UAVS), "--planner", PLANNER, "--no-viz", prefix=("env", f"{FAILING}={failing}"))


def errors_of(command: Started) -> list[str]:
    """Return the lines of standard error of a run that fails at its start; no process and no recording is left."""
    ended = command.end()
    assert ended.status == 1, ended.stderr
    assert ended.stdout == ""
    assert "Traceback" not in ended.stderr
    assert not list(ended.path.parent.glob("*.mcap*"))
    return [line for line in ended.stderr.splitlines() if not line.startswith("waiting for")]


@pytest.mark.long
def test_all_uavs_die_at_the_start(start: Fly) -> None:
    """The run names the first UAV that it sees dead, with its exit status and the last line that it wrote."""
    failing = ",".join(f"u{number:03d}" for number in range(1, UAVS + 1))
    (line,) = errors_of(start_with(start, failing))
    found = re.fullmatch(
        r"error: the UAV process (u\d{3}) ended with status 1: RuntimeError: planted in (u\d{3})", line
    )
    assert found is not None, line
    assert found[1] == found[2]


@pytest.mark.long
def test_one_of_ten_uavs_dies_at_the_start(start: Fly) -> None:
    """A mission without one of its UAVs does not begin."""
    (line,) = errors_of(start_with(start, "u004"))
    assert line == "error: the UAV process u004 ended with status 1: RuntimeError: planted in u004"


@pytest.mark.long
@pytest.mark.parametrize("part", ["uav", "recorder", "router", "fork-source"])
def test_a_process_is_killed_at_the_start(start: Fly, part: str) -> None:
    """SIGKILL of a UAV, or of a part that the mission cannot do without, before the UAVs have connected."""
    command = start_with(start)
    command.await_file(lambda: len(command.uav_pids()) == UAVS)
    modules = {"recorder": "services.recorder", "router": "services.router", "fork-source": "host.fork_source"}
    uavs = command.uav_pids()
    others = [pid for pid in command.pids(f"processes.{modules.get(part, '')}") if pid not in uavs]
    os.kill(uavs[3] if part == "uav" else others[0], signal.SIGKILL)
    (line,) = errors_of(command)
    who = f"UAV process u{4:03d}" if part == "uav" else part
    assert line == f"error: the {who} was ended by SIGKILL: it said nothing"
