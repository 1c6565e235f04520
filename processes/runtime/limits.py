"""The limits of the operating system on the resources of a mission: open files and processes."""

from __future__ import annotations

import os
import resource
from pathlib import Path

from edc_swarm.errors import InputError

FILES = 64
FILES_PER_UAV = 2
"""Open files that a process may have: FILES + FILES_PER_UAV * UAVs.

Measured with 4, 12 and 24 UAVs: the router has 22 and one for every UAV, the command at most 25, a UAV 19, the
recorder 17, the visualiser 16, the fork source 7. The second file per UAV is a reserve: a UAV may connect again
before Zenoh has closed its old link.
"""
TASKS = 120
TASKS_PER_UAV = 10
"""Threads that a mission may have, which count as processes: TASKS + TASKS_PER_UAV * UAVs.

Measured with 4, 12 and 24 UAVs: the router has 71 to 80, the command 13, a UAV, the recorder and the visualiser 4 or 5.
"""


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


def make_room_for_sessions(sessions: int) -> None:
    """Raise the soft limit on open files to that of a router for `sessions` UAVs, or as far as the hard limit lets."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = FILES + FILES_PER_UAV * sessions
    allowed = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
    if soft != resource.RLIM_INFINITY and soft < allowed:
        resource.setrlimit(resource.RLIMIT_NOFILE, (allowed, hard))


def _raise(name: str, which: int, needed: int) -> None:
    soft, hard = resource.getrlimit(which)
    if soft == resource.RLIM_INFINITY or soft >= needed:
        return
    if hard != resource.RLIM_INFINITY and hard < needed:
        raise InputError(name, hard, f"at least {needed} for a mission of this size")
    resource.setrlimit(which, (needed, hard))


def _tasks() -> int:
    """Return the number of threads of this user in all processes that this process can see."""
    user, count = os.geteuid(), 0
    for process in filter(str.isdigit, os.listdir("/proc")):
        path = Path("/proc", process)
        try:
            if path.stat().st_uid == user:
                count += len(os.listdir(path / "task"))
        except OSError:
            continue  # The process has ended meanwhile.
    return count
