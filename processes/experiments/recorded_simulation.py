"""A simulated mission that is written to a recording as it is flown."""

from __future__ import annotations

from collections.abc import Callable
from typing import BinaryIO

from edc_swarm.analysis.timings import Timing
from edc_swarm.mission.plug_ins import plug_ins_of
from edc_swarm.protocol.codec import encode
from edc_swarm.protocol.messages import Message, MissionMessage
from edc_swarm.recording.writer import RecordingWriter
from edc_swarm.simulation.simulator import Simulation, SimulationEnd
from edc_swarm.viz.scenery import Scenery
from processes.experiments.timed_planner import TimedPlanner
from processes.runtime.run_facts import CODE, code_digest, plug_in_facts, run_facts
from processes.services.recorded_view import attach_layout, write_shown


class RecordedSimulation:
    """A simulation whose every message goes to a recording; `viz` adds what Foxglove shows.

    Attributes
    ----------
    simulation
        To be flown by who made this, who then calls `finish`.
    timings
        Measured plan times so far, which are no part of the recording.
    """

    def __init__(
        self, mission: MissionMessage, stream: BinaryIO, hear: Callable[[Message], None], *, viz: bool
    ) -> None:
        self._code = code_digest(mission.planner, *plug_ins_of(mission))
        self._writer = RecordingWriter(stream, {**run_facts("virtual"), **plug_in_facts(mission), CODE: self._code})
        self._scenery = Scenery() if viz else None
        self._hear = hear
        self._timings: list[Timing] = []
        attach_layout(self._writer, mission)
        self.simulation = Simulation(mission, lambda: TimedPlanner(mission, self._timings), self._record)

    def _record(self, key: str, said: Message, now_ns: int) -> None:
        if self._scenery is not None:
            write_shown(self._writer, self._scenery.advance(now_ns))
            self._scenery.hear(said, now_ns)
        self._writer.write(key, encode(said), now_ns)
        self._hear(said)

    def finish(self, end: SimulationEnd) -> list[Timing]:
        """Write the end of the recording; return the plan times in order of slots."""
        self._writer.finish({"completed": str(end.completed).lower()})
        return sorted(self._timings, key=lambda timing: timing.slot)
