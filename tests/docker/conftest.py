"""A Docker engine, if one answers, and missions flown by `compose.yaml` on it."""

from __future__ import annotations

import os
import shutil
import subprocess
import uuid
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from edc_swarm.errors import RecordingError
from edc_swarm.recording.model import Recording
from edc_swarm.recording.reader import read_recording
from tests.processes.conftest import await_true

TOP = Path(__file__).resolve().parents[2]
USER = 1000
"""Who the image runs as."""
OWNER = 4711
"""Who the folder of recordings belongs to, where the tests may choose."""


def said(*command: str, check: bool = True, **options: Any) -> str:
    """What a command says on standard output."""
    ended: subprocess.CompletedProcess[str] = subprocess.run(
        command, capture_output=True, text=True, check=False, **options
    )
    assert ended.returncode == 0 or not check, f"{command}: {ended.stdout[-3000:]}{ended.stderr[-3000:]}"
    return ended.stdout


def compose_command() -> list[str]:
    """`docker compose`, or where that is not there `docker-compose`."""
    plugin = subprocess.run(["docker", "compose", "version"], capture_output=True, check=False)
    return ["docker", "compose"] if plugin.returncode == 0 else ["docker-compose"]


@pytest.fixture(scope="session")
def image() -> str:
    """The image, built from this tree."""
    if shutil.which("docker") is None:
        pytest.skip("no Docker here: the command docker is not installed")
    if subprocess.run(["docker", "info"], capture_output=True, check=False, timeout=60).returncode != 0:
        pytest.skip("no Docker engine answers (docker info)")
    if compose_command() == ["docker-compose"] and shutil.which("docker-compose") is None:
        pytest.skip("neither docker compose nor docker-compose is installed")
    said("docker", "build", "--tag", "edc-swarm", str(TOP))
    return "edc-swarm"


@dataclass
class Swarm:
    """One mission in containers: a compose project of its own, with a folder of its own for recordings."""

    folder: Path
    variables: dict[str, str]
    files: list[str] = field(default_factory=lambda: ["compose.yaml"])
    name: str = field(default_factory=lambda: f"edc{uuid.uuid4().hex[:8]}")

    def compose(self, *words: str, check: bool = True) -> subprocess.CompletedProcess[str]:
        """Run compose on the project."""
        files = [word for file in self.files for word in ("--file", str(TOP / file))]
        command = [*compose_command(), "--project-name", self.name, *files, *words]
        env = {**os.environ, "RECORDINGS": str(self.folder), **self.variables}
        ended = subprocess.run(command, capture_output=True, text=True, check=False, env=env, cwd=TOP)
        assert ended.returncode == 0 or not check, ended.stdout[-3000:] + ended.stderr[-3000:]
        return ended

    def secure(self) -> None:
        """Make certificates, and fly with them from now on."""
        self.files = ["compose.yaml", "compose.secure.yaml"]
        self.compose("run", "--rm", "certs")

    def containers(self, service: str = "", *, running: bool = False) -> list[str]:
        """Ids of the containers, all or those of a service."""
        labels = [f"label=com.docker.compose.project={self.name}"]
        labels += [f"label=com.docker.compose.service={service}"] if service else []
        filters = [word for label in labels for word in ("--filter", label)]
        return said("docker", "ps", "--quiet", *([] if running else ["--all"]), *filters).split()

    def await_slot(self, slot: int) -> Recording:
        """Wait until the recorder has flushed a fix of `slot`; what it has by then."""
        await_true(lambda: self._newest_slot() >= slot)
        return self._partial()

    def _newest_slot(self) -> int:
        try:
            return max((fix.slot for fix in self._partial().fixes), default=-1)
        except (RecordingError, StopIteration):
            return -1

    def _partial(self) -> Recording:
        return read_recording(next(self.folder.glob("*.part")), salvage=True)

    def container_of(self, uav: str) -> str:
        """The container that flies a UAV."""
        (found,) = (each for each in self.containers("uav") if f"flies {uav} of" in logs(each))
        return found

    def await_end(self) -> int:
        """Wait until everything has stopped by itself; the operator's exit status."""
        (operator,) = self.containers("operator")
        status = int(said("docker", "wait", operator))
        await_true(lambda: not self.containers(running=True), 30)
        return status

    @property
    def recording(self) -> Recording:
        """The one recording that was written."""
        (path,) = self.folder.glob("*.mcap")
        return read_recording(path)


def logs(container: str) -> str:
    """All that a container has said."""
    ended = subprocess.run(["docker", "logs", container], capture_output=True, text=True, check=True)
    return ended.stdout + ended.stderr


@pytest.fixture
def swarm(image: str, tmp_path: Path) -> Iterator[Callable[..., Swarm]]:
    """A swarm with the given variables of `compose.yaml`; nothing is left of it."""
    del image
    made: list[Swarm] = []

    def make(**variables: str) -> Swarm:
        folder = tmp_path / "recordings"
        folder.mkdir()
        if os.geteuid() == 0:
            os.chown(folder, OWNER, OWNER)
        made.append(Swarm(folder, variables))
        return made[-1]

    yield make
    for each in made:
        each.compose("down", "--volumes", "--timeout", "1", check=False)
