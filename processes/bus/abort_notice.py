"""The abort notice of an operator that ends before it has a mission, so that no part waits for a mission.

A bad option ends `run --operate` before it is on the bus. The command then holds a token at the router for two
seconds. A router for one mission (`processes.services.router`) without an operator so far passes the notice on to
the waiting parts. All other parts ignore it: the user may start the operator again, and it may still take over.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Sequence

from edc_swarm.errors import InputError
from edc_swarm.mission.roles import OPERATOR
from edc_swarm.protocol.keys import PREFIX
from processes.bus.address import parse_endpoint
from processes.bus.credentials import TLS, credentials
from processes.runtime.console import BAD_INPUT
from processes.runtime.loop import LOOK_EVERY_S

OPTION = "--operate"
NOTICE_KEY = f"{PREFIX}/-/alive/giving-up"
CONNECT_TIMEOUT_S = 5.0
"""Longest wait for a router, which may still be starting."""
HOLD_S = 2.0
"""Time for which the command holds its token: a router that has just begun to listen sees tokens a moment later."""


def send_abort_notice(arguments: Sequence[str]) -> None:
    """Hold the token of the notice at the router after `--operate` in the command line, if there is one.

    SIGTERM does not shorten the hold: a router that has just started might never see a shorter one. SIGTERM does not
    change the exit status: compose sends it when another service has ended.
    """
    endpoint = operated_router(arguments)
    if endpoint is None:
        return
    from processes.bus.session import try_client  # noqa: PLC0415  (no other command that fails needs Zenoh)

    signal.signal(signal.SIGTERM, lambda *_: sys.exit(BAD_INPUT))
    own = credentials(word_after("--certs", arguments), OPERATOR)
    end_s = time.monotonic() + CONNECT_TIMEOUT_S
    while (session := try_client(endpoint, own)) is None and time.monotonic() < end_s:
        time.sleep(LOOK_EVERY_S)
    if session is not None:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        token = session.liveliness().declare_token(f"{NOTICE_KEY}/{os.getpid()}")
        time.sleep(HOLD_S)
        token.undeclare()
        session.close()


def operated_router(arguments: Sequence[str]) -> str | None:
    """Return the router after `--operate` in a command line, None without a valid one."""
    endpoint = word_after(OPTION, arguments)
    try:
        parse_endpoint(OPTION, endpoint, "tls" if endpoint.startswith(TLS) else "tcp")
    except InputError:
        return None
    return endpoint


def word_after(option: str, arguments: Sequence[str]) -> str:
    """Return the value of an option in a command line, empty without one."""
    words = [word for argument in arguments for word in argument.split("=", 1)]
    return words[words.index(option) + 1] if option in words[:-1] else ""
