"""State of one run, shared by the start, the watch and the end of the launcher."""

from __future__ import annotations

from dataclasses import dataclass

from edc_swarm.protocol.completion import MissionMonitor
from edc_swarm.protocol.events import EventKind
from processes.host.ending import SILENT, Deaths, how_ended
from processes.host.parts import Parts
from processes.host.run_setup import RunSetup
from processes.operator.bus_client import Operator
from processes.runtime.children import PartEndedError
from processes.runtime.loop import Loop
from processes.services.ground_station import NAME as GROUND
from processes.services.visualiser import NAME as VIZ


@dataclass(slots=True)
class RunTimes:
    """Times of the start, in seconds of the monotonic clock; `warm_s` is the duration of the planner's warm start."""

    warm_s: float = 0.0
    ready_at_s: float = 0.0
    connected_at_s: float = 0.0
    publishing_at_s: float | None = None


class RunState:
    """State of one run.

    Attributes
    ----------
    deaths
        Expected deaths of processes, and notes on the others.
    parts
        The processes of this host.
    notes
        Texts for the user: crashes, and the failure that ended the run.
    failed
        True if a failure ended the run.
    operator
        The operator's side of the bus; None before the connection.
    """

    def __init__(self, setup: RunSetup, loop: Loop) -> None:
        self.setup = setup
        self.loop = loop
        self.deaths = Deaths(loop, setup.output.log, self.report_exit)
        self.parts = Parts(setup, loop, self.deaths)
        self.times = RunTimes()
        self.notes: list[str] = []
        self.failed = False
        self.operator: Operator | None = None
        self._end_published = False

    @property
    def bus(self) -> Operator:
        """The operator's side of the bus, which must be connected."""
        assert self.operator is not None
        return self.operator

    @property
    def monitor(self) -> MissionMonitor | None:
        """The monitor of the mission, None before the mission."""
        return self.operator.monitor if self.operator is not None else None

    @property
    def viewers(self) -> set[str]:
        """Names of the living parts that show the mission: the visualiser, the bridge to a ground station."""
        return {VIZ, GROUND} & (self.bus.alive if self.setup.bus is not None else self.parts.children.keys())

    def report_exit(self, text: str, log: str = "") -> None:
        """Note the end of a process with the end of its log, and publish it."""
        self.notes.append("\n".join(filter(None, [text, log])))
        if self.operator is not None:
            self.operator.publish_event(EventKind.EXITED, text)

    def fail(self, who: str, name: str, status: int) -> None:
        """Let the run fail because the process `name` has ended; the first of several ends is the cause."""
        if self.operator is not None:
            self.operator.publish_event(EventKind.EXITED, f"{name} {how_ended(status)}")
        said = self.setup.output.last_line(name) or SILENT
        self.loop.failure = self.loop.failure or PartEndedError(f"the {who} {how_ended(status)}: {said}")

    def publish_end(self, why: str) -> None:
        """Publish the end of the mission, once."""
        if not self._end_published:
            self._end_published = True
            self.bus.publish_event(EventKind.END, why)
