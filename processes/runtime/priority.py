"""Priority of a process among those of its swarm, so that an overloaded machine loses performance, not its head.

At a slot's start K followers wake at once, and each of them gets the same share of a processor as the head and the
router: a plan of 0.1 s then takes ten times as long, comes too late for the slot, and so does the next one. Linux
offers three remedies, and all act on threads:

- *Every user* may make the followers batch processes (`SCHED_BATCH`). One that wakes up does not interrupt a process
  that runs; head and router, which are none, may interrupt them. Their share of a busy processor stays the same, so
  work of others beside the swarm makes no follower late (a lower priority, nice +6, did).
- *Who may raise priorities* (root, CAP_SYS_NICE, RLIMIT_NICE) has head and router at nice `FIRST` below the rest, as
  far as the limit permits. A user who may not loses this alone. A UAV gives the priority back with its office.
- *A long time slice* (Linux 6.12 and later; older ones ignore it) lets those that come first take their larger share in
  few long turns: they wait until the others have had a short one. With short turns at a high priority each fix of a
  slot's start woke router and head at once, in the midst of the other UAVs' ticks; neither found a second message to
  work on, both took twice the processor time, and the ticks behind them were late. The slice grows with the share: a
  head with a long slice and the share of a follower came too late with every plan.

Late ticks, and processor time of the router in a slot, of K = 60 at 0.5 s on two cores that others kept busy (one run
of 30 slots each; nice values of router / head): 0 / 0: 0.3 %, 8.7 ms; -5 / -10: 1.4 %, 10.3 ms; -10 / -10: 2.0 %;
-20 / -20: 5.1 %, 11.9 ms; -10 / -10 with the long slice: 0.1 and 0.2 %, 5.8 and 7.6 ms.

Where Linux groups processes by session (autogroup), router and UAVs are in two groups that share the processors
equally, and priorities count within a group; so there too.
"""

from __future__ import annotations

import ctypes
import os
import platform
import resource
import struct
from contextlib import suppress

FIRST = -10
"""Nice value of head and router, relative to that of the swarm's other processes: ten times the processor time of each
of them. A planner that never returns leaves them some, which it does not at -20."""
SLICE_NS = 2_000_000
SHARE = 1.25
"""Time slice at the priority of the start, and factor of slice and share of the processor for each step of nice."""
_SCHED_SETATTR = {"x86_64": 314, "aarch64": 274}.get(platform.machine())
"""Number of the system call, which Python does not have."""
_ATTRIBUTES = struct.Struct("=IIQiIQQQ")
"""Its argument: size, policy, flags, nice value, static priority, time slice, deadline, period."""
_system = ctypes.CDLL(None)
_base_nice = os.getpriority(os.PRIO_PROCESS, 0)


def come_first() -> None:
    """Let the threads of this process interrupt followers, and give them more processor time, as far as is allowed."""
    for thread in _threads():
        with suppress(OSError):
            os.sched_setscheduler(thread, os.SCHED_OTHER, os.sched_param(0))
            _raise(thread)
            _set_slice(thread, os.SCHED_OTHER)


def give_way() -> None:
    """Let the threads of this process, and those they start, interrupt nobody; the priority is that of its start."""
    for thread in _threads():
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, thread, _base_nice)
            os.sched_setscheduler(thread, os.SCHED_BATCH, os.sched_param(0))
            _set_slice(thread, os.SCHED_BATCH)


def permitted_nice(base: int, limit: int) -> int:
    """Return the nice value to ask for with an RLIMIT_NICE of `limit` (20 - nice value), in a process with `base`."""
    return min(base, max(base + FIRST, 20 - limit))


def _raise(thread: int) -> None:
    """Raise the priority of a thread to `FIRST`, or as far as RLIMIT_NICE permits."""
    try:
        os.setpriority(os.PRIO_PROCESS, thread, max(_base_nice + FIRST, -20))
    except PermissionError:
        os.setpriority(os.PRIO_PROCESS, thread, permitted_nice(_base_nice, resource.getrlimit(resource.RLIMIT_NICE)[0]))


def _set_slice(thread: int, policy: int) -> None:
    """Set the time slice for the nice value of a thread, where the system lets it be set."""
    if _SCHED_SETATTR is not None:
        nice = os.getpriority(os.PRIO_PROCESS, thread)
        slice_ns = round(SLICE_NS * SHARE ** (_base_nice - nice)) if nice < _base_nice else 0  # 0 is the system's own.
        attributes = _ATTRIBUTES.pack(_ATTRIBUTES.size, policy, 0, nice, 0, slice_ns, 0, 0)
        _system.syscall(_SCHED_SETATTR, thread, attributes, 0)


def _threads() -> list[int]:
    """Return the threads of this process; one that ends meanwhile is no process any more."""
    return [int(thread) for thread in os.listdir("/proc/self/task")]
