"""Runs of a sweep with real processes, one mission at a time, with every recording kept."""

from __future__ import annotations

import hashlib
import signal
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

import msgspec

from edc_swarm.analysis.latency_sample import sample_of
from edc_swarm.experiments.latency.declared import run_name
from edc_swarm.experiments.sweeps import Run
from edc_swarm.mission.roster import complete_mission
from edc_swarm.recording.reader import read_recording
from processes.experiments.ledger import SweepError, code_fingerprint
from processes.host.launcher import Launcher
from processes.host.run_report import RunReport
from processes.host.run_setup import View
from processes.runtime.children import PartEndedError
from processes.runtime.console import note
from processes.runtime.limits import make_room
from processes.runtime.output import SUFFIX, Output
from processes.runtime.voice import Voice

RESULT_NEUTRAL_PACKAGES = ("cli", "experiments")
"""Packages of `processes` that cannot change the result of a mission."""
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Launched:
    """A scheduler (`processes.experiments.ledger.Scheduler`) that executes every run as `edc-swarm run` does."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def results(self, runs: Sequence[Run]) -> Iterator[tuple[Run, Any, float]]:
        """See `Scheduler`.

        Raises
        ------
        SweepError
            A mission could not be executed.
        PartEndedError
            A process that the mission needs ended.
        KeyboardInterrupt
            Ctrl-C, raised after all processes have ended.
        """
        for run in runs:
            begun_s = time.process_time()
            yield run, fly(run, self._folder), time.process_time() - begun_s


def fly(run: Run, folder: Path) -> dict[str, Any]:
    """Execute a mission with real processes, keep its recording in `folder`, and return the measurements."""
    path = folder / (run_name(run.mission) + SUFFIX)
    report = _launch(run, path)
    for text in report.notes:
        note(text)
    if report.interrupted:
        path.unlink(missing_ok=True)
        raise KeyboardInterrupt
    if report.failed:
        raise PartEndedError(f"{run.command}: the mission failed")
    if not report.flew:
        raise SweepError(f"{run.command}: no mission was flown")
    sample: dict[str, Any] = msgspec.to_builtins(sample_of(read_recording(path)))
    return sample


def _launch(run: Run, path: Path) -> RunReport:
    with Output(path, force=True) as output, _signals_kept():
        mission = complete_mission(run.mission)
        make_room(len(mission.roster))
        report = Launcher(mission, output, listen=None, view=View(viz=False), voice=Voice(quiet=True)).run()
        if output.part.exists():
            output.recover_part()
    return report


@contextmanager
def _signals_kept() -> Iterator[None]:
    """Restore the signal handlers that the launcher replaces in this context."""
    before = {number: signal.getsignal(number) for number in SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@lru_cache(maxsize=1)
def launched_fingerprint() -> str:
    """Return a digest of everything that can change the results of real processes: library and processes."""
    digest = hashlib.sha256(code_fingerprint().encode())
    processes = Path(__file__).parents[1]
    for path in sorted(processes.rglob("*.py")):
        if path.relative_to(processes).parts[0] not in RESULT_NEUTRAL_PACKAGES:
            digest.update(path.read_bytes())
    digest.update(Path(__file__).read_bytes())
    return digest.hexdigest()[:16]
