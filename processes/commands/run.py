"""`edc-swarm run`: real processes over Zenoh."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from edc_swarm.errors import InputError
from processes.address import check_endpoint
from processes.conclusion import conclude
from processes.console import FAILED, note
from processes.credentials import TLS
from processes.launcher import Launcher, Protection, RunReport, View
from processes.live import live_port
from processes.options import MISSION_HELP, MissionOptions
from processes.output import Output, default_output, timestamp
from processes.security import check_security


def run(
    mission_file: Annotated[Path | None, Parameter(help=MISSION_HELP)] = None,
    /,
    *,
    options: MissionOptions | None = None,
    listen: str | None = None,
    live: bool = False,
    secure: bool = False,
    certs: Path | None = None,
) -> int:
    """Fly a mission: a process for every UAV, a router, a recorder.

    Parameters
    ----------
    listen
        Where the router listens, tcp/HOST:PORT (a free port of this host).
    live
        Let Foxglove or Lichtblick on this host watch the mission while it is flown.
    secure
        TLS on every link, a certificate for every process, and a router that lets each say only what is its own.
    certs
        Folder with the certificates, made by `edc-swarm certs` (new ones, for this run alone).
    """
    options = options or MissionOptions()
    mission = options.mission(mission_file)
    protection = _protection(secure, certs)
    if listen is not None:
        listen = listen if protection is None else f"{TLS}{listen.removeprefix(TLS).removeprefix('tcp/')}"
        check_endpoint(listen, "tcp" if protection is None else "tls")
    view = View(viz=not options.no_viz, live_port=live_port() if live else 0)
    if live:
        if options.no_viz:
            raise InputError("--live", live, "absent where --no-viz is given")
        note(f"live: open the Foxglove WebSocket connection ws://localhost:{view.live_port}")
    path = options.out or default_output(mission.name, mission.planner, timestamp())
    with Output(path, force=options.force) as output:
        for found in output.salvaged:
            note(f"recovered {found} from a run that was killed")
        report = Launcher(
            mission, output, listen=listen, view=view, show_progress=not options.json, protection=protection
        ).run()
        if output.part.exists():
            note(f"the recorder died; recovered {path}: {'; '.join(output.recover_part()) or 'nothing is missing'}")
    _tell(report, len(mission.roster))
    if not report.flew:
        return FAILED
    return conclude(path, as_json=options.json)


def _protection(secure: bool, certs: Path | None) -> Protection | None:
    if not secure:
        if certs is not None:
            raise InputError("--certs", str(certs), "given together with --secure")
        return None
    check_security("--secure")
    return Protection(certs)


def _tell(report: RunReport, uavs: int) -> None:
    """How the processes did."""
    for text in report.notes:
        note(text)
    if report.interrupted:
        note("interrupted")
    if report.publishing_s is not None:
        note(
            f"{uavs} UAVs connected {report.connected_s:.2f} s and publishing {report.publishing_s:.2f} s after the "
            f"fork source was ready (warm in {report.warm_s:.1f} s); first commands flown in slot "
            f"{report.first_flown_slot}"
        )
