"""Start of a run: its processes, the operator's connection, and the wait until all parts are on the bus."""

from __future__ import annotations

import time
from collections.abc import Mapping

import msgspec
import zenoh

from edc_swarm.errors import InputError, SwarmError
from edc_swarm.foreign_text import listed
from edc_swarm.mission.roles import LIVE, OPERATOR
from processes.bus.address import advertised_endpoint, connect_endpoint, unreachable_router
from processes.bus.credentials import credentials
from processes.bus.session import open_client
from processes.host.pool import FORK_SOURCE, THE_PLANNER
from processes.host.run_setup import Bus
from processes.host.run_state import RunState
from processes.operator.bus_client import Operator
from processes.operator.registration import Registration
from processes.runtime.console import MAX_NAMES, note
from processes.services.live import ANY_HOST
from processes.services.live import PORT as LIVE_PORT
from processes.services.recorder import NAME as RECORDER
from processes.services.recorder_settings import RecorderSettings
from processes.services.visualiser import NAME as VIZ
from processes.services.visualiser import VizSettings

OPEN_TIMEOUT_MS = 5000


class RunStart:
    """Start of a run."""

    def __init__(self, state: RunState) -> None:
        self._state = state
        self._setup = state.setup
        self._parts = state.parts
        self._loop = state.loop

    def start(self) -> None:
        """Start the parts of this host, and wait until all parts are on the bus."""
        if self._setup.bus is not None:
            self._start_operator(self._setup.bus)
        else:
            self._start_parts()
        self._note_remote()
        self._loop.wait(lambda: self._state.bus.alive >= self._everyone(), self._missing)
        self._state.times.connected_at_s = time.monotonic()
        self._note_connected()

    def _start_operator(self, given: Bus) -> None:
        """Start the operator alone; it answers the other parts' queries for their orders."""
        self._state.times.ready_at_s = time.monotonic()
        self._parts.endpoint = given.endpoint
        viz = self._parts.viz_settings(0)
        live = msgspec.structs.replace(viz, live_port=LIVE_PORT, live_host=ANY_HOST, records=False)
        orders: dict[str, RecorderSettings | VizSettings] = {
            RECORDER: self._parts.recorder_settings(0),
            VIZ: viz,
            LIVE: live,
        }
        encoded = {name: msgspec.json.encode(settings) for name, settings in orders.items()}
        self._state.operator = self._new_operator(given.session, encoded)

    def _start_parts(self) -> None:
        if self._setup.local:
            self._parts.start_fork_source()
        self._parts.secure_bus()
        self._parts.start_router()
        self._state.operator = self._new_operator(self._connect())
        self._parts.start_observers()
        if self._setup.local:
            ready = self._parts.ready
            self._loop.wait(lambda: FORK_SOURCE in ready, THE_PLANNER)
        self._state.times.ready_at_s = self._state.times.ready_at_s or time.monotonic()
        self._parts.start_uavs()

    def _connect(self) -> zenoh.Session:
        own = credentials(self._parts.security.certs, OPERATOR)
        endpoint = connect_endpoint(self._parts.endpoint)
        try:
            return open_client(endpoint, own, timeout_ms=OPEN_TIMEOUT_MS, observer=True)
        except zenoh.ZError:
            self._loop.pump(0.0)  # The router may have died meanwhile, which is then the reason.
            router = unreachable_router(endpoint)
            if self._setup.listen is None:
                raise SwarmError(f"cannot reach {router}: is the loopback interface of this host up?") from None
            raise InputError("--listen", self._setup.listen, router) from None

    def _new_operator(self, session: zenoh.Session, orders: Mapping[str, bytes] | None = None) -> Operator:
        setup = self._setup
        registration = Registration(setup.mission, setup.elsewhere, orders, by_name=setup.protection is not None)
        return Operator(session, registration, self._loop.inbox, setup.clock)

    def _everyone(self) -> set[str]:
        """Return the parts that must be on the bus before the mission begins, or continues."""
        setup = self._setup
        if setup.takeover is not None and setup.takeover.mission is not None:
            return {RECORDER}
        viewers = {VIZ} if setup.bus is not None and setup.view.viz else self._state.viewers
        return {*setup.roster, RECORDER, *viewers}

    def _missing(self) -> str:
        """Return in words the parts that have yet to connect; an id may be claimed before its UAV connects."""
        bus = self._state.bus
        missing = [f"{who} (claimed)" if who in bus.claimed else who for who in sorted(self._everyone() - bus.alive)]
        return f"{listed(missing, MAX_NAMES)} to connect"

    def _note_connected(self) -> None:
        """Tell the user that all UAVs are there, and who flies those of other hosts."""
        setup, times = self._setup, self._state.times
        since = f"the planner was ready (which took {times.warm_s:.1f} s)" if times.warm_s else "the operator was ready"
        hosts = self._state.bus.hosts
        flown = {host: ", ".join(uav for uav in setup.roster if hosts.get(uav) == host) for host in hosts.values()}
        for host, uavs in flown.items():
            note(f"{host} flies {uavs}")
        waited_s = times.connected_at_s - times.ready_at_s
        note(f"{len(setup.roster)} UAVs connected {waited_s:.2f} s after {since}")

    def _note_remote(self) -> None:
        """Tell the user the command that joins the UAVs of other hosts."""
        setup, elsewhere = self._setup, len(self._setup.elsewhere)
        if elsewhere and setup.bus is None:
            certs = "" if setup.protection is None else " --certs FOLDER"
            note(
                f"{elsewhere} of {len(setup.roster)} UAVs are to be flown by others: "
                f"edc-swarm join {advertised_endpoint(self._parts.endpoint)} --uavs {elsewhere}{certs}"
            )
