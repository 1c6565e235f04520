"""`edc-swarm run`: starts everything, waits until it is there, flies the mission, ends everything.

Everything that happens comes through one inbox: what the bus says, what children do, Ctrl-C. The
loop never sleeps for something to be ready; it waits for the message that says so.
"""

from __future__ import annotations

import contextlib
import os
import secrets
import signal
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import msgspec
import zenoh

from edc_swarm.config import Mission
from edc_swarm.errors import InputError, SwarmError
from edc_swarm.messages import MissionMessage
from edc_swarm.simulation import mission_message
from processes import fork_source
from processes.address import check_endpoint, connect_endpoint, free_endpoint, host_of
from processes.children import Child, ChildExited, ChildReady
from processes.console import note
from processes.ears import Heard, Token
from processes.inbox import Inbox
from processes.injector import Injector
from processes.operator import Operator
from processes.output import Output
from processes.progress_bar import ProgressBar
from processes.recorder import CANNOT_WRITE, RecorderSettings
from processes.recorder import NAME as RECORDER
from processes.run_facts import run_facts
from processes.security import OPEN, secure
from processes.state import create_state, promise_path
from processes.uav import UavSettings
from processes.viz import NAME as VIZ
from processes.viz import VizSettings

ROUTER, FORK_SOURCE = "router", "fork-source"
START_TIMEOUT_S = 600.0
"""Longest wait at the start: on a new machine the planner is compiled first, which takes a minute."""
PATIENCE_S = 4.0
"""After this long the user is told what is waited for."""
EPOCH_AHEAD_NS = 200_000_000
"""From the mission's publication to its slot 0."""
LOOK_EVERY_S = 0.1
CLOSE_TIMEOUT_S = 1.2
RECORDER_TIMEOUT_S = 30.0
PORT_TRIES = 5


class Interrupted(Exception):  # noqa: N818  (nothing is wrong)
    """Ctrl-C, SIGTERM or SIGHUP."""


@dataclass(frozen=True, slots=True)
class Interrupt:
    """A signal asks the command to end."""


@dataclass(frozen=True, slots=True)
class RunReport:
    """How the processes did, beside what the recording says; `flew`: there was a mission to record."""

    flew: bool
    warm_s: float
    connected_s: float
    publishing_s: float | None
    first_flown_slot: int
    interrupted: bool
    notes: list[str]


@dataclass(frozen=True, slots=True)
class View:
    """Whether viewers are shown something, and live on which port of this host (0: not live)."""

    viz: bool = True
    live_port: int = 0


@dataclass(frozen=True, slots=True)
class Protection:
    """A secured bus; `certs` is a folder made by `edc-swarm certs`, None for certificates of this run alone."""

    certs: Path | None = None


