"""Addresses of routers: parsing, free ports, and the address that clients use."""

from __future__ import annotations

import re
import socket

from edc_swarm.errors import InputError

FREE = " with a port that is free"
PROBE_S = 1.0
NO_ANSWER = {
    "tcp": "something listens there and does not answer: one that is secured takes tls/HOST:PORT and --certs",
    "tls": "something listens there and does not answer, or not to these certificates",
}


def free_endpoint(protocol: str = "tcp") -> str:
    """Return an address on this host with a port that no process listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"{protocol}/127.0.0.1:{probe.getsockname()[1]}"


def parse_endpoint(field: str, endpoint: str, protocol: str = "tcp", which: str = "") -> tuple[str, int]:
    """Return host and port of an address.

    Raises
    ------
    InputError
        The address is malformed. The error names `field` and ends with `which`, a further rule for the address.
    """
    found = re.fullmatch(
        protocol + r"/(\[[0-9a-fA-F:]+\]|[A-Za-z0-9._-]+):(\d{1,5})(#iface=[^#;=/\s]{1,15})?", endpoint
    )
    if found is None:
        raise InputError(field, endpoint, f"{protocol}/HOST:PORT{which}")
    if not 0 < int(found[2]) < 65536:
        raise InputError(field, endpoint, f"{protocol}/HOST:PORT with a port from 1 to 65535{which}")
    return found[1].strip("[]"), int(found[2])


def listening_endpoint(endpoint: str, protocol: str = "tcp") -> str:
    """Return `endpoint` with a free port in place of port 0.

    Raises
    ------
    InputError
        The address is malformed, or no process can listen on it.
    """
    anywhere = re.fullmatch(r"(.*:)0(#.*)?", endpoint)
    if anywhere is None:
        check_endpoint(endpoint, protocol)
        return endpoint
    host, _ = parse_endpoint("--listen", f"{anywhere[1]}1{anywhere[2] or ''}", protocol, FREE)
    try:
        port = _free_port(host)
    except OSError as error:
        raise _not_listened(endpoint, protocol, error) from None
    return f"{anywhere[1]}{port}{anywhere[2] or ''}"


def check_endpoint(endpoint: str, protocol: str = "tcp") -> None:
    """Raise `InputError` unless a process can listen on `endpoint`."""
    host, port = parse_endpoint("--listen", endpoint, protocol, FREE)
    try:
        _free_port(host, port)
    except OSError as error:
        raise _not_listened(endpoint, protocol, error) from None


def _free_port(host: str, port: int = 0) -> int:
    """Return `port`, or any free port for 0; raise `OSError` if no process can listen on it at `host`."""
    family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
    with socket.socket(family, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind((host, port))
        return int(probe.getsockname()[1])


def _not_listened(endpoint: str, protocol: str, error: OSError) -> InputError:
    return InputError("--listen", endpoint, f"{protocol}/HOST:PORT{FREE} ({(error.strerror or str(error)).lower()})")


def unreachable_router(endpoint: str) -> str:
    """Return words for a router that does not answer, with the reason that a plain TCP connection shows."""
    protocol, _, address = _plain(endpoint).partition("/")
    host, _, port = address.rpartition(":")
    try:
        socket.create_connection((host.strip("[]"), int(port)), PROBE_S).close()
        why = NO_ANSWER[protocol]
    except OSError as error:
        why = (error.strerror or str(error)).lower()
    return f"a router at {endpoint} ({why})"


def advertised_endpoint(listen: str) -> str:
    """Return the address for clients on other hosts, which must know this host by its name."""
    return re.sub(r"/(0\.0\.0\.0|\[::\]):", f"/{socket.gethostname()}:", _plain(listen))


def connect_endpoint(listen: str) -> str:
    """Return the address for clients on this host of a router that listens at `listen`."""
    return _plain(listen).replace("/0.0.0.0:", "/127.0.0.1:").replace("/[::]:", "/[::1]:")


def _plain(endpoint: str) -> str:
    """Return the address without its network interface, which differs between the listener and its clients."""
    return endpoint.partition("#")[0]
