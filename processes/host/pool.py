"""The UAV processes of this host: forked from one fork source, killed and started again when told."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import threading
from collections.abc import Callable
from pathlib import Path

import msgspec

from edc_swarm.mission.configuration import Mission
from processes.host import fork_source
from processes.runtime.children import Child, News
from processes.runtime.inbox import Inbox
from processes.uav.process import UavSettings
from processes.uav.state import promise_path

FORK_SOURCE = "fork-source"


class UavPool:
    """UAV processes with one folder of state, and who of them lives.

    Attributes
    ----------
    living
        Process id by UAV; 0 from the order to fork it until the fork source tells.
    to_restart
        UAVs that are started again as soon as they have ended.
    """

    def __init__(self, inbox: Inbox[object], log: Callable[[str], Path]) -> None:
        self._inbox = inbox
        self._log = log
        self._settings: dict[str, UavSettings] = {}
        self._source: socket.socket | None = None
        self.living: dict[str, int] = {}
        self.to_restart: set[str] = set()

    def start_source(self, mission: Mission | None) -> Child:
        """Start the fork source, warm for `mission`; without one, UAVs load the planner when they need it."""
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            child = Child(
                FORK_SOURCE,
                "processes.host.fork_source",
                [str(theirs.fileno()), str(os.getpid())],
                self._log(FORK_SOURCE),
                self._tell,
                orders=msgspec.json.encode(mission) if mission is not None else b"",
                pass_fds=[theirs.fileno()],
            )
        self._source = ours
        threading.Thread(target=self._read, args=(ours,), name=FORK_SOURCE, daemon=True).start()
        return child

    def fly(self, settings: UavSettings) -> None:
        """Fork a UAV, whose files are there."""
        self._settings[settings.uav] = settings
        self._fork(settings.uav)

    def flies(self, uav: str) -> bool:
        """Whether a UAV is one of this pool, alive or not."""
        return uav in self._settings

    def signal(self, uav: str, number: int) -> None:
        """Send a signal to the process of a UAV, if it lives."""
        self._order(fork_source.Signal(uav=uav, number=number))

    def restart(self, uav: str, *, lose_memory: bool) -> bool:
        """Kill a UAV if it lives, and start it again when it is dead; whether that was at once."""
        if lose_memory:
            promise_path(Path(self._settings[uav].state), uav).unlink(missing_ok=True)
        if uav not in self.living:
            self._fork(uav)
            return True
        self.to_restart.add(uav)
        self.signal(uav, signal.SIGKILL)
        return False

    def take(self, news: fork_source.Forked | fork_source.Exited) -> bool:
        """Take in who was made or has ended; whether it was started again."""
        if isinstance(news, fork_source.Forked):
            self.living[news.uav] = news.pid
            return False
        self.living.pop(news.uav, None)
        if news.uav not in self.to_restart:
            return False
        self.to_restart.discard(news.uav)
        self._fork(news.uav)
        return True

    def close(self) -> None:
        """Have the fork source end, and all that it has forked."""
        if self._source is not None:
            self._source.shutdown(socket.SHUT_RDWR)

    def _fork(self, uav: str) -> None:
        self.living[uav] = 0
        self._order(fork_source.Fork(settings=self._settings[uav], log=str(self._log(uav).resolve())))

    def _order(self, order: fork_source.Order) -> None:
        """Tell the fork source; if it has died, so have its UAVs."""
        assert self._source is not None
        with contextlib.suppress(ConnectionError):
            self._source.send(msgspec.json.encode(order))

    def _tell(self, news: News) -> None:
        self._inbox.put_always(news)

    def _read(self, source: socket.socket) -> None:
        """Hand over what the fork source tells (a thread of its own)."""
        while packet := _received(source):
            self._inbox.put_always(msgspec.json.decode(packet, type=fork_source.News))


def _received(source: socket.socket) -> bytes:
    try:
        return source.recv(fork_source.MAX_PACKET_BYTES)
    except OSError:
        return b""
