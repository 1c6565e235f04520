"""Children end with their parent, even when it is killed with -9."""

from __future__ import annotations

import ctypes
import os
import signal

_PR_SET_PDEATHSIG = 1


def die_with_parent(parent_pid: int) -> None:
    """Have the kernel kill this process, frozen or not, when its parent ends.

    SIGKILL, the only signal that a stopped process obeys. The signal is tied to the parent's
    *thread* that made this process, so parents start children from their main thread. It is lost in
    a fork and must be set in every child; a parent that died before it was set is noticed by its id.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), "prctl(PR_SET_PDEATHSIG)")
    if os.getppid() != parent_pid:
        os.kill(os.getpid(), signal.SIGKILL)
