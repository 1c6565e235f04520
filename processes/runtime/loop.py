"""The one loop of a command: everything that happens comes through its inbox.

What the bus says, what children do, Ctrl-C. The loop never sleeps for something to be ready; it
waits for the message that says so.
"""

from __future__ import annotations

import contextlib
import math
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass

from edc_swarm.errors import SwarmError
from processes.runtime.console import note
from processes.runtime.inbox import SETTLE_S, Inbox

START_TIMEOUT_S = 600.0
"""Longest wait at the start: on a new machine the planner is compiled first, which takes a minute."""
PATIENCE_S = 4.0
"""After this long the user is told what is waited for."""


What = str | Callable[[], str]
"""What is waited for, in words; a function where they are best found when they are said."""


def in_words(what: What) -> str:
    """What is waited for, as of now."""
    return what if isinstance(what, str) else what()


class Interrupted(Exception):  # noqa: N818  (nothing is wrong)
    """Ctrl-C, SIGTERM or SIGHUP."""


@dataclass(frozen=True, slots=True)
class Interrupt:
    """A signal asks the command to end."""


class Loop:
    """Hands what comes in to `take`, and calls `after` each time.

    Attributes
    ----------
    failure
        Raised by the next `pump`, until the command is `ending`.
    """

    def __init__(self, take: Callable[[object], None], after: Callable[[], None] = lambda: None) -> None:
        self._take = take
        self._after = after
        self.inbox: Inbox[object] = Inbox()
        self.interrupted = False
        self.ending = False
        self.failure: SwarmError | None = None

    def obey_signals(self) -> None:
        """Let signals that ask for the end come through the inbox too."""
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, lambda *_: self.inbox.put_always(Interrupt()))

    def wait(
        self, done: Callable[[], bool], what: What, timeout_s: float = START_TIMEOUT_S, look_every_s: float = math.inf
    ) -> None:
        """Work until `done`; after a while the user is told `what` is waited for.

        `look_every_s`: for what comes without a message.
        """
        start_s, told = time.monotonic(), not what
        while not done():
            waited_s = time.monotonic() - start_s
            if waited_s >= timeout_s:
                raise SwarmError(f"waited {timeout_s:g} s for {in_words(what)}")
            if waited_s >= PATIENCE_S and not told:
                note(f"waiting for {in_words(what)}")
                told = True
            self.pump(min(look_every_s, (timeout_s if told else PATIENCE_S) - waited_s))

    def wait_quietly(self, done: Callable[[], bool], timeout_s: float, look_every_s: float = math.inf) -> None:
        """Wait, whatever else goes wrong meanwhile: this is the end anyway."""
        with contextlib.suppress(SwarmError):
            self.wait(done, "", timeout_s, look_every_s)

    def pump(self, timeout_s: float) -> None:
        """Take what is there, or comes within the time.

        Raises
        ------
        Interrupted
            A signal asks for the end.
        SwarmError
            The `failure`, if there is one.
        """
        for item in self.inbox.wait(timeout_s, SETTLE_S):
            if isinstance(item, Interrupt):
                self.interrupted = True
            else:
                self._take(item)
        self._after()
        if self.ending:
            return
        if self.interrupted:
            raise Interrupted
        if self.failure is not None:
            raise self.failure
