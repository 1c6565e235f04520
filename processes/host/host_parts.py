"""The parts of a joined host besides its UAVs, if it has any: a router, linked to the mission's, and a recorder."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import msgspec

from edc_swarm.mission.roles import RECORDER, ROUTER
from processes.bus.address import free_endpoint
from processes.bus.credentials import own_host
from processes.host.ending import CLOSE_TIMEOUT_S, RECORDER_TIMEOUT_S
from processes.runtime.children import Child
from processes.runtime.clock import MissionClock
from processes.runtime.loop import Loop
from processes.runtime.output import Output
from processes.runtime.run_facts import run_facts
from processes.services.recorder_settings import RecorderSettings


class HostParts:
    """The router and the recorder of a joined host.

    Attributes
    ----------
    ready
        Names of the parts that have reported that they are ready.
    """

    def __init__(self, loop: Loop, folder: Path, output: Output | None, certs: str = "") -> None:
        self._loop = loop
        self._folder = folder
        self._output = output
        self._certs = certs
        self._children: dict[str, Child] = {}
        self.ready: set[str] = set()

    def start_router(self, linked_to: str) -> str:
        """Start the router of this host, and return its address."""
        endpoint = free_endpoint("tls" if self._certs else "tcp")
        arguments = [endpoint, str(os.getpid()), self._certs, "--link", linked_to]
        self._spawn(ROUTER, "processes.services.router", arguments)
        return endpoint

    def start_recorder(self, endpoint: str, mission: str, uavs: Sequence[str], clock: MissionClock) -> None:
        """Start the recorder of what some UAVs say, if this host has one, and wait until it listens."""
        if self._output is None:
            return
        own = own_host(Path(self._certs)) if self._certs else None
        settings = RecorderSettings(
            endpoint=endpoint,
            mission=mission,
            part=str(self._output.part),
            out=str(self._output.path),
            run=run_facts("wall"),
            certs=self._certs,
            certified=own[0] if own is not None else RECORDER,
            parent=os.getpid(),
            clock_ahead_ns=clock.ahead_ns,
            uavs=list(uavs),
        )
        self._spawn(RECORDER, "processes.services.recorder", [], msgspec.json.encode(settings))

    def log(self, name: str) -> Path:
        """Return the path of the log of a part."""
        return self._output.log(name) if name == RECORDER and self._output is not None else self._folder / f"{name}.log"

    def end(self) -> None:
        """Complete the recording, then end the router."""
        for name, timeout_s in ((RECORDER, RECORDER_TIMEOUT_S), (ROUTER, CLOSE_TIMEOUT_S)):
            if name in self._children:
                self._children[name].end(timeout_s)

    def _spawn(self, name: str, module: str, arguments: list[str], orders: bytes | None = None) -> None:
        self._children[name] = Child(
            name, module, arguments, self.log(name), self._loop.inbox.put_always, orders=orders
        )
        self._loop.wait(lambda: name in self.ready, f"the {name} of this host")
