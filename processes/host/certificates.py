"""Certificates of a swarm: one authority, one certificate per UAV and per role.

The common name is the id or the role, and nothing else: the router's rules refer to it. The
authority's key is never written, so it signs no further certificates; a swarm that grows gets a
new folder. The package `cryptography` makes all keys and signatures.
"""

from __future__ import annotations

import ipaddress
import os
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

import msgspec
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from edc_swarm.errors import InputError
from edc_swarm.mission.roles import ROUTER
from processes.bus.credentials import AUTHORITY, CERTIFIED, HOST, certificate_path, host_path, key_path
from processes.runtime.output import unwritten

DAYS = 30
MAX_DAYS = 825
"""Longest validity that common verifiers accept."""
LOCAL_HOSTS = ("localhost", "127.0.0.1", "::1")
EARLIER = timedelta(minutes=5)
"""Start of the validity before now: a host whose clock is behind by less accepts the certificate."""

Key = ec.EllipticCurvePrivateKey


def write_certificates(
    folder: Path,
    uavs: Sequence[str],
    *,
    hosts: Sequence[str] = (),
    joined: Mapping[str, Sequence[str]] | None = None,
    days: int = DAYS,
    force: bool = False,
) -> None:
    """Write the certificates of a swarm into `folder`; `hosts` are the names and addresses of its router.

    `joined`: the UAVs of each host that may have a router or a recorder of its own, by name.

    Raises
    ------
    InputError
        The folder has files already and `force` is not given, or the folder cannot be written.
    """
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if any(folder.iterdir()) and not force:
            raise InputError("--out", str(folder), "a new or empty folder (or give --force)")
        own = {f"{HOST}{name}": list(said) for name, said in (joined or {}).items()}
        _write_all(folder, [*CERTIFIED, *uavs, *own], hosts, timedelta(days=days))
        for name, said in own.items():
            _write(host_path(folder, name), msgspec.json.encode(said), 0o644)
    except OSError as error:
        raise unwritten("--out", folder, error) from None


def _write_all(folder: Path, names: Sequence[str], hosts: Sequence[str], lifetime: timedelta) -> None:
    authority_key = _new_key()
    authority = _authority(authority_key, lifetime)
    _write(folder / AUTHORITY, authority.public_bytes(Encoding.PEM), 0o644)
    for name in names:
        key = _new_key()
        request = _common(_name(name), authority.subject, key, lifetime)
        certificate = _for_use(request, name, hosts).sign(authority_key, SHA256())
        _write(certificate_path(folder, name), certificate.public_bytes(Encoding.PEM), 0o644)
        secret = key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
        _write(key_path(folder, name), secret, 0o600)


def _new_key() -> Key:
    return ec.generate_private_key(ec.SECP256R1())


def _name(common_name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def _common(subject: x509.Name, issuer: x509.Name, key: Key, lifetime: timedelta) -> x509.CertificateBuilder:
    now = datetime.now(UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - EARLIER)
        .not_valid_after(now + lifetime)
    )


def _authority(key: Key, lifetime: timedelta) -> x509.Certificate:
    name = _name("edc-swarm authority")
    builder = _common(name, name, key, lifetime).add_extension(x509.BasicConstraints(True, 0), critical=True)
    return builder.sign(key, SHA256())


def _for_use(builder: x509.CertificateBuilder, name: str, hosts: Sequence[str]) -> x509.CertificateBuilder:
    """Add the uses of a certificate: every name may be a client, only a router a server.

    The mission's router serves at `hosts`, that of another host at that host alone.
    """
    uses = [ExtendedKeyUsageOID.CLIENT_AUTH]
    if name == ROUTER or name.startswith(HOST):
        uses.append(ExtendedKeyUsageOID.SERVER_AUTH)
        elsewhere = hosts if name == ROUTER else ()
        addresses = [_general_name(host) for host in dict.fromkeys([*LOCAL_HOSTS, *elsewhere])]
        builder = builder.add_extension(x509.SubjectAlternativeName(addresses), critical=False)
    builder = builder.add_extension(x509.BasicConstraints(False, None), critical=True)
    return builder.add_extension(x509.ExtendedKeyUsage(uses), critical=False)


def _general_name(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _write(path: Path, data: bytes, mode: int) -> None:
    """Replace the file `path`; it has its `mode` from its creation, so others can never read a key."""
    path.unlink(missing_ok=True)
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as file:
        file.write(data)
