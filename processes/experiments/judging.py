"""The verdicts on a recording: every guarantee, a simulated mission being simulated again for G6."""

from __future__ import annotations

from functools import partial

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

from edc_swarm.analysis.guarantees.verdict import GuaranteeResult
from edc_swarm.experiments.resimulation import foreign_parts, judge
from edc_swarm.mission.plug_ins import plug_ins_of
from edc_swarm.recording.model import Recording
from processes.runtime.run_facts import simulated_otherwise


def judged(recording: Recording, *, show_progress: bool = True, load_planner: bool = False) -> list[GuaranteeResult]:
    """Return the verdict on every guarantee, G1 to G8; on a terminal a bar shows how far the second simulation is.

    A planner that is not this project's is loaded, to judge G6, only with `load_planner`.
    """
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(bar_width=24), TimeRemainingColumn())
    with Progress(
        *columns, console=console, transient=True, disable=not (show_progress and console.is_terminal)
    ) as bar:
        task = bar.add_task("simulating again (G6)", visible=False)
        mission, otherwise = recording.mission, ""
        if load_planner or not foreign_parts(mission):
            otherwise = simulated_otherwise(recording.run, mission.planner, *plug_ins_of(mission))
        watch = partial(_show, bar, task)
        return judge(recording, otherwise, watch, load_planner=load_planner)


def _show(bar: Progress, task: TaskID, done: int, of: int) -> None:
    bar.update(task, completed=done, total=of, visible=True)
