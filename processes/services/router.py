"""The router: `python -m processes.services.router ENDPOINT [PARENT | mission [ACCESS]]`. Says `ready` when it listens.

It routes until SIGTERM. With a parent it dies with it; with the word `mission` it ends when a mission
has been flown, its operator and all who took part have gone. When the operator gives up before it has a
mission (`processes.bus.abort_notice`), or none comes, it tells everybody, and for a while whoever comes. On a
secured bus, ACCESS is the file of a `RouterAccess`, or a folder of certificates: then whatever mission is
flown by the UAVs that have one there.
"""

from __future__ import annotations

import signal
import sys
import time
from pathlib import Path

import msgspec
import zenoh
from msgspec import Struct

from edc_swarm.errors import InputError
from edc_swarm.mission.configuration import OPERATOR, ROUTER
from edc_swarm.protocol.keys import ALL_ALIVE
from processes.bus.abort_notice import NOTICE_KEY
from processes.bus.credentials import certified_uavs, check_certificates, credentials
from processes.bus.operator_presence import GAVE_UP, LINGER_S
from processes.bus.session import MAX_SESSIONS, hand_over, open_router
from processes.runtime.console import FAILED
from processes.runtime.limits import make_room_for_sessions
from processes.runtime.parent import die_with_parent
from processes.services.access_rules import ANY_MISSION, access_control

ONE_MISSION = "mission"
PATIENCE_S = 120.0
"""An operator that has not come by then is not waited for: it has been killed before it could say so."""
LEAVE_S = 2 * LINGER_S
"""After everybody's last sign: who works for an operator leaves after it, and closes slowly without a router."""
NOTICE_S = 30.0
"""For so long whoever starts late is told that there will be no mission."""


class RouterAccess(Struct, frozen=True, kw_only=True):
    """Who may connect to a secured bus and for what: a file that the router reads."""

    certs: str
    mission: str
    uavs: list[str]


def open_secured(endpoint: str, where: Path) -> zenoh.Session:
    """The router of a secured bus, whose rules follow from the roster in a file, or from a folder of certificates."""
    if where.is_dir():
        check_certificates(where, [ROUTER])
        access = RouterAccess(certs=str(where), mission=ANY_MISSION, uavs=certified_uavs(str(where)))
    else:
        access = msgspec.json.decode(where.read_bytes(), type=RouterAccess)
    rules = access_control(access.mission, access.uavs)
    return open_router(endpoint, credentials(access.certs, ROUTER), rules)


def main() -> int:
    """Route until it is time to end."""
    signals = {signal.SIGTERM, signal.SIGINT}
    signal.pthread_sigmask(signal.SIG_BLOCK, signals)
    for_whom = sys.argv[2] if len(sys.argv) > 2 else ""
    if for_whom.isdigit():
        die_with_parent(int(for_whom))
        signals = {signal.SIGTERM}
    else:
        make_room_for_sessions(MAX_SESSIONS)  # The launcher has done so for a router of its own.
    try:
        session = open_secured(sys.argv[1], Path(sys.argv[3])) if len(sys.argv) > 3 else open_router(sys.argv[1])
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


def _route_one_mission(session: zenoh.Session, signals: set[signal.Signals]) -> int:
    """Wait until an operator has come or given up, and everybody has gone, or a signal comes; the exit status."""
    there: set[str] = set()
    operators: set[str] = set()
    words: set[str] = set()
    patience_until_s = time.monotonic() + PATIENCE_S

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
        print(f"router: no operator has come within {PATIENCE_S:g} s", file=sys.stderr)
    notice = session.liveliness().declare_token(GAVE_UP)
    is_stopped(NOTICE_S)
    notice.undeclare()
    return 0 if words else FAILED


if __name__ == "__main__":
    sys.exit(main())
