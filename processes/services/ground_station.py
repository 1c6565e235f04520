"""The bridge to a ground station: `python -m processes.services.ground_station`, with its orders on standard input.

It receives the messages of the mission like the recorder, outside the link model, and shows each UAV as a MAVLink
system. It steers nothing: a request that would steer a UAV is denied, counted, and an event of the record; or, if the
user allowed commands, an event that the operator acts on.
"""

from __future__ import annotations

import signal
import time
from collections import Counter
from dataclasses import dataclass
from functools import partial

import msgspec
import zenoh
from msgspec import Struct

from edc_swarm.ground_station.frames import Request
from edc_swarm.ground_station.view import GroundView
from edc_swarm.mission.roles import GROUND, OPERATOR
from edc_swarm.protocol.codec import encode
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.keys import Keys
from edc_swarm.protocol.messages import Event, MissionMessage
from processes.bus.credentials import credentials
from processes.bus.event_source import EventSource
from processes.bus.outbox import Outbox
from processes.bus.session import ask_for, open_client, subscribe
from processes.bus.subscriptions import Gate, Heard, heard_from
from processes.runtime.clock import MissionClock
from processes.runtime.console import run_main
from processes.runtime.inbox import SETTLE_S, Inbox
from processes.runtime.parent import end_with_parent
from processes.services.mavlink_link import MavlinkLink
from processes.services.orders import orders

NAME = GROUND
BRIDGE_IDLE_S = 0.25
TELL_DENIED_S = 1.0
"""Least time between two events on what was denied: a flood of requests is no flood of events."""
KEPT_EVENTS_BYTES = 1 << 20
"""Size of the buffer for retransmission of events."""


class GroundSettings(Struct, frozen=True, kw_only=True):
    """Settings of the bridge: the bus, the mission, and the address of the ground station."""

    endpoint: str
    mission: str
    host: str
    port: int
    permitted: bool = False
    certs: str = ""
    parent: int = 0
    clock_ahead_ns: int | None = None


@dataclass(frozen=True, slots=True)
class _Stop:
    """The order to end."""


Item = Heard | Request | _Stop | zenoh.Query


class GroundStation:
    """The bridge of one mission."""

    def __init__(self, settings: GroundSettings) -> None:
        self._keys = keys = Keys(settings.mission)
        self._clock = MissionClock(settings.clock_ahead_ns)
        self._inbox: Inbox[Item] = Inbox()
        self._view = GroundView(permitted=settings.permitted)
        self._said_denied = 0
        self._tell_denied_s = 0.0
        self._events = EventSource(NAME, self._clock)
        self._gate = Gate(partial(self._tell, EventKind.MALFORMED))
        self._over = False
        self._link = MavlinkLink(settings.host, settings.port)
        self._session = open_client(settings.endpoint, credentials(settings.certs, NAME), observer=True)
        self._outbox = Outbox(self._session, keys.again(NAME, self._events.instance), self._inbox, KEPT_EVENTS_BYTES)
        for key in (keys.mission, keys.all_fixes, keys.event("*")):
            subscribe(self._session, key, self._take)
        ask_for(self._session, keys.mission, self._take)
        self._token = self._session.liveliness().declare_token(keys.alive(NAME, self._events.instance))
        self._link.listen(self._inbox.put)

    def stop(self) -> None:
        """Request the end; may be called from a signal handler."""
        self._inbox.put_always(_Stop())

    def show(self) -> None:
        """Show the mission until the operator ends it, then publish a `closed` event."""
        while not self._over:
            for item in self._inbox.wait(BRIDGE_IDLE_S, SETTLE_S):
                self._take_item(item)
            self._link.send(self._view.advance(self._clock.now_ns()))
            for order in self._view.take_orders():
                self._tell(EventKind.GROUND_COMMAND, msgspec.json.encode(order).decode())
            if time.monotonic() >= self._tell_denied_s:
                self._tell_denied()
            if (jump := self._clock.jump()) is not None:
                self._tell(EventKind.CLOCK_JUMP, jump)
            self._outbox.flush()
        self._close()

    def _take_item(self, item: Item) -> None:
        match item:
            case _Stop():
                self._over = True
            case Request():
                self._link.send(self._view.answer(item))
            case zenoh.Query():
                if self._outbox.hear(item):
                    self._outbox.answer()
            case Heard():
                self._hear(item)

    def _hear(self, heard: Heard) -> None:
        message = self._gate.admit(heard)
        if message is None:
            return
        if isinstance(message, MissionMessage):
            self._gate.know(message)
        self._link.send(self._view.hear(message, self._clock.now_ns()))
        if isinstance(message, Event) and message.source == OPERATOR and message.kind == EventKind.END:
            self._over = True

    def _tell_denied(self, ignored: Counter[str] | None = None) -> None:
        """Publish what was denied, dropped or, in the end, ignored, if there is more of it than in the last event."""
        denied = self._view.denied + self._link.dropped + (ignored or Counter())
        if denied.total() > self._said_denied:
            self._said_denied, self._tell_denied_s = denied.total(), time.monotonic() + TELL_DENIED_S
            self._tell(EventKind.GROUND_DENIED, ", ".join(f"{kind}: {n}" for kind, n in sorted(denied.items())))

    def _close(self) -> None:
        self._tell_denied(self._view.ignored)
        self._tell(EventKind.CLOSED, "{}")
        self._outbox.flush()
        self._outbox.stay(self._inbox)
        self._session.close()
        self._link.close()

    def _tell(self, kind: EventKind, detail: str) -> None:
        event = self._events.event(kind, detail)
        self._outbox.put(self._keys.event(NAME), encode(event), event.seq)

    def _take(self, sample: zenoh.Sample) -> None:
        heard = heard_from(sample)
        self._inbox.put(heard, len(heard.payload))


def main() -> int:
    """Run the bridge for one mission, and return the exit status."""
    settings = orders(GroundSettings, NAME)
    end_with_parent(settings.parent)
    station = GroundStation(settings)
    signal.signal(signal.SIGTERM, lambda *_: station.stop())
    station.show()
    return 0


if __name__ == "__main__":
    run_main(main)
