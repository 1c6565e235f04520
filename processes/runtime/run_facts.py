"""Facts about a run for its recording: versions, commit, command line, machine."""

from __future__ import annotations

import hashlib
import importlib.util
import os
import platform
import shlex
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path

import edc_swarm

PACKAGES = ("edc-swarm", "eclipse-zenoh", "osqp", "numpy", "scipy", "numba", "mcap", "msgspec")
CODE = "code"
"""Fact of a simulated recording: what decided what was said, besides the mission."""
PLACE = "--out"
MANNER = frozenset({"--json", "--force"})


def run_facts(clock: str) -> dict[str, str]:
    """Metadata `run` of a recording; `clock` is "wall" or "virtual"."""
    return {
        "clock": clock,
        "command": os.fsencode(_command()).decode(errors="backslashreplace"),
        "commit": _commit(),
        "machine": f"{platform.machine()}, {os.cpu_count()} processors, {platform.system()} {platform.release()}",
        "python": platform.python_version(),
        **{f"version {name}": version(name) for name in PACKAGES},
    }


def _command() -> str:
    return shlex.join([Path(sys.argv[0]).name, *_about_the_run(sys.argv[1:])])


def made_otherwise(run: Mapping[str, str]) -> str:
    """In words, what made a recording with the facts `run` and is not what runs here; "" where there is nothing."""
    here = run_facts("")
    names = [name for name in here if name in {"commit", "python"} or name.startswith("version ")]
    others = [name for name in names if run.get(name) and here[name] and run[name] != here[name]]
    then, now = (
        ", ".join(f"{name.removeprefix('version ')} {facts[name]}" for name in others) for facts in (run, here)
    )
    return f"made with {then}; this is {now}" if others else ""


def code_digest(planner: str) -> str:
    """Return a hash of the library's source, and of the file of a user's planner."""
    files = sorted(Path(edc_swarm.__file__).parent.rglob("*.py"))
    module, _, name = planner.partition(":")
    if name and module.partition(".")[0] != edc_swarm.__name__:
        files += _files_of(module)
    digest = hashlib.sha256()
    for file in files:
        digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


def simulated_otherwise(run: Mapping[str, str], planner: str) -> str:
    """Return in words what may rightly make a simulation with the facts `run` another one here, "" for nothing.

    Code that is known to be the same is the same, whatever the commit is called.
    """
    if run.get(CODE) == code_digest(planner):
        run = {name: value for name, value in run.items() if name != "commit"}
        here = made_otherwise(run)
    else:
        here = made_otherwise(run) or "made with other code, or by another version of the planner"
    machine = run_facts("")["machine"]
    return here or (f"made on another machine ({run.get('machine')})" if run.get("machine") != machine else "")


def _files_of(module: str) -> list[Path]:
    """The source of a module; none where it is not found."""
    try:
        spec = importlib.util.find_spec(module)
    except (ImportError, ValueError):
        spec = None
    return [Path(spec.origin)] if spec is not None and spec.has_location and spec.origin is not None else []


def _about_the_run(arguments: Sequence[str]) -> Iterator[str]:
    """Without where the recording goes and how the end is told: the same run has the same bytes anywhere (G6)."""
    words = iter(arguments)
    for word in words:
        if word == PLACE:
            next(words, "")
        elif word not in MANNER and not word.startswith(f"{PLACE}="):
            yield word


def _commit() -> str:
    """Commit of the checkout that this code is in, with + when it was changed; "" outside of one."""
    here = Path(__file__).resolve().parents[2]
    if not (here / ".git").exists():
        return ""
    try:
        said = subprocess.run(
            ["git", "-C", str(here), "describe", "--always", "--abbrev=40", "--exclude=*", "--dirty=+"],
            capture_output=True,
            text=True,
            timeout=5,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return said.stdout.strip()
