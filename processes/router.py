"""The router: `python -m processes.router tcp/HOST:PORT`. Says `ready` when it listens."""

from __future__ import annotations

import signal
import sys
from pathlib import Path

import msgspec
import zenoh
from msgspec import Struct

from edc_swarm.config import ROUTER
from processes.access import access_control
from processes.bus import open_router
from processes.credentials import credentials
from processes.parent import die_with_parent


class RouterAccess(Struct, frozen=True, kw_only=True):
    """Who may connect to a secured bus and for what: a file that the router reads."""

    certs: str
    mission: str
    uavs: list[str]


def open_secured(endpoint: str, file: Path) -> zenoh.Session:
    """The router of a secured bus, whose rules follow from the roster in `file`."""
    access = msgspec.json.decode(file.read_bytes(), type=RouterAccess)
    rules = access_control(access.mission, access.uavs)
    return open_router(endpoint, credentials(access.certs, ROUTER), rules)


def main() -> int:
    """Route until SIGTERM.

    The second argument, when given, is the parent to die with (0 for none), the third the file of a
    `RouterAccess`.
    """
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM, signal.SIGINT})
    parent = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    if parent:
        die_with_parent(parent)
    try:
        session = open_secured(sys.argv[1], Path(sys.argv[3])) if len(sys.argv) > 3 else open_router(sys.argv[1])
    except (zenoh.ZError, OSError, msgspec.DecodeError) as error:
        print(f"router: {error}", file=sys.stderr)
        return 2
    print("ready", flush=True)
    signal.sigwait({signal.SIGTERM} if parent else {signal.SIGTERM, signal.SIGINT})
    session.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
