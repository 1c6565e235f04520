"""The processes that one host runs for a mission: fork source, UAVs, router, recorder, visualiser."""

from __future__ import annotations

import os
import signal

import msgspec

from edc_swarm.errors import InputError
from edc_swarm.mission.roles import RECORDER, ROUTER
from processes.bus.address import check_endpoint, connect_endpoint, free_endpoint, parse_endpoint
from processes.host.ending import CLOSE_TIMEOUT_S, Deaths, end_fork_source
from processes.host.pool import FORK_SOURCE, UavPool
from processes.host.run_setup import RunSetup
from processes.host.security import OPEN, secure
from processes.runtime.children import Child
from processes.runtime.loop import Loop
from processes.runtime.run_facts import plug_in_facts, run_facts
from processes.services.ground_station import NAME as GROUND
from processes.services.ground_station import GroundSettings
from processes.services.recorder_settings import RecorderSettings
from processes.services.visualiser import NAME as VIZ
from processes.services.visualiser import VizSettings
from processes.uav.process import UavSettings
from processes.uav.state import create_state

PORT_TRIES = 5


class Parts:
    """The processes of this host, from their start to their end.

    Attributes
    ----------
    pool
        The UAV processes.
    children
        The other living processes by name.
    ready
        Names of the children that have reported that they are ready.
    endpoint
        Address of the router.
    security
        Certificates and access rules of the run.
    """

    def __init__(self, setup: RunSetup, loop: Loop, deaths: Deaths) -> None:
        self._setup = setup
        self._loop = loop
        self._deaths = deaths
        self.pool = UavPool(loop.inbox, setup.output.log)
        self.children: dict[str, Child] = {}
        self.ready: set[str] = set()
        self.endpoint = ""
        self.security = OPEN
        self._restart_router = False

    # --- start -------------------------------------------------------------------------------

    def start_fork_source(self) -> None:
        """Start the fork source, warm for the mission."""
        self.children[FORK_SOURCE] = self.pool.start_source(self._setup.mission)

    def secure_bus(self) -> None:
        """Make or check the certificates of a secured run."""
        setup = self._setup
        if setup.protection is None:
            return
        hosts = [parse_endpoint("--listen", setup.listen, setup.protocol)[0]] if setup.listen is not None else []
        self.security = secure(
            setup.protection.certs, setup.output.state, setup.mission.name, setup.roster, hosts, setup.local
        )

    def start_router(self) -> None:
        """Start the router; try again if another process takes the free port before the router listens."""
        listen = self._setup.listen
        if listen is not None:
            check_endpoint(listen, self._setup.protocol)
        for _ in range(PORT_TRIES):
            self.endpoint = listen or free_endpoint(self._setup.protocol)
            self._spawn_router()
            self._loop.wait(lambda: ROUTER in self.ready or ROUTER not in self.children, "the router")
            if ROUTER in self.ready:
                return
        said = self._setup.output.last_line(ROUTER)
        raise InputError("--listen", self.endpoint, f"an address to listen on ({said})")

    def _spawn_router(self) -> None:
        self.ready.discard(ROUTER)
        self._deaths.expected.add(ROUTER)
        access = list(filter(None, [self.security.access]))
        self._spawn(ROUTER, "processes.services.router", [self.endpoint, str(os.getpid()), *access])

    def start_observers(self) -> None:
        """Start the recorder and, if the run has them, the visualiser and the bridge to a ground station."""
        recorder = msgspec.json.encode(self.recorder_settings(os.getpid()))
        self._spawn(RECORDER, "processes.services.recorder", [], recorder)
        if self._setup.view.viz:
            viz = msgspec.json.encode(self.viz_settings(os.getpid()))
            self._spawn(VIZ, "processes.services.visualiser", [], viz)
        if self._setup.view.ground is not None:
            ground = msgspec.json.encode(self._ground_settings(*self._setup.view.ground))
            self._spawn(GROUND, "processes.services.ground_station", [], ground)

    def start_uavs(self) -> None:
        """Create the state files of the UAVs of this host, and fork their processes."""
        setup = self._setup
        for entry in setup.mission.roster[: len(setup.local)]:
            create_state(setup.output.state, entry)
            self.pool.start(self._uav_settings(entry.uav))

    def _spawn(self, name: str, module: str, arguments: list[str], orders: bytes | None = None) -> None:
        log = self._setup.output.log(name)
        self.children[name] = Child(name, module, arguments, log, self._loop.inbox.put_always, orders=orders)

    def recorder_settings(self, parent: int) -> RecorderSettings:
        """Return the settings of the recorder; `parent` is 0 for a recorder that others run."""
        return RecorderSettings(
            endpoint=connect_endpoint(self.endpoint),
            mission=self._setup.mission.name,
            part=str(self._setup.output.part),
            out=str(self._setup.output.path),
            run={**run_facts("wall"), **plug_in_facts(self._setup.mission)},
            certs=self.security.certs,
            parent=parent,
            clock_ahead_ns=self._setup.clock.ahead_ns if parent else None,
        )

    def viz_settings(self, parent: int) -> VizSettings:
        """Return the settings of the visualiser; `parent` is 0 for a visualiser that others run."""
        return VizSettings(
            endpoint=connect_endpoint(self.endpoint),
            mission=self._setup.mission.name,
            live_port=self._setup.view.live_port,
            records=self._setup.view.viz,
            certs=self.security.certs,
            parent=parent,
            clock_ahead_ns=self._setup.clock.ahead_ns if parent else None,
        )

    def _ground_settings(self, host: str, port: int) -> GroundSettings:
        return GroundSettings(
            endpoint=connect_endpoint(self.endpoint),
            mission=self._setup.mission.name,
            host=host,
            port=port,
            permitted=self._setup.view.commands,
            certs=self.security.certs,
            parent=os.getpid(),
            clock_ahead_ns=self._setup.clock.ahead_ns,
        )

    def _uav_settings(self, uav: str) -> UavSettings:
        return UavSettings(
            endpoint=connect_endpoint(self.endpoint),
            mission=self._setup.mission.name,
            uav=uav,
            state=str(self._setup.output.state.resolve()),
            certs=self.security.certs,
            measure_response=self._setup.mission.elect == "response-time",
            clock_ahead_ns=self._setup.clock.ahead_ns,
            arm=self._setup.arm,
        )

    # --- faults and exits --------------------------------------------------------------------

    def signal(self, name: str, number: int) -> None:
        """Send a signal to a process of this host."""
        if name in self.children:
            self.children[name].signal(number)
        else:
            self.pool.signal(name, number)

    def restart_router(self) -> None:
        """Kill the router if it is alive, and start it again once it is dead."""
        if ROUTER in self.children:
            self._restart_router = True
            self._deaths.expected.add(ROUTER)
            self.signal(ROUTER, signal.SIGKILL)
        else:
            self._spawn_router()

    def take_exit(self, name: str) -> bool:
        """Take in the end of a child; return True if it is a router that starts again."""
        del self.children[name]
        restarts = name == ROUTER and self._restart_router
        if restarts:
            self._restart_router = False
            self._spawn_router()
        return restarts

    # --- end ---------------------------------------------------------------------------------

    def cancel_restart(self) -> None:
        """Let a router that is to start again stay dead."""
        self._restart_router = False

    def end(self) -> None:
        """End the processes of this host; afterwards none is left."""
        for name in (VIZ, GROUND, RECORDER, ROUTER):
            if name in self.children:
                self.children[name].end(CLOSE_TIMEOUT_S)
        end_fork_source(self.pool, self.children.get(FORK_SOURCE))
