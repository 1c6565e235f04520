"""What the recorder and the visualiser are to do: told on standard input, or by the operator at a router.

`python -m processes.recorder` reads its orders, `python -m processes.recorder tcp/HOST:PORT` asks for
them: a part that nobody has launched, such as a service of `compose.yaml`.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Protocol, TypeVar

import msgspec
import zenoh
from msgspec import Struct

from edc_swarm.errors import SwarmError
from edc_swarm.messages import Keys
from processes.bus import open_client, try_client
from processes.console import note
from processes.loop import START_TIMEOUT_S
from processes.operators import LINGER_S, Operators

LOOK_EVERY_S = 0.1
ASK_TIMEOUT_S = 2.0


class Orders(Protocol):
    """Orders that name the mission and how to get there."""

    endpoint: str
    mission: str


Kind = TypeVar("Kind", bound=Struct)
Found = TypeVar("Found")


def orders(kind: type[Kind], name: str) -> Kind:
    """The orders of the part `name`, or of the part that the command line names."""
    if len(sys.argv) == 1:
        return msgspec.json.decode(sys.stdin.buffer.read(), type=kind)
    endpoint = sys.argv[1]
    name = sys.argv[2] if len(sys.argv) > 2 else name
    note(f"{name}: waiting for a mission at {endpoint}")
    session = await_found(lambda: try_client(endpoint))
    operators = Operators(session)
    mission = await_found(lambda: operators.only_mission(endpoint))
    payload = await_found(lambda: asked(session, Keys(mission).orders(name)))
    session.close()
    return msgspec.structs.replace(msgspec.json.decode(payload, type=kind), endpoint=endpoint)


def asked(session: zenoh.Session, key: str, payload: bytes | None = None) -> bytes | None:
    """The first answer to a query, None when nobody answers."""
    for reply in session.get(key, payload=payload, timeout=ASK_TIMEOUT_S):
        if reply.ok is not None:
            return reply.ok.payload.to_bytes()
    return None


def await_found(look: Callable[[], Found | None]) -> Found:
    """Look again and again until there is something."""
    end_s = time.monotonic() + START_TIMEOUT_S
    while time.monotonic() < end_s:
        if (found := look()) is not None:
            return found
        time.sleep(LOOK_EVERY_S)
    raise SwarmError(f"waited {START_TIMEOUT_S:g} s for a mission")


def outlast_operator(endpoint: str, mission: str) -> None:
    """Stay until the operator has gone, and a moment longer: services are ended with the first that leaves."""
    session = open_client(endpoint)
    operators = Operators(session)
    while operators.away_s(mission) < LINGER_S:
        time.sleep(LOOK_EVERY_S)
    session.close()
