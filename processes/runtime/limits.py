"""The limits of the operating system on what a mission needs: open files and processes."""

from __future__ import annotations

import os
import resource
from pathlib import Path

from edc_swarm.errors import InputError

FILES = 64
FILES_PER_UAV = 2
"""The router needs most: measured 21 open files and one for every UAV."""
TASKS = 120
TASKS_PER_UAV = 10
"""Threads count as processes: measured 70 of the router, 7 to 12 of any other with a session."""


def make_room(uavs: int) -> None:
    """Raise this process's soft limits, which its children inherit, to what a mission of `uavs` UAVs needs.

    Raises
    ------
    InputError
        A hard limit is lower.
    """
    _raise("ulimit -n", resource.RLIMIT_NOFILE, FILES + FILES_PER_UAV * uavs)
    if os.geteuid() != 0:  # The kernel does not hold root to this limit.
        _raise("ulimit -u", resource.RLIMIT_NPROC, _tasks() + TASKS + TASKS_PER_UAV * uavs)


def _raise(name: str, which: int, needed: int) -> None:
    soft, hard = resource.getrlimit(which)
    if soft == resource.RLIM_INFINITY or soft >= needed:
        return
    if hard != resource.RLIM_INFINITY and hard < needed:
        raise InputError(name, hard, f"at least {needed} for a mission of this size")
    resource.setrlimit(which, (needed, hard))


def _tasks() -> int:
    """Threads of this user in all that this process can see."""
    user, count = os.geteuid(), 0
    for process in filter(str.isdigit, os.listdir("/proc")):
        path = Path("/proc", process)
        try:
            if path.stat().st_uid == user:
                count += len(os.listdir(path / "task"))
        except OSError:
            continue  # It has ended meanwhile.
    return count
