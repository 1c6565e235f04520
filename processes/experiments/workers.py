"""Worker processes of this host: they fly missions side by side, and end with their command."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any, TypeVar

from edc_swarm.errors import SwarmError
from processes.runtime.children import PartEndedError
from processes.runtime.parent import die_with_parent

T = TypeVar("T")
WORKER_DIED = "a worker process died, perhaps out of memory: fewer --jobs need less"


class Workers:
    """Processes that call functions for this one."""

    def __init__(self, pool: ProcessPoolExecutor) -> None:
        self._pool = pool

    def submit(self, function: Callable[..., T], *arguments: Any) -> Future[T]:
        """Have a worker call `function`; one that starts for that never receives Ctrl-C."""
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            return self._pool.submit(function, *arguments)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def map(self, function: Callable[..., T], *arguments: Iterable[Any]) -> Iterator[T]:
        """Have the workers call `function` with the first of all arguments, the second and so on; results in order."""
        calls = [self.submit(function, *each) for each in zip(*arguments, strict=True)]
        return (call.result() for call in calls)


@contextmanager
def workers(jobs: int, died: SwarmError | None = None) -> Iterator[Workers]:
    """Yield `jobs` workers; an exception, such as Ctrl-C, ends them without waiting for what they do.

    Raises
    ------
    SwarmError
        A worker has ended by itself: `died`, unless it is None.
    """
    spawn = multiprocessing.get_context("spawn")
    before = set(multiprocessing.active_children())
    with ProcessPoolExecutor(jobs, mp_context=spawn, initializer=die_with_parent, initargs=(os.getpid(),)) as pool:
        try:
            yield Workers(pool)
        except BrokenProcessPool:
            raise died or PartEndedError(WORKER_DIED) from None
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for worker in set(multiprocessing.active_children()) - before:
                worker.kill()
            raise
