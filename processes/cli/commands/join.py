"""`edc-swarm join`: UAV processes of another machine."""

from __future__ import annotations

import re
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, get_args

from cyclopts import Parameter

from edc_swarm.errors import InputError
from edc_swarm.mission.field_types import MAX_UAVS, ClusterName
from edc_swarm.mission.roles import JOIN
from processes.bus.address import parse_endpoint
from processes.bus.credentials import OWN_HOST, certified_uavs, check_certificates, own_host
from processes.cli.whole_number import WholeNumber
from processes.host.claim_folder import ClaimFolder
from processes.host.joiner import Joiner
from processes.runtime.console import FAILED
from processes.runtime.limits import make_room
from processes.runtime.output import Output


def join(
    address: Annotated[str, Parameter(help="The mission's router, tcp/HOST:PORT, tls/HOST:PORT if secured.")],
    /,
    *,
    uavs: WholeNumber = 1,
    state: Path | None = None,
    certs: Path | None = None,
    cluster: str = "",
    arm: bool = False,
    router: bool = False,
    record: Path | None = None,
    force: bool = False,
) -> int:
    """Fly UAVs of a mission that another machine operates: edc-swarm run --listen ADDRESS --remote N.

    Parameters
    ----------
    uavs
        Number of UAVs to fly (1). A single UAV imports the planner, which needs memory, only when it may have to lead.
    state
        Folder for the promises of the UAVs; a later `join` with the same folder flies the same UAVs.
    certs
        Folder with the certificates of `join` and of the UAVs that this host may fly; for a secured mission.
    cluster
        Fly UAVs of this cluster alone.
    arm
        Arm the vehicles of autopilots, after a check of each; without it nothing is armed.
    router
        Start a router on this host, linked to the mission's: what its UAVs say to each other stays here. With --certs
        it needs the host's own certificate, of `edc-swarm certs --joined`, as --record does.
    record
        The recording to write of what the UAVs of this host say; `edc-swarm merge` makes one of it and that of `run`.
    force
        Overwrite an existing recording.
    """
    parse_endpoint("address", address, "tcp" if certs is None else "tls", "" if certs else "; tls takes --certs FOLDER")
    if not 1 <= uavs <= MAX_UAVS:
        raise InputError("--uavs", uavs, f"from 1 to {MAX_UAVS}")
    if re.search(get_args(ClusterName)[1].pattern, cluster) is None:
        raise InputError("--cluster", cluster, "the name of a cluster of the mission")
    if certs is not None:
        check_certificates(certs, [JOIN, *certified_uavs(str(certs))])
        own = own_host(certs) if router or record is not None else None
        if own is not None:
            check_certificates(certs, [own[0]])
        elif router or record is not None:
            raise InputError("--certs", str(certs), f"with --router or --record {OWN_HOST}")
    make_room(uavs)
    folder_of_certs = str(certs.resolve()) if certs is not None else ""
    with ClaimFolder(state) as folder, ExitStack() as claimed:
        output = claimed.enter_context(_output(record, force=force)) if record is not None else None
        went_well = Joiner(
            address, uavs, folder, folder_of_certs, cluster=cluster, arm=arm, router=router, output=output
        ).run()
    if record is not None and record.exists():
        print(record)
    return 0 if went_well else FAILED


def _output(record: Path, *, force: bool) -> Output:
    try:
        return Output(record, force=force)
    except InputError as error:
        raise InputError("--record", error.value, error.allowed) from None
