"""Events of one process, numbered: operator, recorder and visualiser make theirs alike."""

from __future__ import annotations

import os
import secrets

from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.messages import Event
from processes.runtime.clock import MissionClock


class EventSource:
    """The events of one process, with consecutive sequence numbers.

    Attributes
    ----------
    instance
        Id of this life of the process, which all its messages carry.
    last_seq
        Sequence number of the newest event, -1 before the first one.
    """

    def __init__(self, source: str, clock: MissionClock) -> None:
        self._source = source
        self._clock = clock
        self.instance = f"{os.getpid()}-{secrets.token_hex(4)}"
        self.last_seq = -1

    def event(self, kind: EventKind, detail: str = "", slot: int = -1) -> Event:
        """Return the next event, sent now."""
        self.last_seq += 1
        return Event(
            source=self._source,
            instance=self.instance,
            seq=self.last_seq,
            sent_ns=self._clock.now_ns(),
            slot=slot,
            kind=kind,
            detail=detail,
        )