class Launcher:
    """One run: its processes, from the first to the last."""

    def __init__(
        self,
        mission: Mission,
        output: Output,
        *,
        listen: str | None,
        view: View,
        show_progress: bool,
        protection: Protection | None = None,
    ) -> None:
        self._output = output
        self._listen = listen
        self._view = view
        self._show_progress = show_progress
        self._protection = protection
        self._protocol = "tcp" if protection is None else "tls"
        self._security = OPEN
        name = f"{mission.name[:50]}-{secrets.token_hex(4)}"
        self._mission = msgspec.structs.replace(mission, name=name)
        self._roster = [entry.uav for entry in mission.roster]
        self._inbox: Inbox[object] = Inbox()
        self._children: dict[str, Child] = {}
        self._ready: set[str] = set()
        self._uavs: dict[str, int] = {}
        self._expected_deaths: set[str] = set()
        self._to_restart: set[str] = set()
        self._notes: list[str] = []
        self._operator: Operator | None = None
        self._injector: Injector | None = None
        self._source: socket.socket | None = None
        self._endpoint = ""
        self._ending = False
        self._end_told = False
        self._interrupted = False
        self._failure: SwarmError | None = None
        self._warm_s = 0.0
        self._ready_at_s = self._connected_at_s = 0.0
        self._publishing_at_s: float | None = None

    def run(self) -> RunReport:
        """Fly the mission; afterwards no process is left and the recording is whole."""
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, lambda *_: self._inbox.put_always(Interrupt()))
        try:
            self._start()
            self._fly()
        except Interrupted:
            pass
        finally:
            self._end()
        return self._report()

    # --- start -------------------------------------------------------------------------------

    def _start(self) -> None:
        self._start_fork_source()
        self._secure()
        self._start_router()
        self._operator = Operator(
            connect_endpoint(self._endpoint), self._mission.name, self._inbox, certs=self._security.certs
        )
        self._start_recorder()
        self._start_visualiser()
        self._wait(lambda: FORK_SOURCE in self._ready, "the planner to be imported, at the first run compiled")
        for entry in self._mission.roster:
            create_state(self._output.state, entry)
            self._fork(entry.uav)
        everyone = {*self._roster, RECORDER, *({VIZ} & self._children.keys())}
        self._wait(lambda: self.bus.alive >= everyone, "all to connect")
        self._connected_at_s = time.monotonic()

    def _secure(self) -> None:
        if self._protection is not None:
            hosts = [host_of(self._listen)] if self._listen is not None else []
            self._security = secure(self._protection.certs, self._output.state, self._mission.name, self._roster, hosts)

    def _start_router(self) -> None:
        """Start the router; a free port may be taken by another before it listens, then try again."""
        if self._listen is not None:
            check_endpoint(self._listen, self._protocol)
        for _ in range(PORT_TRIES):
            self._endpoint = self._listen or free_endpoint(self._protocol)
            self._spawn_router()
            self._wait(lambda: ROUTER in self._ready or ROUTER not in self._children, "the router")
            if ROUTER in self._ready:
                return
        raise InputError("--listen", self._endpoint, f"an address to listen on ({self._output.tail(ROUTER, 1)})")

    def _spawn_router(self) -> None:
        self._ready.discard(ROUTER)
        self._expected_deaths.add(ROUTER)
        access = list(filter(None, [self._security.access]))
        self._spawn(ROUTER, "processes.router", [self._endpoint, str(os.getpid()), *access])

    def _start_recorder(self) -> None:
        settings = RecorderSettings(
            endpoint=connect_endpoint(self._endpoint),
            mission=self._mission.name,
            part=str(self._output.part),
            out=str(self._output.path),
            run=run_facts("wall"),
            certs=self._security.certs,
            parent=os.getpid(),
        )
        self._spawn(RECORDER, "processes.recorder", [], orders=msgspec.json.encode(settings))

    def _start_visualiser(self) -> None:
        if not self._view.viz:
            return
        settings = VizSettings(
            endpoint=connect_endpoint(self._endpoint),
            mission=self._mission.name,
            live_port=self._view.live_port,
            certs=self._security.certs,
            parent=os.getpid(),
        )
        self._spawn(VIZ, "processes.viz", [], orders=msgspec.json.encode(settings))

    def _start_fork_source(self) -> None:
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            arguments = [str(theirs.fileno()), str(os.getpid())]
            orders = msgspec.json.encode(self._mission)
            self._spawn(FORK_SOURCE, "processes.fork_source", arguments, orders=orders, pass_fds=[theirs.fileno()])
        self._source = ours
        threading.Thread(target=self._read_source, args=(ours,), name="fork-source", daemon=True).start()

    def _spawn(
        self,
        name: str,
        module: str,
        arguments: list[str],
        *,
        orders: bytes | None = None,
        pass_fds: tuple[int, ...] | list[int] = (),
    ) -> None:
        log = self._output.log(name)
        self._children[name] = Child(
            name, module, arguments, log, self._inbox.put_always, orders=orders, pass_fds=pass_fds
        )

    def _read_source(self, source: socket.socket) -> None:
        """Hand over what the fork source tells (a thread of its own)."""
        while packet := _received(source):
            self._inbox.put_always(msgspec.json.decode(packet, type=fork_source.News))

    def _order(self, order: fork_source.Order) -> None:
        assert self._source is not None
        self._source.send(msgspec.json.encode(order))

    def _fork(self, uav: str) -> None:
        settings = UavSettings(
            endpoint=connect_endpoint(self._endpoint),
            mission=self._mission.name,
            uav=uav,
            state=str(self._output.state.resolve()),
            certs=self._security.certs,
            measure_response=self._mission.elect == "response-time",
        )
        self._uavs[uav] = 0
        self._order(fork_source.Fork(settings=settings, log=str(self._output.log(uav).resolve())))

    # --- flight ------------------------------------------------------------------------------

    def _fly(self) -> None:
        mission = mission_message(self._mission, time.time_ns() + EPOCH_AHEAD_NS)
        self.bus.publish_mission(mission)
        injector, monitor = Injector(mission, self), self.bus.monitor
        self._injector = injector
        assert monitor is not None
        with ProgressBar(mission, shown=self._show_progress) as bar:
            while not self._over(mission):
                injector.inject_due()
                bar.show(monitor)
                self._pump(min(LOOK_EVERY_S, injector.next_in_s()))
                if self._publishing_at_s is None and len(self.bus.heard) == len(self._roster):
                    self._publishing_at_s = time.monotonic()
        self._tell_end("max_slots" if self.bus.slot_now() > mission.max_slots else "completed")

    def _over(self, mission: MissionMessage) -> bool:
        """Whether all that still fly have arrived, time is over, or nobody is left."""
        slot = self.bus.slot_now()
        assert self.bus.monitor is not None
        nobody_left = not self._uavs and not self._to_restart and not any(map(self._comes_back, self._roster))
        return nobody_left or slot > mission.max_slots or (slot > 0 and self.bus.monitor.complete(slot - 1))

    def _tell_end(self, why: str) -> None:
        """Tell everybody, once, that it is over."""
        if not self._end_told:
            self._end_told = True
            self.bus.publish_event("end", why)

    # --- what faults ask for -----------------------------------------------------------------

    def signal(self, name: str, number: int) -> None:
        """Send a signal to a UAV, the router or the recorder; a death by it is expected."""
        if number == signal.SIGKILL:
            self._expected_deaths.add(name)
        if name in self._children:
            self._children[name].signal(number)
        else:
            self._order(fork_source.Signal(uav=name, number=number))

    def restart(self, name: str, *, lose_memory: bool) -> None:
        """Kill a process if it lives, and start it again when it is dead."""
        if lose_memory:
            promise_path(self._output.state, name).unlink(missing_ok=True)
        self._to_restart.add(name)
        if name in self._children or name in self._uavs:
            self.signal(name, signal.SIGKILL)
        else:
            self._revive(name)

    def _comes_back(self, uav: str) -> bool:
        """Whether a fault that is still to come starts it again."""
        return self._injector is not None and self._injector.will_restart(uav)

    def _revive(self, name: str) -> None:
        self._to_restart.discard(name)
        if name == ROUTER:
            self._spawn_router()
            return
        self._fork(name)
        if self.bus.monitor is not None:
            self.bus.monitor.revive(name)

    # --- one loop ----------------------------------------------------------------------------

    @property
    def bus(self) -> Operator:
        """The operator's side of the bus."""
        assert self._operator is not None
        return self._operator

    def _wait(self, done: Callable[[], bool], what: str, timeout_s: float = START_TIMEOUT_S) -> None:
        start_s, told = time.monotonic(), not what
        while not done():
            waited_s = time.monotonic() - start_s
            if waited_s >= timeout_s:
                raise SwarmError(f"waited {timeout_s:g} s for {what}")
            if waited_s >= PATIENCE_S and not told:
                note(f"waiting for {what}")
                told = True
            self._pump((timeout_s if told else PATIENCE_S) - waited_s)

    def _pump(self, timeout_s: float) -> None:
        for item in self._inbox.wait(timeout_s):
            self._take(item)
        if self._operator is not None:
            self._operator.flush()
        if self._ending:
            return
        if self._interrupted:
            raise Interrupted
        if self._failure is not None:
            raise self._failure

    def _take(self, item: object) -> None:
        match item:
            case Heard() | Token() | zenoh.Query():
                self.bus.take(item)
            case Interrupt():
                self._interrupted = True
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
                self._failure = SwarmError(reason)
            case fork_source.Forked(uav=uav, pid=pid):
                self._uavs[uav] = pid
            case fork_source.Exited(uav=uav, status=status):
                self._take_uav_exit(uav, status)

    def _take_uav_exit(self, uav: str, status: int) -> None:
        self._uavs.pop(uav, None)
        if self._operator is not None and self._operator.monitor is not None and not self._comes_back(uav):
            self._operator.monitor.end(uav)
        self._note_crash(uav, status)
        if uav in self._to_restart:
            self._revive(uav)

    def _take_exit(self, name: str, status: int) -> None:
        del self._children[name]
        if name in self._to_restart:
            self._revive(name)
        elif self._ending or name in self._expected_deaths:
            return
        elif name == VIZ:
            self._note_crash(name, status)
        elif name == RECORDER and status == CANNOT_WRITE:
            self._failure = InputError(
                "--out", str(self._output.path), f"where it can be written: {self._output.tail(RECORDER, 1)}"
            )
        else:
            self._failure = SwarmError(f"the {name} {_ended(status)}: {self._output.tail(name) or 'it said nothing'}")

    def _note_crash(self, name: str, status: int) -> None:
        """A process that nobody asked to die is told of, with the last that it said."""
        expected = name in self._expected_deaths or self._ending
        self._expected_deaths.discard(name)
        if expected or status == 0:
            return
        ended = f"{name} {_ended(status)}"
        self._notes.append("\n".join(filter(None, [ended, self._output.tail(name)])))
        if self._operator is not None:
            self._operator.publish_event("exited", ended)

    # --- end ---------------------------------------------------------------------------------

    def _end(self) -> None:
        """Let everybody say the last word, then see to it that nobody is left."""
        self._ending = True
        self._to_restart.clear()
        if self._operator is not None:
            self._close_bus(self._operator)
        for name in (VIZ, RECORDER, ROUTER):
            if name in self._children:
                self._children[name].end(CLOSE_TIMEOUT_S)
        if self._source is not None:
            self._source.shutdown(socket.SHUT_RDWR)
        if FORK_SOURCE in self._children:
            self._children[FORK_SOURCE].end(CLOSE_TIMEOUT_S)

    def _close_bus(self, operator: Operator) -> None:
        """Publishers close, then the operator, whose last word ends the recorder.

        The router hands on in order, so when a publisher's last word was heard here, it stands in
        the recorder's queue before the operator's.
        """
        self._tell_end("interrupted" if self._interrupted else "failed")
        self._wait_quietly(lambda: operator.closed >= {*self._uavs, *({VIZ} & self._children.keys())}, CLOSE_TIMEOUT_S)
        operator.close()
        timeout_s = CLOSE_TIMEOUT_S if self._interrupted or self._failure else RECORDER_TIMEOUT_S
        self._wait_quietly(lambda: RECORDER not in self._children, timeout_s)
        operator.disconnect()

    def _wait_quietly(self, done: Callable[[], bool], timeout_s: float) -> None:
        """Wait, whatever else goes wrong meanwhile: this is the end anyway."""
        with contextlib.suppress(SwarmError):
            self._wait(done, "", timeout_s)

    def _report(self) -> RunReport:
        publishing = self._publishing_at_s
        return RunReport(
            flew=self._operator is not None and self._operator.monitor is not None,
            warm_s=self._warm_s,
            connected_s=self._connected_at_s - self._ready_at_s,
            publishing_s=None if publishing is None else publishing - self._ready_at_s,
            first_flown_slot=self._operator.first_flown_slot if self._operator is not None else -1,
            interrupted=self._interrupted,
            notes=self._notes,
        )


def _ended(status: int) -> str:
    """How a process ended, in words."""
    return f"was ended by {signal.Signals(-status).name}" if status < 0 else f"ended with status {status}"


def _received(source: socket.socket) -> bytes:
    try:
        return source.recv(fork_source.MAX_PACKET_BYTES)
    except OSError:
        return b""
