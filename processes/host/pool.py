"""The UAV processes of this host: one fork source forks them; the pool signals and restarts them."""

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
from edc_swarm.planner.compiler import is_ready
from processes.host import fork_source
from processes.runtime.children import Child, News
from processes.runtime.inbox import Inbox
from processes.uav.process import UavSettings
from processes.uav.state import promise_path

FORK_SOURCE = "fork-source"
_FIRST_RUN = "" if is_ready() else " (a first run compiles it; `python -m processes.uav.compile_ahead` does so before)"
THE_PLANNER = f"the planner{_FIRST_RUN}"


class UavPool:
    """The UAV processes of one fork source.

    Attributes
    ----------
    living
        Process id of each living UAV; 0 from the order to fork it until the fork source reports the id.
    to_restart
        UAVs that the pool starts again as soon as they have ended.
    """

    def __init__(self, inbox: Inbox[object], log: Callable[[str], Path]) -> None:
        self._inbox = inbox
        self._log = log
        self._settings: dict[str, UavSettings] = {}
        self._source: socket.socket | None = None
        self.living: dict[str, int] = {}
        self.to_restart: set[str] = set()

    def start_source(self, mission: Mission | None) -> Child:
        """Start the fork source, warm for `mission`; without a mission, UAVs load the planner when they need it."""
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            child = Child(
                FORK_SOURCE,
                "processes.host.fork_source",
                [str(theirs.fileno()), str(os.getpid())],
                self._log(FORK_SOURCE),
                self._take_news,
                orders=msgspec.json.encode(mission) if mission is not None else b"",
                pass_fds=[theirs.fileno()],
            )
        self._source = ours
        threading.Thread(target=self._read, args=(ours,), name=FORK_SOURCE, daemon=True).start()
        return child

    def start(self, settings: UavSettings) -> None:
        """Fork a UAV that has its state files."""
        self._settings[settings.uav] = settings
        self._fork(settings.uav)

    def __contains__(self, uav: str) -> bool:
        """Return True if this pool started the UAV, alive or not."""
        return uav in self._settings

    def signal(self, uav: str, number: int) -> None:
        """Send a signal to the process of a UAV if it is alive."""
        self._order(fork_source.Signal(uav=uav, number=number))

    def restart(self, uav: str, *, lose_memory: bool) -> bool:
        """Kill a UAV if it is alive, and start it again once it is dead; return True if that is at once."""
        if lose_memory:
            promise_path(Path(self._settings[uav].state), uav).unlink(missing_ok=True)
        if uav not in self.living:
            self._fork(uav)
            return True
        self.to_restart.add(uav)
        self.signal(uav, signal.SIGKILL)
        return False

    def take(self, news: fork_source.Forked | fork_source.Exited) -> bool:
        """Take in news of a UAV process; return True if the pool started the UAV again."""
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
        """End the fork source and all the UAVs that it has forked."""
        if self._source is not None:
            self._source.shutdown(socket.SHUT_RDWR)

    def _fork(self, uav: str) -> None:
        self.living[uav] = 0
        self._order(fork_source.Fork(settings=self._settings[uav], log=str(self._log(uav).resolve())))

    def _order(self, order: fork_source.Order) -> None:
        """Send an order to the fork source; ignore its death, since its UAVs are dead then too."""
        assert self._source is not None
        with contextlib.suppress(ConnectionError):
            self._source.send(msgspec.json.encode(order))

    def _take_news(self, news: News) -> None:
        self._inbox.put_always(news)

    def _read(self, source: socket.socket) -> None:
        """Put the news of the fork source into the inbox (on a thread of its own)."""
        while packet := _received(source):
            self._inbox.put_always(msgspec.json.decode(packet, type=fork_source.News))


def _received(source: socket.socket) -> bytes:
    try:
        return source.recv(fork_source.MAX_PACKET_BYTES)
    except OSError:
        return b""
