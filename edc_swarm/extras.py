"""Optional packages (extras) of edc-swarm: the command that adds one to this installation."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import json
import os
import shlex
import sys
from typing import Any

from edc_swarm.errors import InputError

IMAGE = "EDC_SWARM_EXTRAS"
"""Environment variable of the container image: the extras that it was built with."""

PLANNER_EXTRAS = {"orca": ("pyrvo", "baselines")}
"""Package and extra that a planner of this package needs beyond the dependencies."""


def version_of(package: str) -> str:
    """Return the version of an installed package, else "absent": where the planner is ready, numba may be."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "absent"


def has_package(module: str) -> bool:
    """Return True if the module of an extra can be imported."""
    return importlib.util.find_spec(module) is not None


def install_command(extra: str) -> str:
    """Return the command that adds an extra to this installation of edc-swarm."""
    built_with = os.environ.get(IMAGE)
    if built_with is not None:
        extras = ",".join(filter(None, [built_with, extra]))
        return f"EXTRAS={extras} docker compose build"
    url, installer = _origin()
    path = url.get("url", "").removeprefix("file://")
    if url.get("dir_info", {}).get("editable"):
        wanted = ["-e", f"{path}[{extra}]"]
    elif url:
        wanted = [f"edc-swarm[{extra}] @ {url['url']}"]
    else:
        wanted = [f"edc-swarm[{extra}]"]
    pip = ["uv", "pip", "install", "--python", sys.executable]
    if installer != "uv":
        pip = [sys.executable, "-m", "pip", "install"]
    return shlex.join([*pip, *wanted])


def check_planner_extra(planner: str) -> None:
    """Raise `InputError` if a planner of this package needs an extra that is not installed."""
    module, extra = PLANNER_EXTRAS.get(planner, ("", ""))
    if module and not has_package(module):
        raise InputError("planner", planner, f"another one, or {module} installed: {install_command(extra)}")


def _origin() -> tuple[dict[str, Any], str]:
    """Return where this installation came from (PEP 610; empty for a package index), and the program that made it."""
    try:
        found = importlib.metadata.distribution("edc-swarm")
    except importlib.metadata.PackageNotFoundError:
        return {}, ""
    url: dict[str, Any] = json.loads(found.read_text("direct_url.json") or "{}")
    return url, (found.read_text("INSTALLER") or "").strip()
