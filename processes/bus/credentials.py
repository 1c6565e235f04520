"""Credentials of a process on a secured bus: its certificate, its key, and the authority that it trusts."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from edc_swarm.errors import InputError
from edc_swarm.mission.field_types import MAX_UAVS, UavId
from edc_swarm.mission.roles import JOIN, RESERVED_IDS, ROLES

CERTIFIED = (*sorted(ROLES), JOIN)
"""Names with a certificate beside the UAVs: the roles, and a joiner."""
AUTHORITY = "ca.pem"
TLS = "tls/"
HOST = "host."
"""Beginning of the name in the certificate of a host with a router or a recorder of its own; no UAV's id has a dot."""


def certificate_path(folder: Path, name: str) -> Path:
    """Return the path of the certificate of a UAV or role."""
    return folder / f"{name}.pem"


def key_path(folder: Path, name: str) -> Path:
    """Return the path of the private key of a UAV or role."""
    return folder / f"{name}.key"


def check_certificates(folder: Path, names: Iterable[str]) -> None:
    """Raise `InputError` unless `folder` has the certificates and keys of `names` and the authority's certificate."""
    wanted = [folder / AUTHORITY]
    wanted += [path(folder, name) for name in names for path in (certificate_path, key_path)]
    for path in wanted:
        if not os.access(path, os.R_OK):
            raise InputError("--certs", str(folder), f"a folder made by `edc-swarm certs` ({path.name} is missing)")


def certified_uavs(folder: str) -> list[str]:
    """Return the UAVs whose certificates are in `folder`: the UAVs that this host may fly."""
    names = (path.stem for path in Path(folder).glob("*.pem"))
    return sorted(name for name in names if name not in RESERVED_IDS and not name.startswith(HOST))


def host_path(folder: Path, name: str) -> Path:
    """Return the path of the list of the UAVs for which the router of host `name` may speak."""
    return folder / f"{name}.json"


def certified_hosts(folder: Path) -> dict[str, list[str]]:
    """Return, by the name in its certificate, the UAVs of each host that may have a router or a recorder of its own.

    Raises
    ------
    InputError
        A list is no list of UAVs, or a host has none.
    """
    hosts = {}
    for path in sorted(folder.glob(f"{HOST}*.json")):
        try:
            hosts[path.stem] = msgspec.json.decode(path.read_bytes(), type=list[UavId])
        except (OSError, msgspec.DecodeError):
            hosts[path.stem] = []
        if not 1 <= len(hosts[path.stem]) <= MAX_UAVS:
            raise InputError("--certs", str(folder), f"a folder in which {path.name} lists UAVs")
    return hosts


OWN_HOST = "a folder with one host.NAME.key and its .pem and .json, of `edc-swarm certs --joined NAME=UAV,UAV`"


def own_host(folder: Path) -> tuple[str, list[str]] | None:
    """Return the name in the certificate of this host, and its UAVs; None unless `folder` has the key of one host."""
    own = [(name, uavs) for name, uavs in certified_hosts(folder).items() if os.access(key_path(folder, name), os.R_OK)]
    return own[0] if len(own) == 1 else None


@dataclass(frozen=True, slots=True)
class Credentials:
    """Certificate and key of `name` in a folder made by `edc-swarm certs`."""

    folder: Path
    name: str

    @property
    def connecting(self) -> dict[str, Any]:
        """Zenoh's settings of a client that proves its own name and verifies the router's."""
        return {**self._both_ways, **self._own("connect"), "transport/link/tls/verify_name_on_connect": True}

    @property
    def listening(self) -> dict[str, Any]:
        """Zenoh's settings of a router that accepts only certified clients, over TLS alone."""
        return {**self._both_ways, **self._own("listen"), "transport/link/protocols": ["tls"]}

    @property
    def _both_ways(self) -> dict[str, Any]:
        return {
            "transport/link/tls/root_ca_certificate": str(self.folder / AUTHORITY),
            "transport/link/tls/enable_mtls": True,
            "transport/link/tls/close_link_on_expiration": True,
        }

    def _own(self, side: str) -> dict[str, Any]:
        return {
            f"transport/link/tls/{side}_certificate": str(certificate_path(self.folder, self.name)),
            f"transport/link/tls/{side}_private_key": str(key_path(self.folder, self.name)),
        }


def credentials(folder: str, name: str) -> Credentials | None:
    """Return the credentials of `name` in `folder`; None for the folder "", which means an open bus."""
    return Credentials(Path(folder), name) if folder else None
