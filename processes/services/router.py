"""The router: `python -m processes.services.router ENDPOINT [PARENT | mission [ACCESS]] [--link ADDRESS]`.

It prints `ready` when it listens, and routes until SIGTERM. With PARENT it ends with that process. With the word
`mission` it serves one mission, and ends when the operator and all participants have left. If the operator gives up
before it has a mission (`processes.bus.abort_notice`), or no operator comes, the router notifies all processes, and
for a while those that connect later. On a secured bus, ACCESS is the file of a `RouterAccess`, or a folder of
certificates; the latter allows any mission of the UAVs with a certificate there. With `--link` it is the router of one
host, linked to the router at ADDRESS: what nobody asks for there stays on this host. On a secured bus ACCESS is then a
folder with the certificate of that host.
"""

from __future__ import annotations

import signal
import sys
import time
from argparse import ArgumentParser, Namespace
from pathlib import Path

import msgspec
import zenoh
from msgspec import Struct

from edc_swarm.errors import InputError
from edc_swarm.mission.roles import OPERATOR, ROUTER
from edc_swarm.protocol.keys import ALL_ALIVE
from processes.bus.abort_notice import NOTICE_KEY
from processes.bus.credentials import (
    OWN_HOST,
    certified_hosts,
    certified_uavs,
    check_certificates,
    credentials,
    own_host,
)
from processes.bus.operator_presence import GAVE_UP, LINGER_S
from processes.bus.session import MAX_SESSIONS, hand_over, open_router
from processes.runtime.console import FAILED
from processes.runtime.limits import make_room_for_sessions
from processes.runtime.parent import die_with_parent
from processes.runtime.priority import come_first
from processes.services.access_rules import ANY_MISSION, access_control, host_access_control

ONE_MISSION = "mission"
NO_OPERATOR_S = 120.0
"""Longest wait for an operator, in seconds; one that has not come by then was killed before it could give notice."""
LEAVE_S = 2 * LINGER_S
"""Wait after the last process has left, since processes that leave after their operator need a router to close fast."""
NOTICE_S = 30.0
"""Time for which the router notifies processes that start late that there will be no mission, in seconds."""


class RouterAccess(Struct, frozen=True, kw_only=True):
    """The content of the router's access file: mission, UAVs and certificates of a secured bus."""

    certs: str
    mission: str
    uavs: list[str]
    hosts: dict[str, list[str]] = {}


def open_secured(endpoint: str, where: Path) -> zenoh.Session:
    """Open the router of a secured bus, with rules from the roster in a file or from a folder of certificates."""
    if where.is_dir():
        check_certificates(where, [ROUTER])
        uavs, hosts = certified_uavs(str(where)), certified_hosts(where)
        access = RouterAccess(certs=str(where), mission=ANY_MISSION, uavs=uavs, hosts=hosts)
    else:
        access = msgspec.json.decode(where.read_bytes(), type=RouterAccess)
    rules = access_control(access.mission, access.uavs, access.hosts)
    return open_router(endpoint, credentials(access.certs, ROUTER), rules)


def open_linked(endpoint: str, certs: str, link: str) -> zenoh.Session:
    """Open the router of one host, linked to another one; `certs` is "" on an open bus."""
    if not certs:
        return open_router(endpoint, link=link)
    own = own_host(Path(certs))
    if own is None:
        raise InputError("--certs", certs, OWN_HOST)
    return open_router(endpoint, credentials(certs, own[0]), host_access_control(*own), link=link)


def main() -> int:
    """Run the router, and return the exit status."""
    signals = {signal.SIGTERM, signal.SIGINT}
    signal.pthread_sigmask(signal.SIG_BLOCK, signals)
    given = _command_line()
    for_whom = given.for_whom
    if for_whom.isdigit():
        die_with_parent(int(for_whom))
        signals = {signal.SIGTERM}
    else:
        make_room_for_sessions(MAX_SESSIONS)  # The launcher has done so for a router of its own.
    come_first()  # Before Zenoh's threads begin, which inherit it.
    try:
        if given.link:
            session = open_linked(given.endpoint, given.access, given.link)
        elif given.access:
            session = open_secured(given.endpoint, Path(given.access))
        else:
            session = open_router(given.endpoint)
    except (zenoh.ZError, OSError, msgspec.DecodeError, InputError) as error:
        print(f"router: {error}", file=sys.stderr)
        return 2
    print("ready", flush=True)
    status = 0
    if for_whom == ONE_MISSION:
        status = _route_one_mission(session, signals)
    else:
        signal.sigwait(signals)
    session.close()
    return status


def _command_line() -> Namespace:
    parser = ArgumentParser(prog="router")
    parser.add_argument("endpoint")
    parser.add_argument("for_whom", nargs="?", default="")
    parser.add_argument("access", nargs="?", default="")
    parser.add_argument("--link", default="")
    return parser.parse_args()


def _route_one_mission(session: zenoh.Session, signals: set[signal.Signals]) -> int:
    """Wait until an operator has come or given up and all have left, or for a signal; return the exit status."""
    there: set[str] = set()
    operators: set[str] = set()
    words: set[str] = set()
    patience_until_s = time.monotonic() + NO_OPERATOR_S

    def take(sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        (there.add if sample.kind == zenoh.SampleKind.PUT else there.discard)(key)
        if f"/alive/{OPERATOR}/" in key:
            operators.add(key)
        elif key.startswith(NOTICE_KEY):
            words.add(key)

    def is_over() -> bool:
        return not there and bool(operators or words or time.monotonic() > patience_until_s)

    def is_stopped(within_s: float) -> bool:
        return signal.sigtimedwait(signals, within_s) is not None

    session.liveliness().declare_subscriber(ALL_ALIVE, hand_over(take), history=True)
    while not is_over():
        if is_stopped(LINGER_S):
            return 0
    if is_stopped(LEAVE_S) or operators:
        return 0
    if not words:
        print(f"router: no operator has come within {NO_OPERATOR_S:g} s", file=sys.stderr)
    notice = session.liveliness().declare_token(GAVE_UP)
    is_stopped(NOTICE_S)
    notice.undeclare()
    return 0 if words else FAILED


if __name__ == "__main__":
    sys.exit(main())
