"""The word of an operator that ends before it has a mission, so that nobody waits for it in vain.

A bad option ends `run --operate` before it is on the bus. It then leaves a token at the router for two seconds;
a router for one mission (`processes.services.router`) that has had no operator passes it on to whoever waits. All
others pay no heed: an operator that is tried again may still take over.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Sequence

from edc_swarm.errors import InputError
from edc_swarm.mission.configuration import OPERATOR
from edc_swarm.protocol.keys import PREFIX
from processes.bus.address import parse_endpoint
from processes.bus.credentials import TLS, credentials
from processes.runtime.console import BAD_INPUT

OPTION = "--operate"
WORD = f"{PREFIX}/-/alive/giving-up"
TRY_FOR_S = 5.0
"""The router may be starting as well."""
LOOK_EVERY_S = 0.1
HOLD_S = 2.0
"""A router that has just begun to listen sees tokens a moment later."""


def give_up(arguments: Sequence[str]) -> None:
    """Leave word at the router that the command line names, if it names one to operate at.

    Told to stop while it holds its token, it holds it to the end, or a router that has just started might never see
    it; and whenever it is told to stop, as by compose when somebody else has left, its status stays what it was.
    """
    endpoint = _router(arguments)
    if endpoint is None:
        return
    from processes.bus.session import try_client  # noqa: PLC0415  (no other command that fails needs Zenoh)

    signal.signal(signal.SIGTERM, lambda *_: sys.exit(BAD_INPUT))
    own = credentials(_word_after("--certs", arguments), OPERATOR)
    end_s = time.monotonic() + TRY_FOR_S
    while (session := try_client(endpoint, own)) is None and time.monotonic() < end_s:
        time.sleep(LOOK_EVERY_S)
    if session is not None:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        token = session.liveliness().declare_token(f"{WORD}/{os.getpid()}")
        time.sleep(HOLD_S)
        token.undeclare()
        session.close()


def _router(arguments: Sequence[str]) -> str | None:
    endpoint = _word_after(OPTION, arguments)
    try:
        parse_endpoint(OPTION, endpoint, "tls" if endpoint.startswith(TLS) else "tcp")
    except InputError:
        return None
    return endpoint


def _word_after(option: str, arguments: Sequence[str]) -> str:
    words = [word for argument in arguments for word in argument.split("=", 1)]
    return words[words.index(option) + 1] if option in words[:-1] else ""
