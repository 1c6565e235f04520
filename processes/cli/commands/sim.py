"""`edc-swarm sim`: the same mission in one process, in virtual time."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import msgspec
from cyclopts import Parameter

from edc_swarm.analysis.timings import Timing, Timings, content_hash
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.fault_help import fault_help
from edc_swarm.protocol.messages import Message, MissionMessage, mission_message
from edc_swarm.simulation.simulator import Simulation, SimulationEnd
from edc_swarm.story.teller import Storyteller
from processes.cli.conclusion import conclude
from processes.cli.options import MISSION_HELP, MissionOptions
from processes.experiments.recorded_simulation import RecordedSimulation
from processes.runtime.compiling import CompilingNote
from processes.runtime.display import Display
from processes.runtime.output import Output, default_output, held_for_writing, new_file
from processes.runtime.voice import Voice
from processes.uav.planner_loader import warm_planner


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
        timings = _simulate(mission, output, viz=not options.no_viz, voice=options.voice)
    with new_file(output.path.with_suffix(".timings.json")) as stream:
        stream.write(msgspec.json.encode(Timings(content_hash(output.path), timings)))
    return conclude(output.path, as_json=options.json, load_planner=True)


def _simulate(mission: Mission, output: Output, *, viz: bool, voice: Voice) -> list[Timing]:
    message = mission_message(mission)
    compiling = CompilingNote(voice)
    warm_planner(mission, compiling.tell, helped=True)
    compiling.end()
    teller = Storyteller(message)

    def hear(said: Message) -> None:
        if voice.shows_bar or voice.verbose:
            teller.hear(said)

    with held_for_writing(output.part) as stream:
        recorded = RecordedSimulation(message, stream, hear, viz=viz)
        end = _fly(recorded.simulation, message, teller, voice)
        timings = recorded.finish(end)
        output.part.replace(output.path)
    return timings


def _fly(simulation: Simulation, mission: MissionMessage, teller: Storyteller, voice: Voice) -> SimulationEnd:
    spoken = voice if voice.verbose else Voice(quiet=not voice.shows_bar)  # A simulation is over in a moment.
    with Display(mission, spoken) as display:
        for slot in simulation.slots():
            display.show(simulation.monitor, teller, slot)
        end = simulation.end()
        display.show(simulation.monitor, teller, simulation.monitor.slot + 1)
    return end
