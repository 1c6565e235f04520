"""Progress of a command that makes many runs: a bar on a terminal, elsewhere a line now and then."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from processes.runtime.console import note

LINE_EVERY_S = 30.0
"""Time between two lines where standard error is no terminal."""


@contextmanager
def run_count(title: str, total: int, done: int = 0) -> Iterator[Callable[[str], None]]:
    """Count runs on standard error: yield a function that takes the end of one run, and words on all runs so far.

    `done` of the `total` runs have ended before. An interrupt says how many have ended.
    """
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    times = (TextColumn("{task.fields[found]}"), TimeElapsedColumn(), TimeRemainingColumn())
    found, ended, begun_s = "", 0, time.monotonic()
    next_line_s = begun_s + LINE_EVERY_S
    with Progress(*columns, *times, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task(title, total=total, completed=done, found="")

        def state() -> str:
            return f"{title}: {done + ended} of {total} runs" + (f", {found}" if found else "")

        def end_run(words: str) -> None:
            nonlocal found, ended, next_line_s
            found, ended = words, ended + 1
            bar.update(task, advance=1, found=found)
            now_s = time.monotonic()
            if not console.is_terminal and now_s >= next_line_s:
                left_s = (now_s - begun_s) / ended * (total - done - ended)
                note(f"{state()}, about {left_s / 60:.0f} min left")
                next_line_s = now_s + LINE_EVERY_S

        try:
            yield end_run
        except KeyboardInterrupt:
            bar.stop()
            note(state())
            raise
