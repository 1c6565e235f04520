"""Security of a run: the certificates of all its processes, made for this run alone unless a folder is given."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec

from edc_swarm.errors import InputError
from edc_swarm.extras import has_package, install_command
from edc_swarm.mission.roles import ROLES
from processes.bus.credentials import certified_hosts, check_certificates
from processes.services.router import RouterAccess


@dataclass(frozen=True, slots=True)
class Security:
    """The folder with the certificates of a run's processes, and the router's file of access rules."""

    certs: str
    access: str


OPEN = Security("", "")
"""Security of an open bus: no certificates and no rules."""


def check_security(option: str) -> None:
    """Raise `InputError` if the package that makes certificates is missing."""
    if not has_package("cryptography"):
        raise InputError(option, "cryptography", f"installed: {install_command('secure')}")


def secure(
    given: Path | None, state: Path, mission: str, uavs: Sequence[str], hosts: Sequence[str], local: Sequence[str]
) -> Security:
    """Return the security of one run; make its certificates in `state` unless the folder `given` has them.

    `local`: the UAVs among `uavs` that fly on this host, so their certificates must be in `given`.

    Raises
    ------
    InputError
        The given folder lacks a certificate.
    """
    certs = (given or state / "certs").resolve()
    if given is not None:
        check_certificates(certs, [*sorted(ROLES), *local])
    else:
        from processes.host.certificates import write_certificates  # noqa: PLC0415 - an extra

        write_certificates(certs, uavs, hosts=hosts)
    access = state / "access.json"
    allowed = RouterAccess(certs=str(certs), mission=mission, uavs=list(uavs), hosts=certified_hosts(certs))
    access.write_bytes(msgspec.json.encode(allowed))
    return Security(str(certs), str(access.resolve()))
