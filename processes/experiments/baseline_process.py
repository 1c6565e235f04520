"""One bare Zenoh process of the baseline.

`python -m processes.experiments.baseline_process`, with `BareSettings` on standard input.

It does what the bus does for a slot and nothing else: at the slot's start each of K processes puts as many
bytes as a fix has; one of them collects the puts of all others and answers each with as many bytes as a
command has.
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

from processes.bus.session import hand_over, open_client, put
from processes.runtime.inbox import Inbox
from processes.runtime.parent import die_with_parent

FIX_BYTES, COMMAND_BYTES = 620, 380
"""What a fix and a command take."""
COLLECTOR = 0
STAMP = struct.Struct("<qqqq")
"""Slot, process, when it was put, when it was answered (0: it was not)."""
LAST_S = 1.0
"""Answers later than this after the last slot are lost."""


class BareSettings(Struct, frozen=True, kw_only=True):
    """What a bare process must be told."""

    endpoint: str
    root: str
    index: int
    uavs: int
    slots: int
    slot_ns: int
    parent: int


class RoundTrips(Struct, frozen=True):
    """What one process has seen: per answered slot, from put to answer sent and to answer received."""

    answered_ms: list[float]
    received_ms: list[float]


@dataclass(frozen=True, slots=True)
class _Come:
    """Bytes from the bus and when they came."""

    payload: bytes
    time_ns: int


class Bare:
    """One of K processes; `COLLECTOR` collects and answers."""

    def __init__(self, settings: BareSettings) -> None:
        self._settings = settings
        self._inbox: Inbox[_Come] = Inbox()
        self._begin: Inbox[_Come] = Inbox()
        self._trips = RoundTrips([], [])
        self._collected: dict[int, list[tuple[int, int]]] = {}
        self._session = open_client(settings.endpoint)
        self._subscribe("begin", self._begin)
        collects = settings.index == COLLECTOR
        self._subscribe("put/*" if collects else f"answer/{settings.index}", self._inbox)
        self._token = self._session.liveliness().declare_token(self._key(f"alive/{settings.index}"))

    def _subscribe(self, key: str, inbox: Inbox[_Come]) -> None:
        def take(sample: zenoh.Sample) -> None:
            inbox.put(_Come(sample.payload.to_bytes(), time.monotonic_ns()))

        self._session.declare_subscriber(self._key(key), hand_over(take), allowed_origin=zenoh.Locality.REMOTE)

    def _key(self, key: str) -> str:
        return f"{self._settings.root}/{key}"

    def run(self) -> None:
        """Wait for the beginning, take part in every slot, say what was seen."""
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
        """Leave the bus."""
        self._session.close()

    def _until(self, when_ns: int) -> None:
        while (left_ns := when_ns - time.monotonic_ns()) > 0:
            for come in self._inbox.wait(left_ns / 1e9):
                self._take(come)

    def _take(self, come: _Come) -> None:
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
    """Take part in one measurement; its token, declared last, says that it listens. Ends with SIGTERM."""
    settings = msgspec.json.decode(sys.stdin.buffer.read(), type=BareSettings)
    die_with_parent(settings.parent)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda *_: os._exit(0))
    bare = Bare(settings)
    bare.run()
    bare.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
