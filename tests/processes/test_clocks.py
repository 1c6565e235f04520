"""Jumps of the wall clock during a mission: they change nothing but the recorded events."""

from __future__ import annotations

import shutil
import subprocess
import time
from pathlib import Path

import pytest

from edc_swarm.errors import SwarmError
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import complete_mission
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.messages import mission_message
from processes.runtime.clock import MAX_REPORTED_JUMPS, MissionClock
from tests.processes.conftest import Fly

S = 10**9
MOST_SLOTS = 60
"""Without a jump the mission takes 30 to 40 slots."""


@pytest.fixture(scope="module")
def shim(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Compile a library that sets the wall clock of the process that loads it."""
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler")
    library = tmp_path_factory.mktemp("shim") / "clock_jump.so"
    source = Path(__file__).with_name("clock_jump.c")
    subprocess.run([compiler, "-shared", "-fPIC", "-o", str(library), str(source)], check=True)
    return library


@pytest.mark.long
@pytest.mark.parametrize("by_s", [3600, -3600, 2, -2])
def test_a_mission_does_not_follow_the_wall_clock(start: Fly, shim: Path, tmp_path: Path, by_s: int) -> None:
    """All UAVs arrive as without the jump, a UAV started after it too; every process reports the jump once."""
    file = tmp_path / "jump"
    setting = ("env", f"LD_PRELOAD={shim}", f"JUMP_FILE={file}", f"JUMP_BY={by_s}")
    fault = ("--fault", "kill u002 @10 for 1s")
    flying = start("run", "--json", "--uavs", "4", "--time-scale", "4", *fault, prefix=setting)
    flying.await_flight(4)
    file.touch()
    ended = flying.end()
    assert ended.status == 0, ended.stderr
    assert ended.json["completed"]
    recording = ended.recording
    assert max(fix.slot for fix in recording.fixes) < MOST_SLOTS
    told = [event for event in recording.events if event.kind == EventKind.CLOCK_JUMP]
    assert {event.source for event in told} >= {"operator", "recorder", "viz", "u001", "u002", "u003", "u004"}
    assert len({event.instance for event in told}) == len(told)
    way = "ahead" if by_s > 0 else "back"
    assert {event.detail.partition(f"{way} by ")[2].partition(".")[0] for event in told} <= {
        str(abs(by_s)),
        str(abs(by_s) - 1),
    }


def test_who_starts_later_takes_over_the_anchor(monkeypatch: pytest.MonkeyPatch) -> None:
    """A process that starts after a jump shows the same time as the process that started it."""
    first = MissionClock()
    true_ns = time.time_ns
    monkeypatch.setattr(time, "time_ns", lambda: true_ns() + 3600 * S)
    assert abs(MissionClock(first.ahead_ns).now_ns() - first.now_ns()) < S
    assert MissionClock().now_ns() - first.now_ns() > 3599 * S


def test_jumps_are_told_once_each_and_not_without_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """A slew is no jump, and a clock that jumps all the time does not fill the recording."""
    clock, true_ns, off_ns = MissionClock(), time.time_ns, 0
    monkeypatch.setattr(time, "time_ns", lambda: true_ns() + off_ns)
    for _ in range(100):
        off_ns += S // 10
        assert clock.jump() is None
    off_ns -= 7 * S
    assert (clock.jump() or "").startswith("the wall clock was set back by 7.0")
    assert clock.jump() is None
    told = 0
    for _ in range(100):
        off_ns += 5 * S
        told += clock.jump() is not None
    assert told == MAX_REPORTED_JUMPS - 1


@pytest.mark.parametrize(
    ("off_s", "reason"),
    [(-3600, "clock of this host is behind"), (10**6, "clock of this host is ahead")],
)
def test_a_host_with_another_time_does_not_wait_in_silence(off_s: int, reason: str) -> None:
    """The error states the difference; a small one is like the fault `clock`, which missions survive."""
    clock = MissionClock()
    mission = mission_message(complete_mission(Mission(uavs=3)), clock.now_ns())
    clock.check_epoch(mission)
    MissionClock(clock.ahead_ns - 2 * S).check_epoch(mission)
    with pytest.raises(SwarmError, match=f"cannot take part in mission .*{reason}"):
        MissionClock(clock.ahead_ns + off_s * S).check_epoch(mission)
