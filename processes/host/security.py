"""A secured run: certificates for everybody, made for this run alone unless a folder is given."""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec

from edc_swarm.errors import InputError
from edc_swarm.mission.configuration import ROLES
from processes.bus.credentials import check_certificates
from processes.services.router import RouterAccess


@dataclass(frozen=True, slots=True)
class Security:
    """What the processes of a run are told: the folder with their certificates, the router's file of rules."""

    certs: str
    access: str


OPEN = Security("", "")
"""A bus that lets everybody in."""


def check_security(option: str) -> None:
    """Raise `InputError` where certificates cannot be made."""
    if importlib.util.find_spec("cryptography") is None:
        raise InputError(option, True, "absent, or cryptography installed: pip install 'edc-swarm[secure]'")


def secure(
    given: Path | None, state: Path, mission: str, uavs: Sequence[str], hosts: Sequence[str], local: Sequence[str]
) -> Security:
    """Security of one run whose own folder is `state`; certificates are made there unless `given` has them.

    `local` are those of `uavs` whose certificates are needed here.

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
    access.write_bytes(msgspec.json.encode(RouterAccess(certs=str(certs), mission=mission, uavs=list(uavs))))
    return Security(str(certs), str(access.resolve()))
