"""The bus: Zenoh sessions with the settings that were measured to suit a swarm.

A star of clients around one router. Reliable and congestion DROP, so a slow subscriber never blocks
a publisher; `express` stays off (with it 1-5 % of the bursts at a slot's start were lost, and it
was no faster); no shared memory (it hides a frozen subscriber); many sessions may be accepted at
once; a client tries for ever to get back to its router.

One worker thread per Zenoh runtime, since K processes share few cores; but Zenoh closes a link whose
peer does not answer with ten seconds of SO_LINGER, which block a worker of `rx` all the while. So a client
has two of them, and the router as many as links may be cut at once without stopping all others.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import zenoh

from processes.bus.credentials import Credentials

LEASE_MS = 1000
TRY_MS = 1000
RUNTIME = "ZENOH_RUNTIME"
CLIENT_RX_WORKERS = 2
ROUTER_RX_WORKERS = 64
MAX_SESSIONS = 5000
MAX_RECEIVED_BYTES = 16 << 20
"""Whoever sends more at once is disconnected; scenes of thousands of UAVs are the largest that is said."""
CONNECT_RETRY = {"period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 2}
OBSERVER_RETRY = {"period_init_ms": 20, "period_max_ms": 20, "period_increase_factor": 1}
"""Who only listens must be back at a restarted router before those who speak."""
ASIDE_TIMEOUT_S = 10.0
"""When Zenoh forgets a question that stands back for all else."""

DEEP_QUEUE: dict[str, Any] = {"transport/link/tx/queue/size/data": 16}
"""Batches of 64 kB that may wait for a link, made when needed: bursts of large scenes fit in."""
PATIENT: dict[str, Any] = {**DEEP_QUEUE, "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 100_000}
"""Nobody waits for observers: what they say rather waits up to 100 ms (in microseconds) than is dropped."""

Item = TypeVar("Item")


def open_client(
    endpoint: str,
    credentials: Credentials | None = None,
    *,
    timeout_ms: int = -1,
    observer: bool = False,
    lease_ms: int = LEASE_MS,
) -> zenoh.Session:
    """Connect to the router at `endpoint`; waits for ever unless `timeout_ms` is given."""
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
        lease_ms,
        CLIENT_RX_WORKERS,
    )


def try_client(
    endpoint: str, credentials: Credentials | None = None, *, observer: bool = False
) -> zenoh.Session | None:
    """Connect to the router at `endpoint`; None when it does not answer within a second."""
    try:
        return open_client(endpoint, credentials, timeout_ms=TRY_MS, observer=observer)
    except zenoh.ZError:
        return None


def open_router(
    endpoint: str,
    credentials: Credentials | None = None,
    access: Mapping[str, Any] | None = None,
    *,
    lease_ms: int = LEASE_MS,
) -> zenoh.Session:
    """Be the router that listens at `endpoint`; raises `zenoh.ZError` when it cannot.

    `access` are the rules of a secured bus, `processes.services.access_rules.access_control`.
    """
    return _open(
        {
            **(credentials.listening if credentials is not None else {}),
            **({"access_control": access} if access is not None else {}),
            "mode": "router",
            "listen/endpoints": [endpoint],
            "listen/exit_on_failure": True,
            "transport/unicast/accept_pending": MAX_SESSIONS,
            "transport/unicast/max_sessions": MAX_SESSIONS,
            **DEEP_QUEUE,
        },
        lease_ms,
        ROUTER_RX_WORKERS,
    )


def hand_over(take: Callable[[Item], None]) -> zenoh.handlers.Callback[Item]:
    """Make a callback that runs where Zenoh receives; it must only hand over, never call Zenoh."""
    return zenoh.handlers.Callback(take, indirect=False)


def put(session: zenoh.Session, key: str, payload: bytes, attachment: bytes | None = None) -> None:
    """Publish `payload`; never blocks."""
    session.put(
        key, payload, congestion_control=zenoh.CongestionControl.DROP, express=False, attachment=attachment or None
    )


def ask_aside(session: zenoh.Session, key: str, payload: bytes, take: Callable[[zenoh.Reply], None]) -> None:
    """Ask in such a way that question and answers, which are sent as the question was, stand back for all else."""
    session.get(
        key,
        hand_over(take),
        payload=payload,
        consolidation=zenoh.ConsolidationMode.NONE,
        congestion_control=zenoh.CongestionControl.DROP,
        priority=zenoh.Priority.BACKGROUND,
        timeout=ASIDE_TIMEOUT_S,
    )


def is_connected(session: zenoh.Session) -> bool:
    """Whether the session has its router just now."""
    return bool(session.info.routers_zid())


def _open(settings: dict[str, Any], lease_ms: int, rx_workers: int) -> zenoh.Session:
    """Open a session; the first one of a process decides on its threads, and not on those of its children."""
    shared = {
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/link/tx/lease": lease_ms,
        "transport/link/rx/max_message_size": MAX_RECEIVED_BYTES,
        "transport/shared_memory/enabled": False,
    }
    config = zenoh.Config()
    for name, value in {**shared, **settings}.items():
        config.insert_json5(name, json.dumps(value))
    workers = f"(rx: (worker_threads: {rx_workers}), net: (worker_threads: 1), app: (worker_threads: 1))"
    if RUNTIME in os.environ:
        return zenoh.open(config)
    os.environ[RUNTIME] = workers
    try:
        return zenoh.open(config)
    finally:
        del os.environ[RUNTIME]
