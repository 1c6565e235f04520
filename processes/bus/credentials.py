"""Credentials of a process on a secured bus: its certificate, its key, and the authority that it trusts."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from edc_swarm.errors import InputError
from edc_swarm.mission.roles import JOIN, RESERVED_IDS, ROLES

CERTIFIED = (*sorted(ROLES), JOIN)
"""Names with a certificate beside the UAVs: the roles, and a joiner."""
AUTHORITY = "ca.pem"
TLS = "tls/"


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
    return sorted(path.stem for path in Path(folder).glob("*.pem") if path.stem not in RESERVED_IDS)


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
