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
from functools import cache
from pathlib import Path

import edc_swarm
from edc_swarm.extras import version_of
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.plug_ins import plug_ins_of
from edc_swarm.planner.registry import BUILT_IN

PACKAGES = ("edc-swarm", "eclipse-zenoh", "osqp", "numpy", "scipy", "numba", "mcap", "msgspec")
CODE = "code"
"""Fact of a simulated recording: the digest of the code that, with the mission, determines its messages."""
GIT_TIMEOUT_S = 60
"""Longest wait for `git`: on a busy machine it takes seconds, and without its answer equal runs differ (G6)."""
PLACE_OPTION = "--out"
OUTPUT_OPTIONS = frozenset({"--json", "--force"})


def run_facts(clock: str) -> dict[str, str]:
    """Return the metadata `run` of a recording; `clock` is "wall" or "virtual"."""
    return {
        "clock": clock,
        "command": os.fsencode(_command()).decode(errors="backslashreplace"),
        "commit": _commit(),
        "machine": f"{platform.machine()}, {os.cpu_count()} processors, {platform.system()} {platform.release()}",
        "python": platform.python_version(),
        **{f"version {name}": version_of(name) for name in PACKAGES},
    }


def _command() -> str:
    return shlex.join([Path(sys.argv[0]).name, *_reproducible_words(sys.argv[1:])])


def made_otherwise(run: Mapping[str, str]) -> str:
    """Return in words how the software of a recording with the facts `run` differs from this one, "" if it is equal."""
    here = run_facts("")
    names = [name for name in here if name in {"commit", "python"} or name.startswith("version ")]
    others = [name for name in names if run.get(name) and here[name] and run[name] != here[name]]
    then, now = (
        ", ".join(f"{name.removeprefix('version ')} {facts[name]}" for name in others) for facts in (run, here)
    )
    return f"made with {then}; this is {now}" if others else ""


def code_digest(*parts: str) -> str:
    """Return a hash of the source of the library and of the modules of the user's planner and other parts."""
    files = sorted(Path(edc_swarm.__file__).parent.rglob("*.py"))
    for part in parts:
        module, _, name = part.partition(":")
        if name and module.partition(".")[0] != edc_swarm.__name__:
            files += _source_files(module)
    digest = hashlib.sha256()
    for file in files:
        digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


def plug_in_facts(mission: Mission) -> dict[str, str]:
    """Return the metadata about the user's parts of a mission: the SHA-256 of each module's source, "" if unknown."""
    names = [mission.planner] if mission.planner not in BUILT_IN else []
    return {f"plug-in {name}": source_hash(name) for name in [*names, *plug_ins_of(mission)]}


def source_hash(name: str) -> str:
    """Return the SHA-256 of the source of the module of a class `package.module:Class`, "" if there is none."""
    files = _source_files(name.partition(":")[0])
    return hashlib.sha256(files[0].read_bytes()).hexdigest() if files else ""


def simulated_otherwise(run: Mapping[str, str], *parts: str) -> str:
    """Return in words why a simulation with the facts `run` may differ if it is repeated here, "" if it may not.

    Equal digests mean equal code, whatever the commit is called.
    """
    if run.get(CODE) == code_digest(*parts):
        run = {name: value for name, value in run.items() if name != "commit"}
        here = made_otherwise(run)
    else:
        here = made_otherwise(run) or "made with other code, or by another version of the planner or of a plug-in"
    machine = run_facts("")["machine"]
    return here or (f"made on another machine ({run.get('machine')})" if run.get("machine") != machine else "")


def _source_files(module: str) -> list[Path]:
    """Return the source file of a module, none if it is not found."""
    try:
        spec = importlib.util.find_spec(module)
    except (ImportError, ValueError):
        spec = None
    return [Path(spec.origin)] if spec is not None and spec.has_location and spec.origin is not None else []


def _reproducible_words(arguments: Sequence[str]) -> Iterator[str]:
    """Yield the words of the command line without the options of output: equal runs have equal bytes (G6)."""
    words = iter(arguments)
    for word in words:
        if word == PLACE_OPTION:
            next(words, "")
        elif word not in OUTPUT_OPTIONS and not word.startswith(f"{PLACE_OPTION}="):
            yield word


@cache
def _commit() -> str:
    """Return the commit of the checkout of this code, with + if files are changed; "" outside of a checkout.

    Asked once: the code of this process stays the same while files change, or while `git` is slow on a busy machine.
    """
    here = Path(__file__).resolve().parents[2]
    if not (here / ".git").exists():
        return ""
    try:
        described = subprocess.run(
            ["git", "-C", str(here), "describe", "--always", "--abbrev=40", "--exclude=*", "--dirty=+"],
            capture_output=True,
            text=True,
            timeout=GIT_TIMEOUT_S,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return described.stdout.strip()
