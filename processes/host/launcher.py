"""`edc-swarm run`: starts everything, waits until it is there, flies the mission, ends everything.

Others may fly some of the UAVs (`edc-swarm join`). With a bus that is there already, everything is run
by others, and this command is the operator alone.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import msgspec
import zenoh

from edc_swarm.emulation.links import mission_s
from edc_swarm.errors import InputError, SwarmError
from edc_swarm.mission.configuration import LIVE, OPERATOR, ROUTER, Mission
from edc_swarm.mission.prospect import COMPLETED, GIVEN_UP, NOBODY_LEFT, STALLED
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.messages import MissionMessage, mission_message
from processes.bus.address import (
    advertised_endpoint,
    check_endpoint,
    connect_endpoint,
    free_endpoint,
    parse_endpoint,
    unreachable_router,
)
from processes.bus.credentials import credentials
from processes.bus.session import open_client
from processes.bus.subscriptions import Heard, Token
from processes.host import fork_source
from processes.host.pool import FORK_SOURCE, UavPool
from processes.host.security import OPEN, secure
from processes.operator import host_requests
from processes.operator.bus_client import Operator
from processes.operator.fault_injector import Injector
from processes.operator.registration import Desk
from processes.operator.remote_parts import Remote
from processes.operator.takeover import Takeover, new_mission_id
from processes.runtime.children import Child, ChildExited, ChildReady, PartEndedError
from processes.runtime.clock import MissionClock
from processes.runtime.console import note
from processes.runtime.loop import Interrupted, Loop
from processes.runtime.output import Output
from processes.runtime.progress_bar import ProgressBar
from processes.runtime.run_facts import run_facts
from processes.services.live import ANY_HOST
from processes.services.live import PORT as LIVE_PORT
from processes.services.recorder import CANNOT_WRITE, RecorderSettings
from processes.services.recorder import NAME as RECORDER
from processes.services.visualiser import NAME as VIZ
from processes.services.visualiser import VizSettings
from processes.uav.process import UavSettings
from processes.uav.state import create_state

OPEN_TIMEOUT_MS = 5000
EPOCH_AHEAD_NS = 200_000_000
"""From the mission's publication to its slot 0."""
LOOK_EVERY_S = 0.1
CLOSE_TIMEOUT_S = 1.2
RECORDER_TIMEOUT_S = 30.0
PORT_TRIES = 5
MOST_NAMED = 10


@dataclass(frozen=True, slots=True)
class RunReport:
    """How the processes did, beside what the recording says.

    `flew`: there was a mission to record; `failed`: it was broken off for what the last of the `notes` says;
    `last_slot`: the newest slot of which the operator heard a fix.
    """

    flew: bool
    warm_s: float
    connected_s: float
    publishing_s: float | None
    first_flown_slot: int
    interrupted: bool
    failed: bool
    last_slot: int
    notes: list[str]


@dataclass(frozen=True, slots=True)
class View:
    """Whether viewers are shown something, and live on which port of this host (0: not live)."""

    viz: bool = True
    live_port: int = 0


@dataclass(frozen=True, slots=True)
class Bus:
    """A bus where router, recorder, visualiser and UAVs are run by others, and a mission to go on with."""

    endpoint: str
    session: zenoh.Session
    takeover: Takeover | None = None


@dataclass(frozen=True, slots=True)
class Protection:
    """A secured bus; `certs` is a folder made by `edc-swarm certs`, None for certificates of this run alone."""

    certs: Path | None = None


