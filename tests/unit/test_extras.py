"""The command that adds a missing extra is the one for the way in which edc-swarm was installed."""

from __future__ import annotations

import importlib.metadata
import json
import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from edc_swarm.analysis.frames import new_frame
from edc_swarm.errors import InputError
from edc_swarm.extras import IMAGE, has_package, install_command, version_of
from edc_swarm.mission.configuration import Mission
from edc_swarm.planner.registry import make_planner
from edc_swarm.reference.problem import Problem
from edc_swarm.reference.program import Programme
from processes.experiments.ledger import open_scheduler
from processes.experiments.plots import check_plots
from processes.host.security import check_security
from processes.notebook.pictures import new_axes
from processes.services.live import live_port
from processes.services.mavlink_link import ground_address
from processes.uav.autopilot_link import check_package

PROBLEM = Problem(np.zeros((1, 2)), np.ones((1, 2)), np.ones(1), np.ones(1), slots=2)


def installed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, url: dict[str, Any] | None, installer: str = "pip"
) -> None:
    """Let the metadata of edc-swarm be those of an installation from `url`, None for a package index."""
    folder = tmp_path / "edc_swarm-0.1.0.dist-info"
    folder.mkdir()
    (folder / "INSTALLER").write_text(f"{installer}\n")
    if url is not None:
        (folder / "direct_url.json").write_text(json.dumps(url))
    monkeypatch.setattr(importlib.metadata, "distribution", lambda _: importlib.metadata.PathDistribution(folder))
    monkeypatch.delenv(IMAGE, raising=False)


@pytest.mark.parametrize(
    ("url", "wanted"),
    [
        (None, ["edc-swarm[live]"]),
        ({"url": "file:///src/edc swarm", "dir_info": {"editable": True}}, ["-e", "/src/edc swarm[live]"]),
        ({"url": "file:///src", "dir_info": {}}, ["edc-swarm[live] @ file:///src"]),
        ({"url": "file:///a.whl", "archive_info": {}}, ["edc-swarm[live] @ file:///a.whl"]),
    ],
)
def test_pip_installs_from_where_edc_swarm_came(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, url: dict[str, Any] | None, wanted: list[str]
) -> None:
    """An index, an editable checkout, a folder, a wheel; the interpreter is this one."""
    installed(tmp_path, monkeypatch, url)
    assert shlex.split(install_command("live")) == [sys.executable, "-m", "pip", "install", *wanted]


def test_uv_and_the_image_have_their_own_commands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An environment of uv has no pip, and an image is built again with one extra more."""
    installed(tmp_path, monkeypatch, None, "uv")
    assert install_command("live") == f"uv pip install --python {sys.executable} 'edc-swarm[live]'"
    monkeypatch.setenv(IMAGE, "live,secure")
    assert install_command("plots") == "EXTRAS=live,secure,plots docker compose build"
    assert has_package("json")
    assert not has_package("no_such_package")


def test_a_package_that_is_not_installed_has_a_version_too() -> None:
    """The image has no numba, and recordings name its version."""
    assert version_of("numpy") == np.__version__
    assert version_of("no-such-package") == "absent"


@pytest.mark.parametrize(
    ("module", "extra", "use"),
    [
        ("clarabel", "reference", lambda: Programme(PROBLEM, "distance")),
        ("cryptography", "secure", lambda: check_security("--secure")),
        ("distributed", "cluster", lambda: open_scheduler("tcp://127.0.0.1:1", None).__enter__()),
        ("foxglove", "live", live_port),
        ("matplotlib", "notebook", lambda: new_axes(None)),
        ("matplotlib", "plots", check_plots),
        ("pandas", "frames", lambda: new_frame([], "pandas")),
        ("polars", "frames", lambda: new_frame([], "polars")),
        ("pymavlink", "mavlink", lambda: ground_address("udp:127.0.0.1:14550")),
        ("pymavlink", "mavlink", lambda: check_package("udpin:127.0.0.1:14550")),
        ("pyrvo", "baselines", lambda: make_planner("orca", Mission())),
    ],
)
def test_who_misses_a_package_reads_the_command_that_adds_it(
    monkeypatch: pytest.MonkeyPatch, module: str, extra: str, use: Callable[[], object]
) -> None:
    """Whether the command line or the library needs it, one line ends in the command for this installation."""
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(InputError) as told:
        use()
    assert str(told.value).endswith(f": {install_command(extra)}")
