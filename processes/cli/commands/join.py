"""`edc-swarm join`: UAV processes of another machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from edc_swarm.errors import InputError
from edc_swarm.mission.field_types import MAX_UAVS
from edc_swarm.mission.roles import JOIN
from processes.bus.address import parse_endpoint
from processes.bus.credentials import certified_uavs, check_certificates
from processes.cli.whole_number import WholeNumber
from processes.host.claim_folder import ClaimFolder
from processes.host.joiner import Joiner
from processes.runtime.console import FAILED
from processes.runtime.limits import make_room


def join(
    address: Annotated[str, Parameter(help="The mission's router, tcp/HOST:PORT, tls/HOST:PORT if secured.")],
    /,
    *,
    uavs: WholeNumber = 1,
    state: Path | None = None,
    certs: Path | None = None,
    arm: bool = False,
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
    arm
        Arm the vehicles of autopilots, after a check of each; without it nothing is armed.
    """
    parse_endpoint("address", address, "tcp" if certs is None else "tls", "" if certs else "; tls takes --certs FOLDER")
    if not 1 <= uavs <= MAX_UAVS:
        raise InputError("--uavs", uavs, f"from 1 to {MAX_UAVS}")
    if certs is not None:
        check_certificates(certs, [JOIN, *certified_uavs(str(certs))])
    make_room(uavs)
    with ClaimFolder(state) as folder:
        return 0 if Joiner(address, uavs, folder, str(certs.resolve()) if certs else "", arm=arm).run() else FAILED
