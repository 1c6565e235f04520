"""The second process of a first start, seen from the first one."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import suppress

import msgspec

from edc_swarm.mission.configuration import Mission

MODULE = "processes.uav.compile_rest"
HELPER_PATIENCE_S = 120.0
"""Longest wait for the helper after this process has compiled its own share; then it compiles the rest too."""


class Helper:
    """A process that compiles a share of the planner: a context, at whose end it does not run any more.

    Attributes
    ----------
    process
        The process, None before it begins.
    """

    def __init__(self, mission: Mission, *, wanted: bool) -> None:
        """Start nothing yet; nothing at all if it is not `wanted`, or if there is only one processor."""
        self._mission = mission
        self._wanted = wanted and len(os.sched_getaffinity(0)) > 1
        self.process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Helper:
        return self

    def __exit__(self, *_: object) -> None:
        if self.process is not None and self.process.poll() is None:
            self.process.kill()
            self.process.wait()

    def begin(self) -> None:
        """Start it, once; without it this process compiles everything."""
        from edc_swarm.planner.first_start import can_share  # noqa: PLC0415  (imports numba)

        if not self._wanted:
            return
        self._wanted = False
        if not can_share():
            return
        with suppress(OSError):
            self.process = subprocess.Popen(
                [sys.executable, "-m", MODULE, str(os.getpid())],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            assert self.process.stdin is not None
            with self.process.stdin as stdin:
                stdin.write(msgspec.json.encode(self._mission))

    def wait(self) -> None:
        """Wait until it has compiled its share, or for `HELPER_PATIENCE_S`."""
        if self.process is not None:
            with suppress(subprocess.TimeoutExpired):
                self.process.wait(HELPER_PATIENCE_S)