class Launcher:
    """One run: its processes, from the first to the last.

    `remote` UAVs, the last of the roster, are flown by others; on a `bus`, everything is run by others.
    """

    def __init__(
        self,
        mission: Mission,
        output: Output,
        *,
        listen: str | None,
        view: View,
        show_progress: bool,
        remote: int = 0,
        bus: Bus | None = None,
        protection: Protection | None = None,
    ) -> None:
        self._output = output
        self._listen = listen
        self._view = view
        self._show_progress = show_progress
        self._given = bus
        self._clock = MissionClock()
        self._takeover = bus.takeover if bus is not None else None
        name = self._takeover.mission_id if self._takeover is not None else new_mission_id(mission)
        self._protection = protection
        self._protocol = "tcp" if protection is None else "tls"
        self._security = OPEN
        self._mission = msgspec.structs.replace(mission, name=name)
        self._roster = [entry.uav for entry in mission.roster]
        self._local = [] if bus is not None else self._roster[: len(self._roster) - remote]
        self._elsewhere = [uav for uav in self._roster if uav not in self._local]
        self._remote = Remote([*self._elsewhere, *((RECORDER,) if bus is not None else ())])
        self._loop = Loop(self._take, self._flush)
        self._pool = UavPool(self._loop.inbox, output.log)
        self._children: dict[str, Child] = {}
        self._ready: set[str] = set()
        self._expected_deaths: set[str] = set()
        self._restart_router = False
        self._notes: list[str] = []
        self._failed = False
        self._operator: Operator | None = None
        self._injector: Injector | None = None
        self._endpoint = ""
        self._end_told = False
        self._warm_s = 0.0
        self._ready_at_s = self._connected_at_s = 0.0
        self._publishing_at_s: float | None = None

    def run(self) -> RunReport:
        """Fly the mission; afterwards no process is left and the recording is whole."""
        self._loop.obey_signals()
        try:
            self._start()
            self._fly()
        except Interrupted:
            pass
        except PartEndedError as ended:
            self._failed = True
            self._notes.append(f"error: {' '.join(str(ended).split())}")
        finally:
            self._end()
        return self._report()

    def leave(self) -> None:
        """Leave the bus, last of all: who works for an operator on a given bus stays until it has gone."""
        if self._operator is not None:
            self._operator.disconnect()

    # --- start -------------------------------------------------------------------------------

    def _start(self) -> None:
        if self._given is not None:
            self._start_operator(self._given)
        else:
            self._start_parts()
        self._tell_others()
        self._loop.wait(lambda: self.bus.alive >= self._everyone(), self._who_is_missing)
        self._connected_at_s = time.monotonic()

    def _start_operator(self, given: Bus) -> None:
        """Be the operator alone: tell the others what to do when they ask."""
        self._ready_at_s = time.monotonic()
        self._endpoint = given.endpoint
        viz = self._viz_settings(0)
        live = msgspec.structs.replace(viz, live_port=LIVE_PORT, live_host=ANY_HOST, records=False)
        orders: dict[str, RecorderSettings | VizSettings] = {
            RECORDER: self._recorder_settings(0),
            VIZ: viz,
            LIVE: live,
        }
        told = {name: msgspec.json.encode(settings) for name, settings in orders.items()}
        self._operator = self._operate(given.session, told)

    def _start_parts(self) -> None:
        if self._local:
            self._children[FORK_SOURCE] = self._pool.start_source(self._mission)
        self._secure()
        self._start_router()
        self._operator = self._operate(self._connect())
        self._spawn(
            RECORDER, "processes.services.recorder", [], msgspec.json.encode(self._recorder_settings(os.getpid()))
        )
        if self._view.viz:
            self._spawn(VIZ, "processes.services.visualiser", [], msgspec.json.encode(self._viz_settings(os.getpid())))
        if self._local:
            self._loop.wait(lambda: FORK_SOURCE in self._ready, "the planner to be imported, at the first run compiled")
        self._ready_at_s = self._ready_at_s or time.monotonic()
        for entry in self._mission.roster[: len(self._local)]:
            create_state(self._output.state, entry)
            self._pool.start(self._uav_settings(entry.uav))

    def _connect(self) -> zenoh.Session:
        own, endpoint = credentials(self._security.certs, OPERATOR), connect_endpoint(self._endpoint)
        try:
            return open_client(endpoint, own, timeout_ms=OPEN_TIMEOUT_MS, observer=True)
        except zenoh.ZError:
            if self._listen is None:
                sought = unreachable_router(endpoint)
                raise SwarmError(f"cannot reach {sought}: is the loopback interface of this host up?") from None
            raise InputError("--listen", self._listen, unreachable_router(endpoint)) from None

    def _operate(self, session: zenoh.Session, orders: Mapping[str, bytes] | None = None) -> Operator:
        desk = Desk(self._mission, self._elsewhere, orders, by_name=self._protection is not None)
        return Operator(session, desk, self._loop.inbox, self._clock)

    def _everyone(self) -> set[str]:
        """Who must be on the bus before the mission begins, or goes on."""
        if self._takeover is not None and self._takeover.mission is not None:
            return {RECORDER}
        parts = {RECORDER, VIZ} if self._given is not None and self._view.viz else {RECORDER, *self._viz()}
        return {*self._roster, *parts}

    def _who_is_missing(self) -> str:
        """Who must connect before the mission begins; an id can be claimed and its UAV still not be there."""
        claimed = self.bus.claimed
        missing = [f"{who} (claimed)" if who in claimed else who for who in sorted(self._everyone() - self.bus.alive)]
        more = f" and {len(missing) - MOST_NAMED} more" if len(missing) > MOST_NAMED else ""
        return f"{', '.join(missing[:MOST_NAMED])}{more} to connect"

    def _viz(self) -> set[str]:
        """The visualiser, while it lives."""
        if self._given is not None:
            return {VIZ} & self.bus.alive
        return {VIZ} & self._children.keys()

    def _tell_others(self) -> None:
        if self._elsewhere and self._given is None:
            certs = "" if self._protection is None else " --certs FOLDER"
            note(
                f"{len(self._elsewhere)} of {len(self._roster)} UAVs are to be flown by others: "
                f"edc-swarm join {advertised_endpoint(self._endpoint)} --uavs {len(self._elsewhere)}{certs}"
            )

    def _secure(self) -> None:
        if self._protection is None:
            return
        hosts = [parse_endpoint("--listen", self._listen, self._protocol)[0]] if self._listen is not None else []
        self._security = secure(
            self._protection.certs, self._output.state, self._mission.name, self._roster, hosts, self._local
        )

    def _start_router(self) -> None:
        """Start the router; a free port may be taken by another before it listens, then try again."""
        if self._listen is not None:
            check_endpoint(self._listen, self._protocol)
        for _ in range(PORT_TRIES):
            self._endpoint = self._listen or free_endpoint(self._protocol)
            self._spawn_router()
            self._loop.wait(lambda: ROUTER in self._ready or ROUTER not in self._children, "the router")
            if ROUTER in self._ready:
                return
        raise InputError("--listen", self._endpoint, f"an address to listen on ({self._output.tail(ROUTER, 1)})")

    def _spawn_router(self) -> None:
        self._ready.discard(ROUTER)
        self._expected_deaths.add(ROUTER)
        access = list(filter(None, [self._security.access]))
        self._spawn(ROUTER, "processes.services.router", [self._endpoint, str(os.getpid()), *access])

    def _recorder_settings(self, parent: int) -> RecorderSettings:
        return RecorderSettings(
            endpoint=connect_endpoint(self._endpoint),
            mission=self._mission.name,
            part=str(self._output.part),
            out=str(self._output.path),
            run=run_facts("wall"),
            certs=self._security.certs,
            parent=parent,
            clock_ahead_ns=self._clock.ahead_ns if parent else None,
        )

    def _viz_settings(self, parent: int) -> VizSettings:
        return VizSettings(
            endpoint=connect_endpoint(self._endpoint),
            mission=self._mission.name,
            live_port=self._view.live_port,
            records=self._view.viz,
            certs=self._security.certs,
            parent=parent,
            clock_ahead_ns=self._clock.ahead_ns if parent else None,
        )

    def _uav_settings(self, uav: str) -> UavSettings:
        return UavSettings(
            endpoint=connect_endpoint(self._endpoint),
            mission=self._mission.name,
            uav=uav,
            state=str(self._output.state.resolve()),
            certs=self._security.certs,
            measure_response=self._mission.elect == "response-time",
            clock_ahead_ns=self._clock.ahead_ns,
        )

    def _spawn(self, name: str, module: str, arguments: list[str], orders: bytes | None = None) -> None:
        log = self._output.log(name)
        self._children[name] = Child(name, module, arguments, log, self._loop.inbox.put_always, orders=orders)

    # --- flight ------------------------------------------------------------------------------

    def _fly(self) -> None:
        mission = self._begin()
        from_s = mission_s(self._clock.now_ns() - mission.epoch_ns, mission.time_scale) if self._takeover else 0.0
        injector, monitor = Injector(mission, self, from_s), self.bus.monitor
        self._injector = injector
        assert monitor is not None
        with ProgressBar(mission, shown=self._show_progress) as bar:
            while not (why := self._over(mission)):
                injector.inject_due()
                self._look_at_others()
                bar.show(monitor)
                self._loop.pump(min(LOOK_EVERY_S, injector.next_in_s()))
                if self._publishing_at_s is None and len(self.bus.heard) == len(self._roster):
                    self._publishing_at_s = time.monotonic()
        self._tell_end(why)

    def _begin(self) -> MissionMessage:
        """Start the mission, or go on with one that has begun."""
        if self._takeover is not None and self._takeover.mission is not None:
            note(f"taking over mission {self._mission.name}")
            self.bus.take_over(self._takeover.mission, self._takeover.in_force)
            return self._takeover.mission
        mission = mission_message(self._mission, self._clock.now_ns() + EPOCH_AHEAD_NS)
        self.bus.publish_mission(mission)
        return mission

    def _over(self, mission: MissionMessage) -> str:
        """Why the mission ends now, "" while it goes on."""
        slot, monitor = self.bus.slot_now(), self.bus.monitor
        assert monitor is not None
        if slot > 0 and monitor.complete(slot - 1):
            return COMPLETED
        flying = {*self._pool.living, *self._pool.to_restart, *(self._remote.expected - {RECORDER})}
        if not flying and not any(map(self._comes_back, self._roster)):
            return NOBODY_LEFT
        if slot > mission.max_slots:
            return GIVEN_UP
        all_here = set(self._elsewhere) <= self.bus.alive | self._expected_deaths
        return STALLED if all_here and monitor.stalled(slot - 1) else ""

    def _look_at_others(self) -> None:
        """Stop waiting for whoever has been away for long, and wait again for whoever has come back."""
        dead = {uav for uav in self._expected_deaths if not self._comes_back(uav)}
        gone, back = self._remote.look(self.bus.alive, dead, time.monotonic())
        assert self.bus.monitor is not None
        for part in gone:
            if part == RECORDER:
                self._loop.failure = PartEndedError("the recorder has gone from the bus")
            self.bus.monitor.end(part)
            if part not in dead:
                self._tell_exit(f"{part} has gone from the bus")
        for uav in back:
            self.bus.monitor.revive(uav)

    def _tell_end(self, why: str) -> None:
        """Tell everybody, once, that it is over."""
        if not self._end_told:
            self._end_told = True
            self.bus.publish_event(EventKind.END, why)

    # --- what faults ask for -----------------------------------------------------------------

    def signal(self, name: str, number: int) -> None:
        """Send a signal to a UAV, the router or the recorder; a death by it is expected."""
        if number == signal.SIGKILL:
            self._expected_deaths.add(name)
        if name in self._children:
            self._children[name].signal(number)
        elif name in self._elsewhere:
            self._ask_for(host_requests.Send(uav=name, number=number))
        else:
            self._pool.signal(name, number)

    def restart(self, name: str, *, lose_memory: bool) -> None:
        """Kill a process if it lives, and start it again when it is dead."""
        if name == ROUTER:
            self._restart_the_router()
        elif name in self._elsewhere:
            self._expected_deaths.discard(name)
            self._ask_for(host_requests.Restart(uav=name, lose_memory=lose_memory))
        else:
            if name in self._pool.living:
                self._expected_deaths.add(name)
            self._revived(name, self._pool.restart(name, lose_memory=lose_memory))

    def _ask_for(self, deed: host_requests.Deed) -> None:
        self.bus.publish_event(EventKind.HOST_REQUEST, host_requests.told(deed))

    def _restart_the_router(self) -> None:
        if ROUTER in self._children:
            self._restart_router = True
            self.signal(ROUTER, signal.SIGKILL)
        else:
            self._spawn_router()

    def _comes_back(self, uav: str) -> bool:
        """Whether a fault that is still to come starts it again."""
        return self._injector is not None and self._injector.will_restart(uav)

    def _revived(self, uav: str, again: bool) -> None:
        if again and self._operator is not None and self._operator.monitor is not None:
            self._operator.monitor.revive(uav)

    # --- one loop ----------------------------------------------------------------------------

    @property
    def bus(self) -> Operator:
        """The operator's side of the bus."""
        assert self._operator is not None
        return self._operator

    def _flush(self) -> None:
        if self._operator is not None:
            self._operator.flush()

    def _take(self, item: object) -> None:
        match item:
            case Heard() | Token() | zenoh.Query():
                self.bus.take(item)
            case ChildReady(name):
                self._ready.add(name)
                self._expected_deaths.discard(name)
            case ChildExited(name, _, status):
                self._take_exit(name, status)
            case _:
                self._take_news(item)

    def _take_news(self, news: object) -> None:
        match news:
            case fork_source.Ready(warm_s=warm_s):
                self._warm_s, self._ready_at_s = warm_s, time.monotonic()
                self._ready.add(FORK_SOURCE)
            case fork_source.Failed(reason=reason):
                self._loop.failure = SwarmError(reason)
            case fork_source.Forked():
                self._pool.take(news)
            case fork_source.Exited():
                self._take_uav_exit(news)

    def _take_uav_exit(self, news: fork_source.Exited) -> None:
        if self._operator is not None and self._operator.monitor is not None and not self._comes_back(news.uav):
            self._operator.monitor.end(news.uav)
        self._note_crash(news.uav, news.status)
        self._revived(news.uav, self._pool.take(news))

    def _take_exit(self, name: str, status: int) -> None:
        del self._children[name]
        if name == ROUTER and self._restart_router:
            self._restart_router = False
            self._spawn_router()
        elif self._loop.ending or name in self._expected_deaths:
            return
        elif name == VIZ:
            self._note_crash(name, status)
        elif name == RECORDER and status == CANNOT_WRITE:
            self._loop.failure = self._output.cannot_write(self._output.tail(RECORDER, 1))
        elif name == RECORDER and self._publishing_at_s is not None:
            self._note_crash(name, status)  # Nothing more would be recorded: end in order, and keep what there is.
            self._loop.interrupted = True
        else:
            if self._operator is not None:
                self._operator.publish_event(EventKind.EXITED, f"{name} {_ended(status)}")
            said = self._output.tail(name) or "it said nothing"
            self._loop.failure = PartEndedError(f"the {name} {_ended(status)}: {said}")

    def _note_crash(self, name: str, status: int) -> None:
        """A process that nobody asked to die is told of, with the last that it said."""
        expected = name in self._expected_deaths or self._loop.ending
        self._expected_deaths.discard(name)
        if not expected and status != 0:
            self._tell_exit(f"{name} {_ended(status)}", self._output.tail(name))

    def _tell_exit(self, what: str, said: str = "") -> None:
        self._notes.append("\n".join(filter(None, [what, said])))
        if self._operator is not None:
            self._operator.publish_event(EventKind.EXITED, what)

    # --- end ---------------------------------------------------------------------------------

    def _end(self) -> None:
        """Let everybody say the last word, then see to it that nobody is left."""
        self._loop.ending = True
        self._pool.to_restart.clear()
        self._restart_router = False
        if self._operator is not None:
            self._close_bus(self._operator)
        for name in (VIZ, RECORDER, ROUTER):
            if name in self._children:
                self._children[name].end(CLOSE_TIMEOUT_S)
        self._pool.close()
        if FORK_SOURCE in self._children:
            self._children[FORK_SOURCE].end(CLOSE_TIMEOUT_S)

    def _close_bus(self, operator: Operator) -> None:
        """Publishers close, then the operator, whose last word ends the recorder.

        The router hands on in order, so when a publisher's last word was heard here, it stands in
        the recorder's queue before the operator's.
        """
        self._tell_end("interrupted" if self._loop.interrupted else "failed")
        publishers = {*self._pool.living, *(set(self._elsewhere) & operator.alive), *self._viz()}
        self._loop.wait_quietly(lambda: operator.closed >= publishers, CLOSE_TIMEOUT_S)
        operator.close()
        timeout_s = CLOSE_TIMEOUT_S if self._loop.interrupted or self._loop.failure else RECORDER_TIMEOUT_S
        self._loop.wait_quietly(self._is_recorded, timeout_s, LOOK_EVERY_S)
        if self._given is None:
            operator.disconnect()

    def _is_recorded(self) -> bool:
        """Whether the recorder has finished."""
        if self._given is not None:
            return not self._output.part.exists()
        return RECORDER not in self._children

    def _last_slot(self) -> int:
        """Return the newest slot of which the operator heard a fix, -1 where it heard none."""
        monitor = self._operator.monitor if self._operator is not None else None
        return monitor.slot if monitor is not None else -1

    def _report(self) -> RunReport:
        publishing = self._publishing_at_s
        return RunReport(
            flew=self._operator is not None and self._operator.monitor is not None,
            warm_s=self._warm_s,
            connected_s=self._connected_at_s - self._ready_at_s,
            publishing_s=None if publishing is None else publishing - self._ready_at_s,
            first_flown_slot=self._operator.first_flown_slot if self._operator is not None else -1,
            interrupted=self._loop.interrupted,
            failed=self._failed,
            last_slot=self._last_slot(),
            notes=self._notes,
        )


def _ended(status: int) -> str:
    """How a process ended, in words."""
    return f"was ended by {signal.Signals(-status).name}" if status < 0 else f"ended with status {status}"
