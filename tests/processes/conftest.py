"""Fixtures for real processes on loopback: they start the command as a user does, and leave no process behind."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from edc_swarm.errors import RecordingError
from edc_swarm.recording.model import Recording
from edc_swarm.recording.reader import read_recording
from edc_swarm.recording.sequences import find_gaps
from processes.bus.address import free_endpoint

MARK = "EDC_SWARM_TEST"
DEADLINE_S = 120.0

# A shell makes its background jobs ignore Ctrl-C, and the processes of these tests would inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)


@dataclass
class Ended:
    """The outcome of a command: status, output, recording."""

    status: int
    stdout: str
    stderr: str
    path: Path

    @property
    def json(self) -> dict[str, Any]:
        """The standard output, decoded."""
        decoded: dict[str, Any] = json.loads(self.stdout)
        return decoded

    @property
    def recording(self) -> Recording:
        """The recording of the command."""
        return read_recording(self.path)


@dataclass
class Started:
    """A command that runs; all its processes carry `mark` in their environment."""

    process: subprocess.Popen[str]
    path: Path
    mark: str

    def pids(self, module: str = "") -> list[int]:
        """Return the ids of its living processes whose command line has `module`."""
        return [pid for pid in _marked(self.mark) if module in _command_line(pid)]

    def await_file(self, found: Callable[[], bool]) -> None:
        """Wait for a condition while the command is alive."""
        await_true(lambda: found() or self.process.poll() is not None)
        assert self.process.poll() is None, self.process.communicate()

    def await_flight(self, uavs: int) -> None:
        """Wait until the UAV processes run and the recorder has flushed fixes."""
        self.await_file(lambda: len(self.uav_pids()) == uavs and self.has_fixes())

    def has_fixes(self) -> bool:
        """Return True if the recorder has flushed fixes."""
        try:
            return bool(read_recording(self.path.with_name(self.path.name + ".part"), salvage=True).fixes)
        except RecordingError:
            return False

    def uav_pids(self) -> list[int]:
        """Return the ids of the UAV processes: the children of the fork source."""
        forked = self.pids("processes.host.fork_source")
        return [pid for pid in forked if _parent(pid) in forked]

    def end(self) -> Ended:
        """Wait for the end of the command; all its processes must end."""
        try:
            stdout, stderr = self.process.communicate(timeout=DEADLINE_S)
        finally:
            self.process.kill()
        await_true(lambda: not _marked(self.mark))
        return Ended(self.process.returncode, stdout, stderr, self.path)


Fly = Callable[..., Started]
FlyToEnd = Callable[..., Ended]


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Fly]:
    """Start `edc-swarm` with arguments; kill the processes that are left at the end."""
    started: list[Started] = []

    def go(*arguments: str, name: str = "run.mcap", prefix: tuple[str, ...] = ()) -> Started:
        started.append(start_command(*arguments, path=tmp_path / name, prefix=prefix))
        return started[-1]

    yield go
    for command in started:
        for pid in _marked(command.mark):
            with suppress(ProcessLookupError):  # it may have ended since it was listed
                os.kill(pid, signal.SIGKILL)
        command.process.communicate()


@pytest.fixture
def run(start: Fly) -> FlyToEnd:
    """Fly a mission at time scale 4 to its end; the recording must have no sequence gap."""

    def go(*arguments: str, **options: Any) -> Ended:
        ended = start("run", "--json", "--time-scale", "4", *arguments, **options).end()
        assert ended.path.exists(), ended.stderr
        assert not find_gaps(ended.recording)
        return ended

    return go


@pytest.fixture
def endpoint() -> Iterator[str]:
    """Start a router process, and yield its address."""
    address = free_endpoint()
    router = subprocess.Popen([sys.executable, "-m", "processes.services.router", address], stdout=subprocess.PIPE)
    assert router.stdout is not None
    assert router.stdout.readline() == b"ready\n"
    yield address
    router.terminate()
    assert router.wait() == 0
    router.stdout.close()


def start_command(*arguments: str, path: Path, prefix: tuple[str, ...] = ()) -> Started:
    """Start the command with a mark in the environment."""
    mark = uuid.uuid4().hex
    out = ("--out", str(path)) if arguments[0] in {"run", "sim"} and "--out" not in arguments else ()
    process = subprocess.Popen(
        [*prefix, sys.executable, "-m", "processes.cli.main", *arguments, *out],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, MARK: mark},
    )
    return Started(process, path, mark)


def await_true(found: Callable[[], bool], deadline_s: float = DEADLINE_S) -> None:
    """Wait for a condition that must come true."""
    end_s = time.monotonic() + deadline_s
    while not found():
        assert time.monotonic() < end_s, "waited in vain"
        time.sleep(0.02)


def _marked(mark: str) -> list[int]:
    sought = f"{MARK}={mark}".encode()
    pids = (int(entry) for entry in os.listdir("/proc") if entry.isdigit())
    return sorted(pid for pid in pids if sought in _read(pid, "environ").split(b"\0") and not _is_zombie(pid))


def _command_line(pid: int) -> str:
    return _read(pid, "cmdline").replace(b"\0", b" ").decode()


def _parent(pid: int) -> int:
    return int(_read(pid, "stat").rpartition(b")")[2].split()[1] or 0)


def _is_zombie(pid: int) -> bool:
    return _read(pid, "stat").rpartition(b")")[2].split()[:1] in ([b"Z"], [])


def _read(pid: int, name: str) -> bytes:
    try:
        return Path(f"/proc/{pid}/{name}").read_bytes()
    except OSError:
        return b""
