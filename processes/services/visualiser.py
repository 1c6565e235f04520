"""The visualiser: `python -m processes.services.visualiser [tcp/HOST:PORT [live]]`, with its orders, a `VizSettings`.

It receives the messages of the mission like the recorder, outside the link model, and publishes scenes for viewers.
With `live_port` it also serves the Foxglove WebSocket protocol; as `live` it does only that.
"""

from __future__ import annotations

import signal
import time
from dataclasses import dataclass
from functools import partial

import msgspec
import zenoh
from msgspec import Struct

from edc_swarm.mission.roles import OPERATOR, VISUALISER
from edc_swarm.protocol.codec import encode
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.keys import Keys
from edc_swarm.protocol.messages import Event, MissionMessage
from edc_swarm.recording.writer import Stamp
from edc_swarm.viz.channels import ROOT
from edc_swarm.viz.scenery import Scenery, Shown
from processes.bus.credentials import credentials
from processes.bus.event_source import EventSource
from processes.bus.operator_presence import OperatorPresence
from processes.bus.outbox import Outbox
from processes.bus.session import ask_for, open_client, subscribe
from processes.bus.subscriptions import Gate, Heard, heard_from
from processes.runtime.clock import MissionClock
from processes.runtime.console import run_main
from processes.runtime.inbox import SETTLE_S, Inbox
from processes.runtime.parent import end_with_parent
from processes.runtime.priority import give_way
from processes.services.live import HOST, Live, Subscribed
from processes.services.orders import orders, outlast_operator

NAME = VISUALISER
VIEW_IDLE_S = 0.25
BURST_BYTES = 32_768
PAUSE_S = 0.004
MESSAGE_COST_BYTES = 512
"""Overhead of a message in memory, besides its bytes."""
KEPT_SCENES_BYTES = 16 << 20
"""Size of the buffer for retransmission: a minute of the scenes of 50 UAVs."""


class VizSettings(Struct, frozen=True, kw_only=True):
    """Settings of the visualiser. `live_port` is 0 for no live view; without `records` there is only the live view."""

    endpoint: str
    mission: str
    live_port: int = 0
    live_host: str = HOST
    records: bool = True
    certs: str = ""
    parent: int = 0
    clock_ahead_ns: int | None = None


@dataclass(frozen=True, slots=True)
class _Received:
    """A payload from the bus with its time of receipt."""

    key: str
    payload: bytes
    time_ns: int


@dataclass(frozen=True, slots=True)
class _StopShowing:
    """The order to end."""


Item = _Received | Subscribed | _StopShowing | zenoh.Query


class SceneStream:
    """Scenes on the bus, each with a sequence number of its topic.

    Attributes
    ----------
    last
        Sequence number of the newest scene, by key.
    """

    def __init__(self, outbox: Outbox, root: str, instance: str) -> None:
        self._outbox = outbox
        self._root = root
        self._instance = instance
        self._unsent_bytes = 0
        self.last: dict[str, int] = {}

    def put(self, shown: Shown) -> None:
        """Publish a scene."""
        key = f"viz/{shown.topic.removeprefix(ROOT)}"
        seq = self.last[key] = self.last.get(key, -1) + 1
        stamp = msgspec.json.encode(Stamp(self._instance, seq, shown.time_ns))
        self._outbox.put(f"{self._root}/{key}", shown.payload, seq, stamp)
        self._outbox.flush()
        self._pause(len(shown.payload))

    def _pause(self, size_bytes: int) -> None:
        """Wait until the bus has taken a scene, since it drops large messages that come too fast."""
        self._unsent_bytes += size_bytes + MESSAGE_COST_BYTES
        if self._unsent_bytes >= BURST_BYTES:
            self._unsent_bytes = 0
            time.sleep(PAUSE_S)


