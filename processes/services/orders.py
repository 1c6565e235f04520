"""The orders (settings) of the recorder and the visualiser, from standard input or from the operator.

===================================================  ===========================================================
Command line                                         Source of the orders
===================================================  ===========================================================
`python -m processes.services.recorder`              standard input, written by the launcher
`... tcp/HOST:PORT`                                  the operator, through the router (for example in compose)
`... tls/HOST:PORT --certs FOLDER`                   the same on a secured bus, with the certificate in FOLDER
===================================================  ===========================================================
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
from processes.runtime.loop import LOOK_EVERY_S, PATIENCE_S, START_TIMEOUT_S, Awaited, in_words

ASK_TIMEOUT_S = 2.0


Kind = TypeVar("Kind", bound=Struct)
Found = TypeVar("Found")


def orders(kind: type[Kind], name: str) -> Kind:
    """Return the orders of the part `name`, or of the part on the command line; `name` is in its certificate."""
    if len(sys.argv) == 1:
        return msgspec.json.decode(sys.stdin.buffer.read(), type=kind)
    arguments = _command_line(name)
    endpoint, own = arguments.endpoint, credentials(arguments.certs, name)
    if own is not None:
        check_certificates(own.folder, [name])
    session = await_found(lambda: try_client(endpoint, own), partial(unreachable_router, endpoint))
    operators = OperatorPresence(session)
    mission = await_found(lambda: operators.only_mission(endpoint), f"a mission at {endpoint}")

    def ask() -> bytes | None:
        operators.check_there(mission)
        return asked(session, Keys(mission).orders(arguments.name))

    payload = await_found(ask, f"orders from the operator of {mission}")
    session.close()
    return msgspec.structs.replace(msgspec.json.decode(payload, type=kind), endpoint=endpoint, certs=arguments.certs)


def _command_line(name: str) -> Namespace:
    """Return the parsed command line of the part `name`."""
    parser = ArgumentParser(description="Run one part of a mission whose operator runs elsewhere.")
    parser.add_argument("endpoint", help="endpoint of the router, tcp/HOST:PORT")
    parser.add_argument("name", nargs="?", default=name, help=f"name of the part whose orders to request ({name})")
    parser.add_argument("--certs", default="", help="folder with the certificate of this part, on a secured bus")
    return parser.parse_args()


def asked(session: zenoh.Session, key: str, payload: bytes | None = None) -> bytes | None:
    """Return the first answer to a query, None if there is none."""
    for reply in session.get(key, payload=payload, timeout=ASK_TIMEOUT_S):
        if reply.ok is not None:
            return reply.ok.payload.to_bytes()
    return None


def await_found(look: Callable[[], Found | None], what: Awaited) -> Found:
    """Call `look` until it returns something; after a while, print `what` the process waits for."""
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
    """Wait until the operator has left, and a moment longer, since compose ends all services with the first one."""
    session = try_client(endpoint, own)
    if session is None:
        return
    operators = OperatorPresence(session)
    while operators.away_s(mission) < LINGER_S:
        time.sleep(LOOK_EVERY_S)
    session.close()
