"""Child processes of the command: router, recorder, fork source."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, cast

from edc_swarm.errors import SwarmError


class PartEndedError(SwarmError):
    """A process that the mission cannot do without has ended unasked. The input is not at fault."""


@dataclass(frozen=True, slots=True)
class ChildExited:
    """A child of the command ended; `status` is negative for a signal."""

    name: str
    pid: int
    status: int


@dataclass(frozen=True, slots=True)
class ChildReady:
    """A child of the command has printed its first line on standard output."""

    name: str


News = ChildReady | ChildExited


class Child:
    """One child process, `python -m MODULE`. It reports its first line and its end to `tell`; its errors go to `log`.

    The main thread must start it: the parent-death signal belongs to the thread that starts a child.
    It gets its own session: Ctrl-C in a terminal, or a signal to the process group, reaches the command
    alone, which then ends its children in order.
    """

    def __init__(
        self,
        name: str,
        module: str,
        arguments: Sequence[str],
        log: Path,
        tell: Callable[[News], None],
        *,
        orders: bytes | None = None,
        pass_fds: Sequence[int] = (),
    ) -> None:
        assert threading.current_thread() is threading.main_thread()
        self.name = name
        with log.open("ab") as output:
            self._process = subprocess.Popen(
                [sys.executable, "-m", module, *arguments],
                stdin=subprocess.DEVNULL if orders is None else subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=output,
                pass_fds=pass_fds,
                start_new_session=True,
                env={**os.environ, **SINGLE_THREADED},
            )
        if orders is not None and self._process.stdin is not None:
            with contextlib.suppress(BrokenPipeError), self._process.stdin:
                self._process.stdin.write(orders)
        self._exit = threading.Thread(target=self._wait, args=(tell,), name=f"wait-{name}", daemon=True)
        self._exit.start()

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """True until the process has ended."""
        return self._exit.is_alive()

    def signal(self, number: int) -> None:
        """Send a signal to the process if it is alive."""
        with contextlib.suppress(ProcessLookupError):
            self._process.send_signal(number)

    def end(self, timeout_s: float) -> None:
        """Terminate the process, and kill it if it does not end within `timeout_s`."""
        self.signal(signal.SIGTERM)
        self._exit.join(timeout_s)
        if self._exit.is_alive():
            self.signal(signal.SIGKILL)
            self._exit.join()

    def _wait(self, tell: Callable[[News], None]) -> None:
        with cast("IO[bytes]", self._process.stdout) as stdout:
            if stdout.readline():
                tell(ChildReady(self.name))
        tell(ChildExited(self.name, self.pid, self._process.wait()))


SINGLE_THREADED = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""Environment that keeps numerical libraries from starting threads: a process with threads cannot be forked safely."""
