"""The one loop of a command: messages from the bus, news of children and signals all come through its inbox.

The loop never polls for a child to be ready; it waits for the message that says so.
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
"""Wait after which the loop tells the user the reason for it."""
LOOK_EVERY_S = 0.1
"""Period of looks for a change that comes without a message."""


Awaited = str | Callable[[], str]
"""Words for the thing that a loop waits for, or a function that returns them as of now."""


def in_words(awaited: Awaited) -> str:
    """Return the words for the thing that a loop waits for, as of now."""
    return awaited if isinstance(awaited, str) else awaited()


class Interrupted(Exception):  # noqa: N818  (nothing is wrong)
    """Ctrl-C, SIGTERM or SIGHUP."""


@dataclass(frozen=True, slots=True)
class Interrupt:
    """A signal asks the command to end."""


class Loop:
    """Loop that passes each item of the inbox to `take`, and calls `after` after each batch of items.

    Attributes
    ----------
    failure
        The error that the next `pump` raises, until the command is `ending`.
    """

    def __init__(self, take: Callable[[object], None], after: Callable[[], None] = lambda: None) -> None:
        self._take = take
        self._after = after
        self.inbox: Inbox[object] = Inbox()
        self.interrupted = False
        self.ending = False
        self.failure: SwarmError | None = None

    def obey_signals(self) -> None:
        """Put the signals that end a command into the inbox."""
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, lambda *_: self.inbox.put_always(Interrupt()))

    def wait(
        self,
        done: Callable[[], bool],
        awaited: Awaited,
        timeout_s: float = START_TIMEOUT_S,
        look_every_s: float = math.inf,
    ) -> None:
        """Work until `done`; after `PATIENCE_S` tell the user what is `awaited`.

        `look_every_s`: period of the calls of `done` for a change that comes without a message.
        """
        start_s, noted = time.monotonic(), not awaited
        while not done():
            waited_s = time.monotonic() - start_s
            if waited_s >= timeout_s:
                raise SwarmError(f"waited {timeout_s:g} s for {in_words(awaited)}")
            if waited_s >= PATIENCE_S and not noted:
                note(f"waiting for {in_words(awaited)}")
                noted = True
            self.pump(min(look_every_s, (timeout_s if noted else PATIENCE_S) - waited_s))

    def wait_quietly(self, done: Callable[[], bool], timeout_s: float, look_every_s: float = math.inf) -> None:
        """Work until `done` or `timeout_s` is over; ignore failures, since the command ends anyway."""
        with contextlib.suppress(SwarmError):
            self.wait(done, "", timeout_s, look_every_s)

    def pump(self, timeout_s: float) -> None:
        """Take the items that are there, or that come within `timeout_s`.

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
