"""Worker processes of this host: they alone fly, and end with their command."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any, TypeVar

from edc_swarm.errors import SwarmError
from processes.runtime.parent import die_with_parent

T = TypeVar("T")


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


@contextmanager
def workers(jobs: int, died: SwarmError) -> Iterator[Workers]:
    """Yield `jobs` workers; an exception, such as Ctrl-C, ends them without waiting for what they do.

    Raises
    ------
    SwarmError
        `died`: a worker has ended by itself.
    """
    spawn = multiprocessing.get_context("spawn")
    before = set(multiprocessing.active_children())
    with ProcessPoolExecutor(jobs, mp_context=spawn, initializer=die_with_parent, initargs=(os.getpid(),)) as pool:
        try:
            yield Workers(pool)
        except BrokenProcessPool:
            raise died from None
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for worker in set(multiprocessing.active_children()) - before:
                worker.kill()
            raise
