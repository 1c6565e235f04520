"""The Zenoh baseline: latency of plain Zenoh processes with the swarm's fan-in and fan-out, through the same router."""

from __future__ import annotations

import os
import secrets
import struct
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
import zenoh
from msgspec import Struct

from edc_swarm.analysis.metrics import Quantiles
from edc_swarm.errors import SwarmError
from processes.bus.address import connect_endpoint, free_endpoint
from processes.bus.session import hand_over, open_client, put
from processes.experiments.baseline_process import LAST_S, BaselineSettings, RoundTrips
from processes.runtime.children import Child, ChildExited, ChildReady
from processes.runtime.inbox import Inbox

BEGIN_AHEAD_NS = 300_000_000
BASELINE_START_TIMEOUT_S = 60.0
END_TIMEOUT_S = 1.0


class Baseline(Struct, frozen=True):
    """The measured latencies, over all slots and all processes except the collector.

    `put_to_answer_ms` is the time from a put to the sending of its answer, which the collector does when it has all
    puts; it corresponds to `fix_to_command_ms` of the swarm. `round_trip_ms` is the time from a put to the receipt of
    the answer. `lost` is the number of puts without an answer.
    """

    uavs: int
    slots: int
    put_to_answer_ms: Quantiles
    round_trip_ms: Quantiles
    lost: int


def measure_baseline(uavs: int, slot_s: float, slots: int) -> Baseline:
    """Measure the baseline with `uavs` processes over `slots` slots, and end all processes afterwards.

    Raises
    ------
    SwarmError
        A process did not start or sent no results.
    """
    with ExitStack() as stack:
        log = Path(stack.enter_context(tempfile.TemporaryDirectory())) / "baseline.log"
        measurement = _Measurement(log, stack)
        return measurement.measure(uavs, slot_s, slots)


@dataclass(frozen=True, slots=True)
class _Alive:
    """The news that a baseline process listens."""

    index: str


class _Measurement:
    """One measurement: router, processes, and a session that starts them."""

    def __init__(self, log: Path, stack: ExitStack) -> None:
        self._log, self._stack = log, stack
        self._news: Inbox[object] = Inbox()
        self._root = f"floor/{secrets.token_hex(4)}"
        self._endpoint = free_endpoint()

    def measure(self, uavs: int, slot_s: float, slots: int) -> Baseline:
        self._spawn("router", "processes.services.router", [self._endpoint, str(os.getpid())], None)
        self._await({"router"}, lambda news: news.name if isinstance(news, ChildReady) else "")
        session = self._session()
        for index in range(uavs):
            settings = BaselineSettings(
                endpoint=connect_endpoint(self._endpoint),
                root=self._root,
                index=index,
                uavs=uavs,
                slots=slots,
                slot_ns=round(slot_s * 1e9),
                parent=os.getpid(),
            )
            self._spawn(f"bare-{index}", "processes.experiments.baseline_process", [], msgspec.json.encode(settings))
        self._await({str(index) for index in range(uavs)}, lambda news: news.index if isinstance(news, _Alive) else "")
        put(session, f"{self._root}/begin", struct.pack("<q", time.monotonic_ns() + BEGIN_AHEAD_NS))
        return _baseline_of(uavs, slots, self._await_seen(uavs, slots * slot_s + LAST_S))

    def _session(self) -> zenoh.Session:
        session = open_client(connect_endpoint(self._endpoint))
        self._stack.callback(session.close)

        def take(sample: zenoh.Sample) -> None:
            self._news.put(msgspec.json.decode(sample.payload.to_bytes(), type=RoundTrips))

        def take_token(sample: zenoh.Sample) -> None:
            self._news.put(_Alive(str(sample.key_expr).rpartition("/")[2]))

        session.declare_subscriber(f"{self._root}/seen/*", hand_over(take))
        session.liveliness().declare_subscriber(f"{self._root}/alive/*", hand_over(take_token), history=True)
        return session

    def _spawn(self, name: str, module: str, arguments: Sequence[str], orders: bytes | None) -> None:
        child = Child(name, module, arguments, self._log, self._news.put_always, orders=orders)
        self._stack.callback(child.end, END_TIMEOUT_S)

    def _await(self, names: set[str], name_of: Callable[[object], str]) -> None:
        """Wait for news of each of `names`."""
        until_s = time.monotonic() + BASELINE_START_TIMEOUT_S
        while names:
            for news in self._next(until_s):
                names -= {name_of(news)}
                if isinstance(news, ChildExited):
                    raise SwarmError(f"baseline {news.name} ended: {self._log.read_text(errors='replace')[-500:]}")

    def _await_seen(self, uavs: int, within_s: float) -> list[RoundTrips]:
        until_s, seen = time.monotonic() + within_s + BASELINE_START_TIMEOUT_S, list[RoundTrips]()
        while len(seen) < uavs:
            seen += [news for news in self._next(until_s) if isinstance(news, RoundTrips)]
        return seen

    def _next(self, until_s: float) -> list[object]:
        news = self._news.wait(until_s - time.monotonic())
        if not news:
            raise SwarmError(f"the baseline processes sent nothing within {BASELINE_START_TIMEOUT_S:g} s")

        return news


def _baseline_of(uavs: int, slots: int, seen: Sequence[RoundTrips]) -> Baseline:
    answered_ms = [value for trips in seen for value in trips.answered_ms]
    received_ms = [value for trips in seen for value in trips.received_ms]
    lost = (uavs - 1) * slots - len(received_ms)
    return Baseline(uavs, slots, _quantiles(answered_ms), _quantiles(received_ms), lost)


def _quantiles(values: Sequence[float]) -> Quantiles:
    if not values:
        return Quantiles(None, None, None)
    p50, p99 = np.percentile(values, [50, 99])
    return Quantiles(float(p50), float(p99), max(values))
