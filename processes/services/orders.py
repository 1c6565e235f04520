"""What the recorder and the visualiser are to do: told on standard input, or by the operator at a router.

`python -m processes.services.recorder` reads its orders, `python -m processes.services.recorder tcp/HOST:PORT` asks for
them: a part that nobody has launched, such as a service of `compose.yaml`. On a secured bus it is told where its
certificate is, `tls/HOST:PORT --certs FOLDER`.
"""

from __future__ import annotations

import sys
import time
from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from functools import partial
from typing import TypeVar

import msgspec
import zenoh
from msgspec import Struct

from edc_swarm.errors import SwarmError
from edc_swarm.protocol.keys import Keys
from processes.bus.address import unreachable_router
from processes.bus.credentials import Credentials, check_certificates, credentials
from processes.bus.operator_presence import LINGER_S, OperatorPresence
from processes.bus.session import try_client
from processes.runtime.console import note
from processes.runtime.loop import PATIENCE_S, START_TIMEOUT_S, Awaited, in_words

LOOK_EVERY_S = 0.1
ASK_TIMEOUT_S = 2.0


Kind = TypeVar("Kind", bound=Struct)
Found = TypeVar("Found")


def orders(kind: type[Kind], name: str) -> Kind:
    """The orders of the part `name`, or of the part that the command line names; `name` is in its certificate."""
    if len(sys.argv) == 1:
        return msgspec.json.decode(sys.stdin.buffer.read(), type=kind)
    told = _told(name)
    endpoint, own = told.endpoint, credentials(told.certs, name)
    if own is not None:
        check_certificates(own.folder, [name])
    session = await_found(lambda: try_client(endpoint, own), partial(unreachable_router, endpoint))
    operators = OperatorPresence(session)
    mission = await_found(lambda: operators.only_mission(endpoint), f"a mission at {endpoint}")

    def ask() -> bytes | None:
        operators.check_there(mission)
        return asked(session, Keys(mission).orders(told.name))

    payload = await_found(ask, f"orders from the operator of {mission}")
    session.close()
    return msgspec.structs.replace(msgspec.json.decode(payload, type=kind), endpoint=endpoint, certs=told.certs)


def _told(name: str) -> Namespace:
    """What the command line says."""
    parser = ArgumentParser(description="A part of a mission that an operator somewhere runs.")
    parser.add_argument("endpoint", help="the router, tcp/HOST:PORT")
    parser.add_argument("name", nargs="?", default=name, help=f"whose orders to ask for ({name})")
    parser.add_argument("--certs", default="", help="folder with the own certificate, on a secured bus")
    return parser.parse_args()


def asked(session: zenoh.Session, key: str, payload: bytes | None = None) -> bytes | None:
    """The first answer to a query, None when nobody answers."""
    for reply in session.get(key, payload=payload, timeout=ASK_TIMEOUT_S):
        if reply.ok is not None:
            return reply.ok.payload.to_bytes()
    return None


def await_found(look: Callable[[], Found | None], what: Awaited) -> Found:
    """Look again and again until there is something; after a while the user is told `what` is waited for."""
    start_s, told = time.monotonic(), False
    while (found := look()) is None:
        waited_s = time.monotonic() - start_s
        if waited_s > START_TIMEOUT_S:
            raise SwarmError(f"waited {START_TIMEOUT_S:g} s for {in_words(what)}")
        if waited_s > PATIENCE_S and not told:
            note(f"waiting for {in_words(what)}")
            told = True
        time.sleep(LOOK_EVERY_S)
    return found


def outlast_operator(endpoint: str, mission: str, own: Credentials | None = None) -> None:
    """Stay until the operator has gone, and a moment longer: services are ended with the first that leaves."""
    session = try_client(endpoint, own)
    if session is None:
        return
    operators = OperatorPresence(session)
    while operators.away_s(mission) < LINGER_S:
        time.sleep(LOOK_EVERY_S)
    session.close()
