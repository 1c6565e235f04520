"""`edc-swarm certs`: certificates for a secured swarm."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from edc_swarm.errors import InputError
from edc_swarm.mission.field_types import MAX_UAVS
from edc_swarm.mission.roster import uav_ids
from edc_swarm.mission.validation import load_mission
from processes.bus.credentials import CERTIFIED, HOST
from processes.cli.options import MISSION_HELP
from processes.cli.whole_number import WholeNumber
from processes.host.security import check_security
from processes.runtime.console import note, print_json

HOST_NAME = r"[A-Za-z0-9_-]{1,32}"
HOST_CHARACTERS = frozenset("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789.-:")


def certs(
    mission_file: Annotated[Path | None, Parameter(help=MISSION_HELP)] = None,
    /,
    *,
    uavs: WholeNumber = 10,
    out: Annotated[Path, Parameter(name=["--out", "-o"])] = Path("certs"),
    host: list[str] | None = None,
    joined: list[str] | None = None,
    days: WholeNumber = 30,
    force: bool = False,
    json: bool = False,
) -> int:
    """Make an authority and a certificate for every UAV and role, for --certs of `run` and `join`.

    Give each host only the NAME.pem and NAME.key of its UAVs, those of `join`, ca.pem, and its own host.NAME.* if it
    has them. The authority's key is not kept.

    Parameters
    ----------
    uavs
        Number of UAVs, u001 and so on, if no mission file lists them (10).
    out
        The folder to make (certs).
    host
        Name or address of the router, besides those of this host; may be given more than once.
    joined
        NAME=UAV,UAV: a host that may have a router or a recorder of its own, and its UAVs; may be given more than once.
    days
        Days for which the certificates are valid (30).
    force
        Replace the files in the folder.
    json
        Print the result as JSON alone on standard output.
    """
    check_security("certs")
    from processes.host.certificates import MAX_DAYS, write_certificates  # noqa: PLC0415 - an extra

    if not 1 <= days <= MAX_DAYS:
        raise InputError("--days", days, f"between 1 and {MAX_DAYS}")
    ids = _ids(mission_file, uavs)
    hosts = host or []
    for name in hosts:
        if not name or not HOST_CHARACTERS.issuperset(name):
            raise InputError("--host", name, "a host's name or address")
    own = _joined(joined or [], ids)
    write_certificates(out, ids, hosts=hosts, joined=own, days=days, force=force)
    if json:
        names = [*CERTIFIED, *ids, *(f"{HOST}{name}" for name in own)]
        print_json({"folder": str(out), "names": names, "days": days})
    else:
        note(f"certificates of {len(ids)} UAVs and {len(CERTIFIED)} roles, valid for {days} days; keys are {out}/*.key")
        print(out)
    return 0


def _joined(given: Sequence[str], ids: Sequence[str]) -> dict[str, list[str]]:
    """Return the UAVs of each host that may have a router or a recorder of its own, by name."""
    hosts: dict[str, list[str]] = {}
    for text in given:
        name, _, listed = text.partition("=")
        uavs = listed.split(",")
        if re.fullmatch(HOST_NAME, name) is None or name in hosts or not set(uavs) <= set(ids):
            raise InputError("--joined", text, "NAME=UAV,UAV: each name once, and ids of the mission's UAVs")
        hosts[name] = list(dict.fromkeys(uavs))
    return hosts


def _ids(mission_file: Path | None, uavs: int) -> list[str]:
    mission = load_mission(mission_file) if mission_file is not None else None
    if mission is not None and mission.roster:
        return [entry.uav for entry in mission.roster]
    count = mission.uavs if mission is not None else uavs
    if not 1 <= count <= MAX_UAVS:
        raise InputError("--uavs", count, f"between 1 and {MAX_UAVS}")
    return uav_ids(count)
