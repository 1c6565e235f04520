"""Priority of a process among those of its swarm, so that an overloaded machine loses performance, not its head.

At a slot's start K followers wake at once, and each of them gets the same share of a processor as the head and the
router: a plan of 0.1 s then takes ten times as long, comes too late for the slot, and so does the next one. Linux
offers two remedies, and both act on threads:

- *Every user* may make the followers batch processes (`SCHED_BATCH`). One that wakes up does not interrupt a process
  that runs; head and router, which are none, interrupt them. Their share of a busy processor stays the same, so work of
  others beside the swarm makes no follower late (a lower priority, nice +6, did).
- *Who may raise priorities* (root, CAP_SYS_NICE, RLIMIT_NICE) has head and router at nice `FIRST` below the rest. A
  user who may not loses this alone. A UAV gives the priority back with its office.

Where Linux groups processes by session (autogroup), router and UAVs are in two groups that share the processors
equally, and priorities count within a group; so there too.
"""

from __future__ import annotations

import os
from contextlib import suppress

FIRST = -20
"""Nice value of head and router, relative to that of the swarm's other processes."""
_base_nice = os.getpriority(os.PRIO_PROCESS, 0)


def come_first() -> None:
    """Let the threads of this process interrupt followers, and give them more processor time, as far as is allowed."""
    for thread in _threads():
        with suppress(OSError):
            os.sched_setscheduler(thread, os.SCHED_OTHER, os.sched_param(0))
            os.setpriority(os.PRIO_PROCESS, thread, max(_base_nice + FIRST, -20))


def give_way() -> None:
    """Let the threads of this process, and those they start, interrupt nobody; the priority is that of its start."""
    for thread in _threads():
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, thread, _base_nice)
            os.sched_setscheduler(thread, os.SCHED_BATCH, os.sched_param(0))


def _threads() -> list[int]:
    """Return the threads of this process; one that ends meanwhile is no process any more."""
    return [int(thread) for thread in os.listdir("/proc/self/task")]
