"""One Zenoh process of the baseline, which transports messages and does nothing else.

`python -m processes.experiments.baseline_process`, with `BaselineSettings` on standard input.

In each slot the K processes repeat the traffic of the swarm: at the start of the slot each one puts as many bytes as
a fix has. The collector waits for the puts of all others and answers each with as many bytes as a command has.
"""

from __future__ import annotations

import os
import signal
import struct
import sys
import time
from dataclasses import dataclass

import msgspec
import zenoh
from msgspec import Struct

from processes.bus.session import open_client, put, subscribe
from processes.runtime.inbox import Inbox
from processes.runtime.parent import end_with_parent

FIX_BYTES, COMMAND_BYTES = 620, 380
"""Sizes of a fix and of a command."""
COLLECTOR = 0
STAMP = struct.Struct("<qqqq")
"""Slot, index of the process, time of the put, time of the answer (0: none)."""
LAST_S = 1.0
"""Time after the last slot after which an answer counts as lost."""


class BaselineSettings(Struct, frozen=True, kw_only=True):
    """Settings of a baseline process."""

    endpoint: str
    root: str
    index: int
    uavs: int
    slots: int
    slot_ns: int
    parent: int


class RoundTrips(Struct, frozen=True):
    """Times that one process measured per answered slot: from put to answer sent, and to answer received."""

    answered_ms: list[float]
    received_ms: list[float]


@dataclass(frozen=True, slots=True)
class _Received:
    """Bytes from the bus with their time of receipt."""

    payload: bytes
    time_ns: int


class BaselineProcess:
    """One of K processes; the one with index `COLLECTOR` collects and answers."""

    def __init__(self, settings: BaselineSettings) -> None:
        self._settings = settings
        self._inbox: Inbox[_Received] = Inbox()
        self._begin: Inbox[_Received] = Inbox()
        self._trips = RoundTrips([], [])
        self._collected: dict[int, list[tuple[int, int]]] = {}
        self._session = open_client(settings.endpoint)
        self._subscribe("begin", self._begin)
        collects = settings.index == COLLECTOR
        self._subscribe("put/*" if collects else f"answer/{settings.index}", self._inbox)
        self._token = self._session.liveliness().declare_token(self._key(f"alive/{settings.index}"))

    def _subscribe(self, key: str, inbox: Inbox[_Received]) -> None:
        def take(sample: zenoh.Sample) -> None:
            inbox.put(_Received(sample.payload.to_bytes(), time.monotonic_ns()))

        subscribe(self._session, self._key(key), take)

    def _key(self, key: str) -> str:
        return f"{self._settings.root}/{key}"

    def run(self) -> None:
        """Wait for the start, take part in every slot, and publish the measured times."""
        settings = self._settings
        (begin, *_) = self._begin.wait(None)
        (begin_ns,) = struct.unpack("<q", begin.payload)
        for slot in range(settings.slots):
            self._until(begin_ns + slot * settings.slot_ns)
            stamp = STAMP.pack(slot, settings.index, time.monotonic_ns(), 0)
            put(self._session, self._key(f"put/{settings.index}"), stamp.ljust(FIX_BYTES, b" "))
        self._until(begin_ns + settings.slots * settings.slot_ns + round(LAST_S * 1e9))
        put(self._session, self._key(f"seen/{settings.index}"), msgspec.json.encode(self._trips))

    def close(self) -> None:
        """Close the session."""
        self._session.close()

    def _until(self, when_ns: int) -> None:
        while (left_ns := when_ns - time.monotonic_ns()) > 0:
            for come in self._inbox.wait(left_ns / 1e9):
                self._take(come)

    def _take(self, come: _Received) -> None:
        slot, index, put_ns, answered_ns = STAMP.unpack(come.payload[: STAMP.size])
        if self._settings.index == COLLECTOR:
            self._collect(slot, index, put_ns)
        else:
            self._trips.answered_ms.append((answered_ns - put_ns) / 1e6)
            self._trips.received_ms.append((come.time_ns - put_ns) / 1e6)

    def _collect(self, slot: int, index: int, put_ns: int) -> None:
        collected = self._collected.setdefault(slot, [])
        collected.append((index, put_ns))
        if len(collected) < self._settings.uavs - 1:
            return
        for to, its_ns in self._collected.pop(slot):
            stamp = STAMP.pack(slot, to, its_ns, time.monotonic_ns())
            put(self._session, self._key(f"answer/{to}"), stamp.ljust(COMMAND_BYTES, b" "))


def main() -> int:
    """Take part in one measurement until SIGTERM. The liveliness token, declared last, shows that it listens."""
    settings = msgspec.json.decode(sys.stdin.buffer.read(), type=BaselineSettings)
    end_with_parent(settings.parent)
    signal.signal(signal.SIGTERM, lambda *_: os._exit(0))
    bare = BaselineProcess(settings)
    bare.run()
    bare.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
