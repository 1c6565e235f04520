"""The verdicts on a recording: every guarantee, a simulated mission being simulated again for G6."""

from __future__ import annotations

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from edc_swarm.analysis.guarantees.verdict import GuaranteeResult
from edc_swarm.experiments.resimulation import judge
from edc_swarm.recording.model import Recording
from processes.runtime.run_facts import simulated_otherwise


def judged(recording: Recording, *, show_progress: bool = True) -> list[GuaranteeResult]:
    """Return the verdict on every guarantee, G1 to G7; on a terminal a bar shows how far the second simulation is."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(bar_width=24), TimeRemainingColumn())
    with Progress(
        *columns, console=console, transient=True, disable=not (show_progress and console.is_terminal)
    ) as bar:
        task = bar.add_task("simulating again (G6)")
        otherwise = simulated_otherwise(recording.run, recording.mission.planner)
        return judge(recording, otherwise, lambda done, of: bar.update(task, completed=done, total=of))
