"""Priority of a process among those of its swarm, so that an overloaded machine loses performance, not its head.

At a slot's start K followers wake at once, and each of them gets the same share of a processor as the head: a plan of
0.1 s then takes ten times as long, comes too late for the slot, and so does the next one. Linux offers two remedies,
and both act on threads:

- *Every user* may make the followers batch processes (`SCHED_BATCH`). One that wakes up does not interrupt a process
  that runs; head and router, which are none, may interrupt them. Their share of a busy processor stays the same, so
  work of others beside the swarm makes no follower late (a lower priority, nice +6, did).
- *Who may raise priorities* (root, CAP_SYS_NICE, RLIMIT_NICE) has a head that plans at nice `FIRST` below the rest, as
  far as the limit permits. A user who may not loses this alone.

Only a plan comes first, and only until its slot is over, in which the commands leave. Router and head once came first
at all times, at nice -20. Then every fix of a slot's start woke the router and the head at once, in the midst of the
other UAVs' ticks: neither found more than one message to work on. On a busy machine (K = 50) the router took 36 ms of
processor time in a slot and not 16, the head 43 and not 23, the UAVs 131 and not 86, and at K = 200 the ticks of the
UAVs behind them were late.

Where Linux groups processes by session (autogroup), router and UAVs are in two groups that share the processors
equally, and priorities count within a group; so there too.
"""

from __future__ import annotations

import os
import resource
from contextlib import suppress

FIRST = -10
"""Nice value of a head that plans, relative to that of the swarm's other processes: ten times the processor time of
each of them. A planner that never returns leaves them some, which it does not at -20; plans are as fast."""
_base_nice = os.getpriority(os.PRIO_PROCESS, 0)


def come_first() -> None:
    """Let the threads of this process interrupt followers, and give them more processor time, as far as is allowed."""
    for thread in _threads():
        with suppress(OSError):
            os.sched_setscheduler(thread, os.SCHED_OTHER, os.sched_param(0))
            _raise(thread)


def keep_place() -> None:
    """Let the threads of this process interrupt followers; the priority is that of its start."""
    _take(os.SCHED_OTHER)


def give_way() -> None:
    """Let the threads of this process, and those they start, interrupt nobody; the priority is that of its start."""
    _take(os.SCHED_BATCH)


def _take(policy: int) -> None:
    for thread in _threads():
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, thread, _base_nice)
            os.sched_setscheduler(thread, policy, os.sched_param(0))


def _raise(thread: int) -> None:
    """Raise the priority of a thread to `FIRST`, or as far as RLIMIT_NICE permits."""
    try:
        os.setpriority(os.PRIO_PROCESS, thread, max(_base_nice + FIRST, -20))
    except PermissionError:
        os.setpriority(os.PRIO_PROCESS, thread, permitted_nice(_base_nice, resource.getrlimit(resource.RLIMIT_NICE)[0]))


def permitted_nice(base: int, limit: int) -> int:
    """Return the nice value for a plan of a process that began at `base` and has this RLIMIT_NICE (20 - nice value)."""
    return min(base, max(base + FIRST, 20 - limit))


def _threads() -> list[int]:
    """Return the threads of this process; one that ends meanwhile is no process any more."""
    return [int(thread) for thread in os.listdir("/proc/self/task")]
