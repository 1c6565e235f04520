"""The compilation of the planner, as it is told to the user: it takes long once on every machine."""

from __future__ import annotations

import time

from rich.console import Console

from processes.runtime.console import note
from processes.runtime.voice import Voice

FUNCTIONS = 49
"""Compilations of a first start in the process that tells of them, near enough for a user."""
TELL_EVERY_S = 10.0


class CompilingNote:
    """Words on the compilation: a line that changes on a terminal, elsewhere one line now and then."""

    def __init__(self, voice: Voice) -> None:
        self._voice = voice
        self._status = Console(stderr=True).status("") if voice.shows_bar else None
        self._begun_s: float | None = None
        self._told_s = 0.0

    def tell(self, done: int) -> None:
        """Tell that `done` functions are compiled."""
        now_s = time.monotonic()
        if self._begun_s is None:
            self._begun_s = self._told_s = now_s
            if self._status is not None:
                self._status.start()
            elif not self._voice.quiet:
                note("compiling the planner: once on this machine, about half a minute")
        if self._status is not None:
            spent_s = now_s - self._begun_s
            self._status.update(f"compiling the planner, once on this machine: {self._share(done)}, {spent_s:.0f} s")
        elif not self._voice.quiet and now_s - self._told_s >= TELL_EVERY_S:
            self._told_s = now_s
            note(f"compiling the planner: {self._share(done)}")

    def end(self) -> None:
        """Tell how long it took, if anything was compiled."""
        if self._status is not None:
            self._status.stop()
        if self._begun_s is not None and not self._voice.quiet:
            note(f"compiled the planner in {time.monotonic() - self._begun_s:.0f} s")
        self._begun_s = None

    def _share(self, done: int) -> str:
        return f"{done} of about {max(done, FUNCTIONS)} functions"
