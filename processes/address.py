"""Addresses of routers."""

from __future__ import annotations

import re
import socket

from edc_swarm.errors import InputError


def free_endpoint(protocol: str = "tcp") -> str:
    """An address on this host that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"{protocol}/127.0.0.1:{probe.getsockname()[1]}"


def check_endpoint(endpoint: str, protocol: str = "tcp") -> None:
    """Raise `InputError` unless `endpoint` is an address that can be listened on."""
    found = re.fullmatch(protocol + r"/(\[[0-9a-fA-F:]+\]|[A-Za-z0-9.-]+):(\d{1,5})", endpoint)
    if found is None or not 0 < int(found[2]) < 65536:
        raise InputError("--listen", endpoint, _allowed(protocol))
    host, port = host_of(endpoint), int(found[2])
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((host, port))
    except OSError as error:
        raise InputError(
            "--listen", endpoint, f"{_allowed(protocol)} ({(error.strerror or str(error)).lower()})"
        ) from None


def _allowed(protocol: str) -> str:
    return f"{protocol}/HOST:PORT with a port that is free"


def host_of(endpoint: str) -> str:
    """The host in `tcp/HOST:PORT`."""
    return endpoint.partition("/")[2].rpartition(":")[0].strip("[]")


def connect_endpoint(listen: str) -> str:
    """Where clients on this host find a router that listens at `listen`."""
    return listen.replace("/0.0.0.0:", "/127.0.0.1:").replace("/[::]:", "/[::1]:")
