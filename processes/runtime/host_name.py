"""The name of this host, as people know it: in a container of compose the container's, such as swarm-uav-7."""

from __future__ import annotations

import contextlib
import re
import socket
from functools import cache
from pathlib import Path

IN_CONTAINER = Path("/.dockerenv")
MAX_NAME = 64


@cache
def host_name() -> str:
    """Return the name; the engine's name server knows that of a container by its address."""
    name = socket.gethostname()
    if IN_CONTAINER.exists():
        with contextlib.suppress(OSError):
            name = socket.gethostbyaddr(socket.gethostbyname(name))[0].partition(".")[0]
    return re.sub(r"[^A-Za-z0-9_.-]", "-", name)[:MAX_NAME]
