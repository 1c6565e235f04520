"""The bus: Zenoh sessions with the settings that were measured to suit a swarm.

The clients form a star around one router, or around that of their host, which is linked to the one of the mission.
Messages are reliable with congestion control DROP, so a slow subscriber never blocks a publisher. `express` is off:
with it 1-5 % of the bursts at a slot's start were lost, and it was no faster. Shared memory is off: it hides a frozen
subscriber. The router accepts many sessions at once. A client reconnects to its router without a time limit.

K processes share few cores, so a client has one Zenoh runtime for all its work, with two threads. Runtimes of their
own for sending, receiving, accepting and the rest took seven threads, and a third more processor time a slot: each
message woke several of them. One thread would not do: Zenoh closes a link whose peer does not answer with ten
seconds of SO_LINGER, which block the thread for that time. The router has as many `rx` workers as links may be cut at
once without blocking all others.
"""

from __future__ import annotations

import ctypes
import json
import os
import sys
import threading
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import zenoh

from edc_swarm.protocol.keys import SESSION_LEASE_MS
from processes.bus.credentials import Credentials

TRY_MS = 1000
RUNTIME = "ZENOH_RUNTIME"
CLIENT_THREADS = (
    "(rx: (worker_threads: 2), tx: (handover: rx), net: (handover: rx), app: (handover: rx), acc: (handover: rx))"
)
ROUTER_THREADS = "(rx: (worker_threads: 64), net: (worker_threads: 1), app: (worker_threads: 1))"
MAX_SESSIONS = 5000
MAX_RECEIVED_BYTES = 16 << 20
"""Largest message; Zenoh disconnects a sender of a larger one. The largest are scenes of thousands of UAVs."""
CONNECT_RETRY = {"period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 2}
OBSERVER_RETRY = {"period_init_ms": 20, "period_max_ms": 20, "period_increase_factor": 1}
"""Retry period of observers: they must be back at a restarted router before the publishers."""
SWITCH_S = 1.0
"""Time after which a waiting thread of a client may take the interpreter from the one that works.

The loop of a process gives it away whenever it waits, and never works for long. With Python's 5 ms Zenoh's threads
may take it from a head a dozen times within one plan, and each time the head waits for a processor again.
"""
OBSERVER_SWITCH_S = 0.005
"""The same for an observer, Python's own value. With a backlog its loop never waits: after a second without a read the
router's buffers were full, and it dropped thousands of messages to an overloaded recorder.
"""
BACKGROUND_TIMEOUT_S = 10.0
"""Time after which Zenoh drops a query at background priority."""

DEEP_QUEUE: dict[str, Any] = {"transport/link/tx/queue/size/data": 16}
"""Batches of 64 kB that may wait for a link, allocated on demand: bursts of large scenes fit in."""
LINKED: dict[str, Any] = {
    "connect/timeout_ms": -1,
    "connect/exit_on_failure": False,
    "connect/retry": CONNECT_RETRY,
}
"""Settings of a router that is linked to another one: it waits for it, and for its return, without a time limit."""
PATIENT: dict[str, Any] = {**DEEP_QUEUE, "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 100_000}
"""Settings of an observer: its messages wait up to 100 ms (in microseconds) before Zenoh drops them."""

Item = TypeVar("Item")


def open_client(
    endpoint: str,
    credentials: Credentials | None = None,
    *,
    timeout_ms: int = -1,
    observer: bool = False,
) -> zenoh.Session:
    """Connect to the router at `endpoint`; wait without a time limit unless `timeout_ms` is given."""
    sys.setswitchinterval(OBSERVER_SWITCH_S if observer else SWITCH_S)
    return _open(
        {
            **(credentials.connecting if credentials is not None else {}),
            "mode": "client",
            "connect/endpoints": [endpoint],
            "connect/timeout_ms": timeout_ms,
            "connect/exit_on_failure": timeout_ms >= 0,
            "connect/retry": OBSERVER_RETRY if observer else CONNECT_RETRY,
            **(PATIENT if observer else {}),
        },
        CLIENT_THREADS,
    )


def try_client(
    endpoint: str, credentials: Credentials | None = None, *, observer: bool = False
) -> zenoh.Session | None:
    """Connect to the router at `endpoint`; return None if it does not answer within a second."""
    try:
        return open_client(endpoint, credentials, timeout_ms=TRY_MS, observer=observer)
    except zenoh.ZError:
        return None


def open_router(
    endpoint: str,
    credentials: Credentials | None = None,
    access: Mapping[str, Any] | None = None,
    *,
    link: str = "",
) -> zenoh.Session:
    """Open the session of a router that listens at `endpoint`; raise `zenoh.ZError` if it cannot listen.

    `access`: the rules of a secured bus, from `processes.services.access_rules.access_control`. `link`: another router,
    to which this one connects whenever it is there.
    """
    return _open(
        {
            **(credentials.listening if credentials is not None else {}),
            **(credentials.connecting if credentials is not None and link else {}),
            **({"access_control": access} if access is not None else {}),
            "mode": "router",
            "listen/endpoints": [endpoint],
            "listen/exit_on_failure": True,
            "transport/unicast/accept_pending": MAX_SESSIONS,
            "transport/unicast/max_sessions": MAX_SESSIONS,
            **({**LINKED, "connect/endpoints": [link]} if link else {}),
            **DEEP_QUEUE,
        },
        ROUTER_THREADS,
    )


def hand_over(take: Callable[[Item], None]) -> zenoh.handlers.Callback[Item]:
    """Return a callback that runs on Zenoh's receiving thread; `take` must only queue the item, never call Zenoh."""

    def take_on_known_thread(item: Item) -> None:
        if threading.get_ident() not in _known_threads:
            _keep_thread_state()
        take(item)

    return zenoh.handlers.Callback(take_on_known_thread, None, indirect=False)  # Zenoh 1.4 needs both.


_known_threads: set[int] = set()
"""Threads of Zenoh that have called Python."""


def _keep_thread_state() -> None:
    """Let Python keep the state of the calling thread, one of Zenoh's few, for its next call.

    Else Python makes a state with a stack of 16 kB for every message, and frees it after the call: half of the
    processor time that a message takes a receiver of hundreds. An `Ensure` without its `Release` keeps it.
    """
    _known_threads.add(threading.get_ident())
    ctypes.pythonapi.PyGILState_Ensure()


def subscribe(session: zenoh.Session, key: str, take: Callable[[zenoh.Sample], None]) -> zenoh.Subscriber[None]:
    """Subscribe to what other processes publish on a key; `take` must only queue the sample."""
    return session.declare_subscriber(key, hand_over(take), allowed_origin=zenoh.Locality.REMOTE)


def ask_for(session: zenoh.Session, key: str, take: Callable[[zenoh.Sample], None]) -> None:
    """Query what a process that joins late has missed on a key; `take` must only queue the sample."""

    def take_reply(reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            take(reply.ok)

    session.get(key, hand_over(take_reply), consolidation=zenoh.ConsolidationMode.NONE)


def put(session: zenoh.Session, key: str, payload: bytes, attachment: bytes | None = None) -> None:
    """Publish `payload` without blocking."""
    session.put(
        key, payload, congestion_control=zenoh.CongestionControl.DROP, express=False, attachment=attachment or None
    )


def query_in_background(session: zenoh.Session, key: str, payload: bytes, take: Callable[[zenoh.Reply], None]) -> None:
    """Send a query at background priority; its replies have the same priority."""
    session.get(
        key,
        hand_over(take),
        payload=payload,
        consolidation=zenoh.ConsolidationMode.NONE,
        congestion_control=zenoh.CongestionControl.DROP,
        priority=zenoh.Priority.BACKGROUND,
        timeout=BACKGROUND_TIMEOUT_S,
    )


def is_connected(session: zenoh.Session) -> bool:
    """Return True if the session has its router at present."""
    return bool(session.info.routers_zid())


def _open(settings: dict[str, Any], threads: str) -> zenoh.Session:
    """Open a session; the first one of a process sets its number of threads, and leaves its children's alone."""
    shared = {
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/link/tx/lease": SESSION_LEASE_MS,
        "transport/link/rx/max_message_size": MAX_RECEIVED_BYTES,
        "transport/shared_memory/enabled": False,
    }
    config = zenoh.Config()
    for name, value in {**shared, **settings}.items():
        config.insert_json5(name, json.dumps(value))
    if RUNTIME in os.environ:
        return zenoh.open(config)
    os.environ[RUNTIME] = threads
    try:
        return zenoh.open(config)
    finally:
        del os.environ[RUNTIME]
