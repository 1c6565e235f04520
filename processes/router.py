"""The router: `python -m processes.router tcp/HOST:PORT`. Says `ready` when it listens."""

from __future__ import annotations

import signal
import sys

import zenoh

from processes.bus import open_router
from processes.parent import die_with_parent


def main() -> int:
    """Route until SIGTERM. The second argument, when given, is the parent to die with."""
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM, signal.SIGINT})
    if len(sys.argv) > 2:
        die_with_parent(int(sys.argv[2]))
    try:
        session = open_router(sys.argv[1])
    except zenoh.ZError as error:
        print(f"router: {error}", file=sys.stderr)
        return 2
    print("ready", flush=True)
    signal.sigwait({signal.SIGTERM} if len(sys.argv) > 2 else {signal.SIGTERM, signal.SIGINT})
    session.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
