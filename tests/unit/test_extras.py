"""The command that adds a missing extra is the one for the way in which edc-swarm was installed."""

from __future__ import annotations

import importlib.metadata
import json
import shlex
import sys
from pathlib import Path
from typing import Any

import pytest

from processes.runtime.extras import IMAGE, has_package, install_command


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