class Visualiser:
    """The visualiser of one mission."""

    def __init__(self, settings: VizSettings) -> None:
        self._keys = Keys(settings.mission)
        self._clock = MissionClock(settings.clock_ahead_ns)
        self._inbox: Inbox[Item] = Inbox()
        self._scenery = Scenery()
        self._events = EventSource(NAME, self._clock)
        self._gate = Gate(partial(self._tell, EventKind.MALFORMED))
        self._over = False
        self._live = None
        if settings.live_port:
            self._live = Live(settings.live_host, settings.live_port, self._inbox.put_always)
        give_way()  # Before Zenoh's threads begin, which inherit it.
        self._session = open_client(settings.endpoint, credentials(settings.certs, NAME), observer=True)
        keys = self._keys
        self._outbox = Outbox(self._session, keys.again(NAME, self._events.instance), self._inbox, KEPT_SCENES_BYTES)
        self._scenes = SceneStream(self._outbox, keys.root, self._events.instance) if settings.records else None
        for key in (keys.mission, f"{keys.root}/uav/**", f"{keys.root}/head/**", keys.event("*")):
            subscribe(self._session, key, self._take)
        ask_for(self._session, keys.mission, self._take)
        if settings.records:
            self._token = self._session.liveliness().declare_token(keys.alive(NAME, self._events.instance))
        self._mission = settings.mission
        self._operators = None if settings.parent else OperatorPresence(self._session)

    def stop(self) -> None:
        """Request the end; may be called from a signal handler."""
        self._inbox.put_always(_StopShowing())

    def show(self) -> None:
        """Publish scenes until the operator ends the mission, then a `closed` event."""
        while not self._over:
            for item in self._inbox.wait(self._patience_s(), SETTLE_S):
                self._take_item(item)
            self._publish(self._scenery.advance(self._clock.now_ns()))
            if (jump := self._clock.jump()) is not None:
                self._tell(EventKind.CLOCK_JUMP, jump)
            self._outbox.flush()
            self._over |= self._operators is not None and self._operators.is_lost(self._mission)
        self._close()

    def _patience_s(self) -> float:
        due_ns = self._scenery.next_ns
        return VIEW_IDLE_S if due_ns is None else min(VIEW_IDLE_S, max(0.0, (due_ns - self._clock.now_ns()) / 1e9))

    def _take_item(self, item: Item) -> None:
        match item:
            case _StopShowing():
                self._over = True
            case Subscribed() if self._live is not None:
                self._live.repeat(item)
            case zenoh.Query():
                if self._outbox.hear(item):
                    self._outbox.answer()
            case _Received(key, payload, time_ns):
                self._publish(self._scenery.advance(time_ns))
                self._hear(key, payload, time_ns)

    def _hear(self, key: str, payload: bytes, time_ns: int) -> None:
        message = self._gate.admit(Heard(key, payload))
        if message is None:
            return
        if isinstance(message, MissionMessage):
            self._gate.know(message)
        self._scenery.hear(message, time_ns)
        if isinstance(message, Event) and message.source == OPERATOR and message.kind == EventKind.END:
            self._over = True

    def _publish(self, shown: list[Shown]) -> None:
        for each in shown:
            if self._scenes is not None:
                self._scenes.put(each)
            if self._live is not None:
                self._live.show(each)

    def _close(self) -> None:
        """Publish the number of scenes of each topic in a `closed` event, since scenes carry no sequence numbers."""
        self._publish(self._scenery.advance(self._clock.now_ns()))
        self._tell(EventKind.CLOSED, msgspec.json.encode(self._scenes.last if self._scenes else {}).decode())
        self._outbox.flush()
        self._outbox.stay(self._inbox)
        self._session.close()
        if self._live is not None:
            self._live.stop()

    def _tell(self, kind: EventKind, detail: str) -> None:
        """Publish an event; a live view only publishes nothing on the bus."""
        if self._scenes is not None:
            event = self._events.event(kind, detail)
            self._outbox.put(self._keys.event(NAME), encode(event), event.seq)

    def _take(self, sample: zenoh.Sample) -> None:
        heard = heard_from(sample)
        self._inbox.put(_Received(heard.key, heard.payload, self._clock.now_ns()), len(heard.payload))


def main() -> int:
    """Run the visualiser for one mission, and return the exit status."""

    settings = orders(VizSettings, NAME)
    if settings.parent:
        end_with_parent(settings.parent)
    visualiser = Visualiser(settings)
    signal.signal(signal.SIGTERM, lambda *_: visualiser.stop())
    visualiser.show()
    if not settings.parent:
        outlast_operator(settings.endpoint, settings.mission, credentials(settings.certs, NAME))
    return 0


if __name__ == "__main__":
    run_main(main)
