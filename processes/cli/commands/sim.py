"""`edc-swarm sim`: the same mission in one process, in virtual time."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import msgspec
from cyclopts import Parameter

from edc_swarm.analysis.timings import Timing, Timings, content_hash
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.fault_help import fault_help
from edc_swarm.mission.plug_ins import plug_ins_of
from edc_swarm.planner.registry import warm_up
from edc_swarm.protocol.codec import encode
from edc_swarm.protocol.messages import Message, MissionMessage, mission_message
from edc_swarm.recording.writer import RecordingWriter
from edc_swarm.simulation.simulator import Simulation, SimulationEnd
from edc_swarm.viz.scenery import Scenery
from processes.cli.conclusion import conclude
from processes.cli.options import MISSION_HELP, MissionOptions
from processes.experiments.timed_planner import TimedPlanner
from processes.runtime.output import Output, default_output, held_for_writing, new_file
from processes.runtime.progress_bar import ProgressBar
from processes.runtime.run_facts import CODE, code_digest, plug_in_facts, run_facts
from processes.services.recorded_view import attach_layout, write_shown


def sim(
    mission_file: Annotated[Path | None, Parameter(help=MISSION_HELP)] = None,
    /,
    *,
    options: MissionOptions | None = None,
) -> int:
    """Simulate a mission: one process, a virtual clock, the same agents, the same recording."""
    options = options or MissionOptions()
    if options.fault_help:
        print(fault_help(), end="")
        return 0
    mission = options.mission(mission_file)
    path = options.out or default_output(mission.name, mission.planner, str(mission.seed))
    with Output(path, force=options.force) as output:
        timings = _simulate(mission, output, viz=not options.no_viz, show_progress=not options.json)
    with new_file(output.path.with_suffix(".timings.json")) as stream:
        stream.write(msgspec.json.encode(Timings(content_hash(output.path), timings)))
    return conclude(output.path, as_json=options.json, load_planner=True)


def _simulate(mission: Mission, output: Output, *, viz: bool, show_progress: bool) -> list[Timing]:
    message, timings = mission_message(mission), list[Timing]()
    warm_up(mission)
    code = code_digest(mission.planner, *plug_ins_of(mission))
    facts = {**run_facts("virtual"), **plug_in_facts(mission), CODE: code}
    with held_for_writing(output.part) as stream:
        writer = RecordingWriter(stream, facts)
        attach_layout(writer, message)
        scenery = Scenery()

        def record(key: str, said: Message, now_ns: int) -> None:
            if viz:
                write_shown(writer, scenery.advance(now_ns))
                scenery.hear(said, now_ns)
            writer.write(key, encode(said), now_ns)

        simulation = Simulation(message, lambda: TimedPlanner(message, timings), record)
        end = _fly(simulation, message, show_progress=show_progress)
        writer.finish({"completed": str(end.completed).lower()})
        output.part.replace(output.path)
    return sorted(timings, key=lambda timing: timing.slot)


def _fly(simulation: Simulation, mission: MissionMessage, *, show_progress: bool) -> SimulationEnd:
    with ProgressBar(mission, shown=show_progress) as bar:
        for _ in simulation.slots():
            bar.show(simulation.monitor)
    return simulation.end()
