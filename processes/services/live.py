"""The live view: a server of the visualiser's scenes with the Foxglove WebSocket protocol.

foxglove-sdk is optional (`pip install edc-swarm[live]`); only this module imports it, and only for `--live`.
"""

from __future__ import annotations

import contextlib
import socket
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from edc_swarm.errors import InputError
from edc_swarm.extras import has_package, install_command
from edc_swarm.viz.channels import channel_of
from edc_swarm.viz.scenery import Shown

HOST = "127.0.0.1"
ANY_HOST = "0.0.0.0"
PORT = 8765
"""Default port of viewers."""
LOG_TOPIC = "/viz/log"
MAX_LOG = 200
"""Most lines of the log that a new viewer receives."""


@dataclass(frozen=True, slots=True)
class Subscribed:
    """The news that a viewer has subscribed to a topic; `viewer` is its number at the server."""

    topic: str
    viewer: int


def live_port() -> int:
    """Return the port to serve on: `PORT`, or a free one if that is in use.

    Raises
    ------
    InputError
        The live view is not installed.
    """
    if not has_package("foxglove"):
        raise InputError("--live", True, f"absent, or foxglove-sdk installed: {install_command('live')}")
    for port in (PORT, 0):
        with contextlib.suppress(OSError), socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((HOST, port))
            return int(probe.getsockname()[1])
    raise InputError("--live", True, "absent: this host has no free port")


class Live:
    """A server of scenes. The caller answers a new subscriber with the topic's last message: `repeat`."""

    def __init__(self, host: str, port: int, tell: Callable[[Subscribed], None]) -> None:
        import foxglove  # noqa: PLC0415  (optional)
        from foxglove.websocket import ServerListener  # noqa: PLC0415

        class Listener(ServerListener):
            """Callbacks of the server's threads, which only queue news."""

            def on_subscribe(self, client: Any, channel: Any) -> None:
                tell(Subscribed(channel.topic, client.id))

        self._foxglove = foxglove
        self._context = foxglove.Context()
        self._channels: dict[str, Any] = {}
        self._last: dict[str, Shown] = {}
        self._log: deque[Shown] = deque(maxlen=MAX_LOG)
        foxglove.set_log_level("CRITICAL")  # It calls every viewer that disconnects a WebSocket protocol error.
        # A viewer subscribes to what is advertised when it connects: an event may be a long time off.
        self._advertise(LOG_TOPIC)
        self._server = foxglove.start_server(
            name="edc-swarm", host=host, port=port, context=self._context, server_listener=Listener()
        )

    def show(self, shown: Shown) -> None:
        """Send a scene to all subscribers of its topic."""
        self._last[shown.topic] = shown
        if shown.topic == LOG_TOPIC:
            self._log.append(shown)
        self._send(shown)

    def repeat(self, subscribed: Subscribed) -> None:
        """Send the last message of a topic to its new subscriber, of the log all lines that are kept.

        No other viewer receives them: a line of the log would be there twice.
        """
        topic = subscribed.topic
        again = self._log if topic == LOG_TOPIC else [self._last[topic]] if topic in self._last else []
        for shown in again:
            self._send(shown, to=subscribed.viewer)

    def stop(self) -> None:
        """Disconnect all viewers."""
        self._server.stop()

    def _send(self, shown: Shown, to: int | None = None) -> None:
        """Send a scene to one viewer, or to all; the server makes each a sink that has the viewer's number."""
        channel = self._channels.get(shown.topic) or self._advertise(shown.topic)
        channel.log(shown.payload, log_time=shown.time_ns, sink_id=to)

    def _advertise(self, topic: str) -> Any:
        described = channel_of(topic)
        assert described is not None
        schema = self._foxglove.Schema(
            name=described.schema_name, encoding=described.schema_encoding, data=described.schema_data
        )
        channel = self._channels[topic] = self._foxglove.Channel(
            topic, message_encoding=described.encoding, schema=schema, context=self._context
        )
        return channel
