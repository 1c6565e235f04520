"""`edc-swarm run`: real processes over Zenoh."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from edc_swarm.emulation.links import have_range
from edc_swarm.errors import InputError
from edc_swarm.ground_station.view import check_systems
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.fault_help import fault_help
from edc_swarm.mission.faults import parse_faults
from edc_swarm.mission.roles import OPERATOR, RECORDER, ROUTER
from processes.bus.address import listening_endpoint, parse_endpoint, unreachable_router
from processes.bus.credentials import TLS, Credentials, check_certificates
from processes.bus.session import try_client
from processes.cli.conclusion import conclude
from processes.cli.options import MISSION_HELP, MissionOptions
from processes.cli.whole_number import WholeNumber
from processes.host.autopilots import check_ready
from processes.host.capacity import check_capacity, stretched_slot_s
from processes.host.launcher import Launcher
from processes.host.run_report import RunReport
from processes.host.run_setup import Bus, Protection, View
from processes.host.security import check_security
from processes.operator.takeover import find_takeover
from processes.runtime.clock import MissionClock
from processes.runtime.console import FAILED, note
from processes.runtime.limits import make_room
from processes.runtime.output import Output, default_output, timestamp
from processes.services.live import live_port
from processes.services.mavlink_link import ground_address
from processes.services.orders import await_found

Overload = Literal["refuse", "fly", "stretch"]


def run(
    mission_file: Annotated[Path | None, Parameter(help=MISSION_HELP)] = None,
    /,
    *,
    options: MissionOptions | None = None,
    listen: str | None = None,
    live: bool = False,
    remote: WholeNumber = 0,
    operate: str | None = None,
    secure: bool = False,
    certs: Path | None = None,
    mavlink: str | None = None,
    mavlink_commands: bool = False,
    arm: bool = False,
    overload: Overload = "refuse",
) -> int:
    """Fly a mission: a process for every UAV, a router, a recorder.

    Parameters
    ----------
    listen
        Address at which the router listens, tcp/HOST:PORT, with --secure tls/HOST:PORT (a free port of this host).
    live
        Serve Foxglove and Lichtblick on this host a live view of the mission.
    remote
        Number of UAVs, the last of the roster, that other hosts fly with edc-swarm join (0).
    operate
        Start no other process: connect to this router, tcp/HOST:PORT or tls/HOST:PORT; others run the rest.
    secure
        TLS on every link, a certificate for every process, and a router that admits each only to its own keys.
    certs
        Folder of `edc-swarm certs` (new certificates for this run alone). --secure with --remote or --operate needs it.
    mavlink
        Show every UAV to the ground station at this address, udp:HOST:PORT, which may only look on.
    mavlink_commands
        Let that ground station pause UAVs, let them go on, give them new goals and land them, through the operator.
    arm
        Arm the vehicles of autopilots, after a check of each; without it nothing is armed (docs/autopilots.md).
    overload
        What to do if a measurement says that this machine carries fewer UAVs: refuse, fly, stretch the slot (refuse).
    """
    options = options or MissionOptions()
    if options.fault_help:
        print(fault_help(), end="")
        return 0
    mission = _carried(options, mission_file, overload) if not (remote or operate) else options.mission(mission_file)
    if not 0 <= remote <= len(mission.roster):
        raise InputError("--remote", remote, f"from 0 to the number of UAVs, {len(mission.roster)}")
    make_room(len(mission.roster))
    protection = _protection(secure, certs, mission, elsewhere=bool(remote or operate))
    if listen is not None:
        listen = listen if protection is None else f"{TLS}{listen.removeprefix(TLS).removeprefix('tcp/')}"
        listen = listening_endpoint(listen, "tcp" if protection is None else "tls")
    if live and options.no_viz:
        raise InputError("--live", live, "absent where --no-viz is given")
    if operate is None:
        check_ready(mission, [entry.uav for entry in mission.roster][: len(mission.roster) - remote], arm=arm)
    alone = {"--listen": listen, "--live": live, "--remote": remote, "--mavlink": mavlink}
    if mavlink_commands and mavlink is None:
        raise InputError("--mavlink-commands", mavlink_commands, "given together with --mavlink")
    ground = _ground(mavlink, mission) if mavlink is not None else None
    bus = _meet(operate, mission, alone, protection) if operate is not None else None
    view = View(viz=not options.no_viz, live_port=live_port() if live else 0, ground=ground, commands=mavlink_commands)
    if live:
        note(f"live: open the Foxglove WebSocket connection ws://localhost:{view.live_port}")
    with _output(mission, options, bus) as output:
        launcher = Launcher(
            mission,
            output,
            listen=listen,
            view=view,
            voice=options.voice,
            remote=remote,
            bus=bus,
            protection=protection,
            arm=arm,
        )
        report = launcher.run()
        if output.part.exists() and report.flew:
            missing = "; ".join(output.recover_part()) or "nothing is missing"
            note(f"the recorder died; recovered {output.path}: {missing}")
    _tell(report)
    status = conclude(output.path, as_json=options.json, last_slot=report.last_slot) if report.flew else FAILED
    launcher.leave()
    return FAILED if report.failed or report.interrupted else status


def _carried(options: MissionOptions, file: Path | None, overload: Overload) -> Mission:
    """Return the mission if this machine carries it, or as `overload` says."""
    mission = options.mission(file)
    if overload == "refuse":
        check_capacity(mission)
    elif overload == "stretch" and (slot_s := stretched_slot_s(mission)) > mission.dt_s:
        note(f"the slot is stretched from {mission.dt_s:g} to {slot_s:g} s, which this machine carries")
        return options.with_slot(slot_s).mission(file)
    return mission


def _meet(address: str, mission: Mission, alone: Mapping[str, object], protection: Protection | None) -> Bus:
    """Connect to a router that is already running, and find this mission there if it has lost its operator."""
    parse_endpoint("--operate", address, "tcp" if protection is None else "tls")
    own = Credentials(protection.certs, OPERATOR) if protection is not None and protection.certs is not None else None
    if own is not None:
        check_certificates(own.folder, [OPERATOR])
    for field, value in alone.items():
        if value:
            raise InputError(field, value, "absent where --operate is given")
    for fault in parse_faults(mission):
        if {ROUTER, RECORDER} & {*fault.names}:
            raise InputError("--fault", str(fault), "about UAVs where --operate is given")
    session = await_found(partial(try_client, address, own, observer=True), partial(unreachable_router, address))
    takeover = find_takeover(session, mission)
    if takeover is not None and takeover.mission is not None:
        MissionClock().check_epoch(takeover.mission)
    return Bus(address, session, takeover)


def _ground(mavlink: str, mission: Mission) -> tuple[str, int]:
    """Return host and port of the ground station; refuse a mission with more UAVs than it can tell apart."""
    check_systems(len(mission.roster))
    return ground_address(mavlink)


def _output(mission: Mission, options: MissionOptions, bus: Bus | None) -> Output:
    """Return the file to write: a new one, or that of the recorder of a mission that is taken over."""
    begun = bus.takeover.recorder if bus is not None and bus.takeover is not None else None
    if begun is not None:
        return Output(Path(begun.out), force=True, begun=True)
    path = options.out or default_output(mission.name, mission.planner, timestamp())
    output = Output(path, force=options.force)
    for found in output.salvaged:
        note(f"recovered {found} from a run that was killed")
    return output


def _protection(secure: bool, certs: Path | None, mission: Mission, *, elsewhere: bool) -> Protection | None:
    """Check and return the protection that `--secure` asks for: certificates, and no UAV that receives the truth."""
    if not secure:
        if certs is not None:
            raise InputError("--certs", str(certs), "given together with --secure")
        return None
    if elsewhere and certs is None:
        raise InputError("--certs", "", "given with --secure where --remote or --operate is")
    if have_range(mission):
        raise InputError("--secure", secure, "absent where links have range_m: emulating it takes hearing the truth")
    if certs is None:
        check_security("--secure")
    return Protection(certs)


def _tell(report: RunReport) -> None:
    """Print notes about the processes of a run."""
    for text in report.notes:
        note(text)
    if report.interrupted:
        note("interrupted")
    if report.publishing_s is not None and report.first_flown_slot < 0:
        note("no command was flown")
