"""The fork source: one warm, single-threaded process that forks every UAV process.

A UAV that must be able to lead in any slot needs numpy, scipy, osqp and the compiled guidance, imported
and run once. This takes seconds, and the fork source does it once. It never opens a Zenoh session, since
a fork after that silently breaks. The command sends it orders over a packet socket. It dies with the
command, and the UAV processes die with it.

`python -m processes.host.fork_source FD PARENT`: FD is the socket; the mission comes on standard input.
Without a mission it stays cold and small: a UAV then loads the planner itself if it may have to lead.
"""

from __future__ import annotations

import gc
import os
import selectors
import signal
import socket
import sys
import time
import traceback

import msgspec
from msgspec import Struct

from edc_swarm.errors import SwarmError
from edc_swarm.mission.autopilots import autopilots
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.lifelong import drawn_sites
from edc_swarm.protocol.messages import mission_message
from processes.host.packing import pack_memory
from processes.runtime.parent import die_with_parent
from processes.uav.autopilot_link import load
from processes.uav.flight import rehearse
from processes.uav.planner_loader import warm_planner
from processes.uav.process import UavSettings, run_uav

MAX_PACKET_BYTES = 1 << 16
REHEARSALS = 16
"""Slots that it begins before it forks: Python 3.11 adapts the code of a function at its eighth call."""


class Fork(Struct, frozen=True, kw_only=True, tag=True):
    """Order to fork a UAV that writes its output to the file `log`."""

    settings: UavSettings
    log: str


class Signal(Struct, frozen=True, kw_only=True, tag=True):
    """Order to send a signal to the process of a UAV if it is alive."""

    uav: str
    number: int


class Ready(Struct, frozen=True, kw_only=True, tag=True):
    """News that the planner is imported and warm."""

    warm_s: float


class Compiling(Struct, frozen=True, kw_only=True, tag=True):
    """News that the planner is being compiled: `done` functions are."""

    done: int


class Failed(Struct, frozen=True, kw_only=True, tag=True):
    """News that the planner cannot be loaded."""

    reason: str


class Forked(Struct, frozen=True, kw_only=True, tag=True):
    """News of a new UAV process."""

    uav: str
    pid: int


class Exited(Struct, frozen=True, kw_only=True, tag=True):
    """News that a UAV process has ended; `status` is negative for a signal."""

    uav: str
    pid: int
    status: int


Order = Fork | Signal
News = Ready | Compiling | Failed | Forked | Exited


class ForkSource:
    """Parent of the UAV processes: it forks, signals and reaps them.

    It never signals a reused process id, since the kernel reuses an id only after the parent has reaped it.
    """

    def __init__(self, command: socket.socket) -> None:
        self._command = command
        self._children: dict[int, str] = {}
        self._wakeup, wakeup_write = socket.socketpair()
        for end in (self._wakeup, wakeup_write):
            end.setblocking(False)
        self._wakeup_write = wakeup_write
        signal.set_wakeup_fd(wakeup_write.fileno(), warn_on_full_buffer=False)
        signal.signal(signal.SIGCHLD, lambda *_: None)

    def send(self, news: News) -> None:
        """Send news to the command."""
        self._command.send(msgspec.json.encode(news))

    def serve(self) -> None:
        """Carry out orders until the command closes its end of the socket."""
        with selectors.DefaultSelector() as selector:
            selector.register(self._command, selectors.EVENT_READ)
            selector.register(self._wakeup, selectors.EVENT_READ)
            while True:
                for key, _ in selector.select():
                    if key.fileobj is self._wakeup:
                        self._reap()
                    elif not self._obey():
                        return

    def kill_all(self) -> None:
        """Kill all UAV processes, frozen or not."""
        for pid in self._children:
            os.kill(pid, signal.SIGKILL)

    def _obey(self) -> bool:
        packet = self._command.recv(MAX_PACKET_BYTES)
        if not packet:
            return False
        match msgspec.json.decode(packet, type=Order):
            case Fork(settings=settings, log=log):
                self._fork(settings, log)
            case Signal(uav=uav, number=number):
                for pid in [pid for pid, child in self._children.items() if child == uav]:
                    os.kill(pid, number)
        return True

    def _fork(self, settings: UavSettings, log: str) -> None:
        parent = os.getpid()
        pid = os.fork()
        if pid == 0:
            self._become(settings, log, parent)
        self._children[pid] = settings.uav
        self.send(Forked(uav=settings.uav, pid=pid))

    def _become(self, settings: UavSettings, log: str, parent: int) -> None:
        """Run the UAV in the child, and never return into the loop of the fork source."""
        status = 1
        try:
            die_with_parent(parent)
            self._forget_parent()
            _redirect_output(log)
            status = run_uav(settings, obey_ctrl_c=False)
        except BaseException:  # noqa: BLE001  (the child must end here, whatever happens)
            traceback.print_exc()
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(status)

    def _forget_parent(self) -> None:
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        for end in (self._command, self._wakeup, self._wakeup_write):
            end.close()

    def _reap(self) -> None:
        self._wakeup.recv(4096)
        while self._children:
            pid, status = os.waitpid(-1, os.WNOHANG)
            if pid == 0:
                return
            uav = self._children.pop(pid)
            self.send(Exited(uav=uav, pid=pid, status=os.waitstatus_to_exitcode(status)))


def _redirect_output(log: str) -> None:
    file = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    os.dup2(file, sys.stdout.fileno())
    os.dup2(file, sys.stderr.fileno())
    os.close(file)


def _warm(source: ForkSource) -> bool:
    """Warm the planner up, and freeze the objects: garbage collection in a child then copies no shared memory."""
    start_s = time.monotonic()
    try:
        if payload := sys.stdin.buffer.read():
            mission = msgspec.json.decode(payload, type=Mission)
            if autopilots(mission):
                load()
            if mission.goals == "lifelong":
                drawn_sites(mission)
            warm_planner(mission, lambda done: source.send(Compiling(done=done)), helped=True)
            _rehearse(mission)
    except SwarmError as error:
        source.send(Failed(reason=str(error)))
        return False
    gc.collect()
    if payload:
        pack_memory()
    gc.freeze()
    threads = len(os.listdir("/proc/self/task"))
    if threads != 1:
        source.send(Failed(reason=f"the planner started threads ({threads}): UAV processes cannot be forked"))
        return False
    source.send(Ready(warm_s=time.monotonic() - start_s))
    return True


def _rehearse(mission: Mission) -> None:
    """Begin slots as an emulated UAV does: what Python and msgspec make at the first calls, all UAVs then share."""
    message, real = mission_message(mission), autopilots(mission)
    for entry in [entry for entry in mission.roster if entry.uav not in real][:REHEARSALS]:
        rehearse(message, entry)


def main() -> int:
    """Warm up, then carry out orders until the command ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    die_with_parent(int(sys.argv[2]))
    source = ForkSource(socket.socket(fileno=int(sys.argv[1])))
    try:
        if _warm(source):
            source.serve()
    except (ConnectionError, BrokenPipeError):
        pass
    finally:
        source.kill_all()
    return 0


if __name__ == "__main__":
    sys.exit(main())
