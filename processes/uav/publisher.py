"""Publishing of a UAV: it stamps messages with the time of sending, and delays its truth behind other messages."""

from __future__ import annotations

import msgspec

from edc_swarm.protocol.codec import encode
from edc_swarm.protocol.keys import Keys
from edc_swarm.protocol.messages import Message, Truth
from processes.bus.outbox import Outbox
from processes.runtime.clock import MissionClock

TRUTH_DELAY_S = 0.02
"""Silence after which a UAV that hears all fixes publishes its truth, which only the recording needs: a slot starts
with the fixes. Others publish it right behind their fix: one batch on the wire for both, not two."""


class Publisher:
    """Publisher of one UAV's messages through its outbox."""

    def __init__(self, keys: Keys, outbox: Outbox, clock: MissionClock) -> None:
        self._keys = keys
        self._outbox = outbox
        self._clock = clock
        self._delayed_truth: Truth | None = None

    @property
    def delays_truth(self) -> bool:
        """True if a truth waits to be published."""
        return self._delayed_truth is not None

    def publish(self, message: Message) -> None:
        """Publish a message; a truth waits for the next `send_truth`."""
        if isinstance(message, Truth):
            self.send_truth()
            self._delayed_truth = message
        else:
            self._send(message)

    def send_truth(self) -> None:
        """Publish the delayed truth, if there is one."""
        truth, self._delayed_truth = self._delayed_truth, None
        if truth is not None:
            self._send(truth)

    def _send(self, message: Message) -> None:
        stamped = msgspec.structs.replace(message, sent_ns=self._clock.now_ns())
        self._outbox.put(self._keys.of(stamped), encode(stamped), stamped.seq)
