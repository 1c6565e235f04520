"""A flown mission in a notebook: its recording, and everything that follows from it."""

from __future__ import annotations

import shutil
import warnings
import weakref
from collections.abc import Iterable
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from edc_swarm.analysis.columns import columns_of
from edc_swarm.analysis.frames import frame_of, new_frame
from edc_swarm.analysis.guarantees.verdict import GuaranteeResult
from edc_swarm.analysis.metrics import Metrics, compute_metrics
from edc_swarm.analysis.timings import Timing, load_timings
from edc_swarm.errors import InputError
from edc_swarm.mission.configuration import Mission
from edc_swarm.recording.model import Recording
from edc_swarm.recording.reader import read_recording
from edc_swarm.recording.repeats import failed_plans
from processes.experiments.judging import judged
from processes.notebook.page import EmbeddedPage
from processes.notebook.pictures import draw_paths
from processes.runtime.output import SUFFIX, check_new, new_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TIMINGS = ".timings.json"


class Flight:
    """A mission that was flown, in the simulator or by real processes.

    Nothing is computed before it is asked for. Frames are of pandas (extra `notebook`), with units in the names of
    their columns; what the recording does not tell is NaN or None.

    Attributes
    ----------
    path
        The recording, an MCAP file. That of `simulate` is temporary: `save` keeps it.
    """

    def __init__(self, path: Path, *, own: bool = False) -> None:
        self.path = path
        self._own = own
        """True for a simulation of this process: its recording is temporary, and names no stranger's code."""
        if own:
            weakref.finalize(self, shutil.rmtree, path.parent, ignore_errors=True)

    def __repr__(self) -> str:
        """Return how many arrived, which guarantees do not hold, and the first error of a planner of the user."""
        metrics, mission = self.metrics, self.mission
        arrived = "-" if metrics.arrived is None else metrics.arrived
        applying = [each for each in self.verdicts if each.status != "not-applicable"]
        others = [f"{each.guarantee} {each.status}" for each in applying if not each.held]
        all_held = "every guarantee held" if applying == self.verdicts else "every guarantee that applies held"
        said = [f"{arrived} arrived", ", ".join(others) or all_held, failed_plans(self.recording)]
        return f"<Flight of {mission.uavs} UAVs, planner {mission.planner}: {'; '.join(filter(None, said))}>"

    @cached_property
    def recording(self) -> Recording:
        """Every message, as structs (docs/messages.md)."""
        return read_recording(self.path)

    @property
    def mission(self) -> Mission:
        """The mission as flown: every field, the roster filled in."""
        return self.recording.mission

    @cached_property
    def timings(self) -> list[Timing]:
        """The measured plan time of each slot of a simulation; empty if unknown."""
        return load_timings(self.path, warnings.warn)

    @cached_property
    def metrics(self) -> Metrics:
        """All metrics (docs/metrics.md); None is unknown."""
        return compute_metrics(self.recording, self.timings)

    @cached_property
    def verdicts(self) -> list[GuaranteeResult]:
        """The verdict on each guarantee, G1 to G8; a simulation is simulated a second time for G6."""
        return judged(self.recording, show_progress=False, load_planner=self._own)

    @cached_property
    def tracks(self) -> Any:
        """A frame with a row for each UAV and slot: centres of its disc, step, distance from the target, battery."""
        return frame_of(columns_of(self.recording, self.timings))

    @cached_property
    def fixes(self) -> Any:
        """A frame with a row for each fix."""
        return _frame(self.recording.fixes)

    @cached_property
    def commands(self) -> Any:
        """A frame with a row for each command."""
        return _frame(self.recording.commands)

    @cached_property
    def reports(self) -> Any:
        """A frame with a row for each report of a head."""
        return _frame(self.recording.reports)

    @cached_property
    def events(self) -> Any:
        """A frame with a row for each event."""
        return _frame(self.recording.events)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the way of every disc's centre, the starts, targets and zones; return the axes.

        Raises
        ------
        InputError
            matplotlib (extra `notebook`) is not installed.
        """
        return draw_paths(self.recording, columns_of(self.recording, self.timings), ax)

    def animate(self, height_px: int = 760) -> EmbeddedPage:
        """Return the report page with the animated mission, which a notebook shows in place."""
        return EmbeddedPage.of(self.recording, self.metrics, self.verdicts, self.timings, height_px)

    def save(self, path: str | Path, *, force: bool = False) -> Path:
        """Copy the recording, with the plan times beside it, to a new file; `force` overwrites one.

        Raises
        ------
        InputError
            The file exists, or cannot be written.
        """
        path = Path(path)
        check_new(path, SUFFIX, force=force)
        for source in (self.path, self.path.with_suffix(TIMINGS)):
            if source.exists():
                with new_file(path.with_suffix(source.suffix if source == self.path else TIMINGS)) as stream:
                    stream.write(source.read_bytes())
        return path


def load(path: str | PathLike[str]) -> Flight:
    """Return the flight of a recording.

    Raises
    ------
    RecordingError
        The file cannot be read, or is not a recording.
    InputError
        `path` is no path.
    """
    if not isinstance(path, (str, PathLike)) or "\0" in str(path):
        raise InputError("path", path, "the path of a recording")
    flight = Flight(Path(path))
    _ = flight.recording
    return flight


def _frame(messages: Iterable[msgspec.Struct]) -> Any:
    return new_frame([msgspec.to_builtins(message) for message in messages])
