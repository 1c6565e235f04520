"""The parent-death signal: a child process ends with its parent, even if SIGKILL ends the parent."""

from __future__ import annotations

import ctypes
import os
import signal

_PR_SET_PDEATHSIG = 1


def die_with_parent(parent_pid: int) -> None:
    """Have the kernel kill this process, frozen or not, when its parent ends.

    The signal is SIGKILL, since a stopped process obeys no other. The kernel ties it to the *thread* of
    the parent that made this process, so parents start children from their main thread. A fork clears
    it, so every child must set it. The check of the parent's id detects a parent that died before.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), "prctl(PR_SET_PDEATHSIG)")
    if os.getppid() != parent_pid:
        os.kill(os.getpid(), signal.SIGKILL)


def end_with_parent(parent_pid: int) -> None:
    """Die with the parent, and ignore Ctrl-C, which the terminal sends to all: the parent ends its parts in order."""
    die_with_parent(parent_pid)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
