"""The progress bar of a run, on standard error."""

from __future__ import annotations

from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from edc_swarm.mission.configuration import Mission
from edc_swarm.protocol.completion import MissionMonitor


class ProgressBar:
    """Progress bar with slot, head, term, arrived UAVs and the smallest planned gap; empty unless `shown`."""

    def __init__(self, mission: Mission, *, shown: bool) -> None:
        self._uavs = len(mission.roster)
        columns = (TextColumn("{task.fields[state]}"), BarColumn(bar_width=24), TimeElapsedColumn())
        console = Console(stderr=True)
        self._progress = Progress(
            *columns, console=console, transient=True, disable=not (shown and console.is_terminal)
        )
        self._task = self._progress.add_task("", total=self._uavs, state="")

    def __enter__(self) -> ProgressBar:
        self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._progress.stop()

    def show(self, monitor: MissionMonitor) -> None:
        """Show the state of the mission that `monitor` follows."""
        report = monitor.report
        leads = f"head {report.head} term {report.term}  gap {report.min_gap_m:.2f} m" if report else "no head"
        state = f"slot {max(monitor.slot, 0)}  {leads}  arrived {monitor.arrived}/{self._uavs}"
        self._progress.update(self._task, completed=monitor.arrived, state=state)
