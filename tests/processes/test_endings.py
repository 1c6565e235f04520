"""Ends of a run: whatever the cause, no process is left and the recording is readable."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from mcap.reader import make_reader

from edc_swarm.analysis.guarantees.check import check
from edc_swarm.errors import InputError
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import complete_mission
from edc_swarm.recording.reader import read_recording
from edc_swarm.recording.sequences import find_gaps
from processes.runtime.output import salvage_parts
from processes.uav.state import create_state
from tests.processes.conftest import Fly, FlyToEnd, await_true


@pytest.mark.long
def test_ctrl_c_in_flight_leaves_a_whole_recording(start: Fly) -> None:
    """Every process publishes its last message: the recording is finished, not recovered."""
    command = start("run", "--json")
    command.await_flight(10)
    command.process.send_signal(signal.SIGINT)
    ended = command.end()
    assert ended.status == 1
    assert "interrupted" in ended.stderr
    assert "Traceback" not in ended.stderr
    assert not find_gaps(ended.recording)
    assert ended.recording.run_end is not None


def test_ctrl_c_at_the_start(start: Fly) -> None:
    """Before the connection there is nothing to close, but all processes must end."""
    command = start("run")
    command.await_file(lambda: bool(command.pids("processes.host.fork_source")))
    command.process.send_signal(signal.SIGINT)
    ended = command.end()
    assert ended.status in {1, 2}
    assert "Traceback" not in ended.stderr


def test_kill_of_the_command_ends_its_children_even_frozen_ones(start: Fly) -> None:
    """SIGKILL is the one parent-death signal that a stopped process obeys."""
    command = start("run")
    command.await_flight(10)
    os.kill(command.uav_pids()[0], signal.SIGSTOP)
    command.process.kill()
    await_true(lambda: not command.pids())
    command.process.communicate()


@pytest.mark.long
def test_what_a_killed_run_has_left_is_recovered_at_the_next_start(start: Fly, run: FlyToEnd, tmp_path: Path) -> None:
    """The next run recovers the recording and keeps the original."""
    command = start("run", name="killed.mcap")
    command.await_flight(10)
    command.process.kill()
    await_true(lambda: not command.pids())
    ended = run("--uavs", "3")
    assert "recovered" in ended.stderr
    assert read_recording(tmp_path / "killed.recovered.mcap").fixes
    assert (tmp_path / "killed.mcap.part.torn").exists()


@pytest.mark.long
def test_a_recorder_killed_by_hand_ends_the_run_and_what_it_flushed_is_recovered(start: Fly) -> None:
    """The run ends without a recorder; an independent reader and every checker read the recovered recording."""
    command = start("run", "--json")
    command.await_flight(10)
    flushed = read_recording(command.path.with_name(command.path.name + ".part"), salvage=True).message_count
    os.kill(command.pids("processes.services.recorder")[0], signal.SIGKILL)
    ended = command.end()
    assert ended.status == 1
    assert "recorder was ended by SIGKILL" in ended.stderr
    assert f"the recorder died; recovered {ended.path}: torn" in ended.stderr
    recording = ended.recording
    assert recording.message_count >= flushed
    with ended.path.open("rb") as stream:
        viewed = sum(recording.unknown.values())
        assert sum(1 for _ in make_reader(stream).iter_messages()) == recording.message_count + viewed
    assert [result.guarantee for result in check(recording) if result.broken] == []
    assert {path.name for path in ended.path.parent.iterdir()} == {ended.path.name}


@pytest.mark.long
@pytest.mark.parametrize(("part", "module"), [("router", "services.router"), ("fork-source", "host.fork_source")])
def test_a_part_killed_by_hand_fails_the_mission(start: Fly, part: str, module: str) -> None:
    """The input is not at fault: status 1, the cause in one line, and the summary names the UAVs not home."""
    command = start("run", "--json")
    command.await_flight(10)
    os.kill(command.pids(f"processes.{module}")[0], signal.SIGKILL)
    ended = command.end()
    assert ended.status == 1
    assert f"error: the {part} was ended by SIGKILL: it said nothing" in ended.stderr.splitlines()
    assert not ended.json["completed"]
    assert len(ended.json["not_home"]) == ended.json["uavs"] - ended.json["arrived"] > 0


@pytest.mark.long
def test_a_full_disk_is_an_error_with_a_name(start: Fly) -> None:
    """A limit on the size of files replaces the full disk: both are errors of `write`."""
    limited = ("bash", "-c", 'ulimit -f 64; exec "$@"', "limited")
    ended = start("run", "--uavs", "10", "--time-scale", "4", prefix=limited).end()
    assert ended.status == 2
    assert "EFBIG" in ended.stderr
    assert "Traceback" not in ended.stderr


def test_an_existing_recording_is_kept_until_the_new_one_is_whole(start: Fly, tmp_path: Path) -> None:
    """Neither a run without --force nor an unfinished run with it replaces the recording."""
    kept = tmp_path / "run.mcap"
    kept.write_bytes(b"old")
    assert start("run").end().status == 2
    command = start("run", "--force", "--uavs", "3")
    command.await_file(lambda: bool(command.pids("processes.services.recorder")))
    command.process.kill()
    await_true(lambda: not command.pids())
    assert kept.read_bytes() == b"old"


def test_other_signals_end_in_order_too(start: Fly) -> None:
    """A closed terminal does not cost the recording."""
    command = start("run", "--uavs", "3")
    command.await_flight(3)
    command.process.send_signal(signal.SIGHUP)
    assert not find_gaps(command.end().recording)


@pytest.mark.long
def test_a_simulation_keeps_its_recording_from_those_beside_it(start: Fly, tmp_path: Path) -> None:
    """A run does not recover the part of another run in progress in the same folder."""
    command = start("sim", "--json", "--uavs", "30", "--area", "20000")
    part = command.path.with_name(command.path.name + ".part")
    command.await_file(lambda: part.exists() and part.stat().st_size > 0)
    assert salvage_parts(tmp_path) == []
    assert part.exists()
    assert command.end().status == 0


@pytest.mark.long
@pytest.mark.parametrize(("limit", "status"), [("ulimit -Sn 32", 0), ("ulimit -n 60", 2)])
def test_open_files_are_enough_or_their_limit_is_named(start: Fly, limit: str, status: int) -> None:
    """The command raises a low soft limit; for a low hard limit it prints one line and starts nothing."""
    limited = ("bash", "-c", f'{limit}; exec "$@"', "limited")
    ended = start("run", "--uavs", "12", "--time-scale", "4", prefix=limited).end()
    assert ended.status == status, ended.stderr
    if status:
        assert ended.stderr == "error: ulimit -n = 60: must be at least 88 for a mission of this size\n"
        assert list(ended.path.parent.iterdir()) == []


@pytest.fixture
def tiny_disk(tmp_path: Path) -> Iterator[Path]:
    """Mount a file system of 64 kB."""
    folder = tmp_path / "tiny"
    folder.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", folder], check=False, capture_output=True
    )
    if mounted.returncode != 0:
        pytest.skip(f"cannot mount a small disk: {mounted.stderr.decode().strip()}")
    yield folder
    subprocess.run(["umount", "-l", folder], check=True)


@pytest.mark.long
def test_a_disk_that_fills_in_flight_is_named_with_what_can_be_recovered(start: Fly, tiny_disk: Path) -> None:
    """On a really full disk, one line names the folder, the reason and the part."""
    path = tiny_disk / "run.mcap"
    ended = start("run", "--uavs", "3", "--time-scale", "4", "--out", str(path)).end()
    assert ended.status == 2, ended.stderr
    assert re.search(f"{tiny_disk}: .*(disk is full|no space left)", ended.stderr), ended.stderr
    assert f"edc-swarm recover {path}.part" in ended.stderr
    assert "Traceback" not in ended.stderr


def test_promises_on_a_full_disk_are_an_error_with_a_name(tiny_disk: Path) -> None:
    """A failed creation leaves no half file."""
    with contextlib.suppress(OSError):
        (tiny_disk / "filler").write_bytes(bytes(1 << 20))
    with pytest.raises(InputError, match=rf"u001\.promise.*{tiny_disk}: no space left on device"):
        create_state(tiny_disk, complete_mission(Mission(uavs=3)).roster[0])
    assert [path.name for path in tiny_disk.iterdir()] == ["filler"]
