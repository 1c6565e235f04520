"""Ends of processes on one host, for launcher and joiner: expected deaths, notes on crashes, the orderly end."""

from __future__ import annotations

import signal
from collections.abc import Callable, Collection
from pathlib import Path

from edc_swarm.mission.autopilots import autopilots
from edc_swarm.mission.configuration import Mission
from processes.host.pool import UavPool
from processes.runtime.children import Child
from processes.runtime.loop import Loop
from processes.runtime.output import log_tail
from processes.uav.autopilot_part import LANDING_SPARE_S
from processes.uav.flight import FLY_OUT_SLOTS

CLOSE_TIMEOUT_S = 1.2
"""Longest wait for a process to end in order."""
RECORDER_TIMEOUT_S = 30.0
"""Longest wait for the recorder to finish a recording."""
SILENT = "it said nothing"
"""Words in place of the log of a process that wrote nothing."""


class Deaths:
    """Deaths of processes: it reports a death that no fault and no order has caused.

    `log` returns the log of a process. `report` takes the words of an unexpected death and the end of that log.
    """

    def __init__(self, loop: Loop, log: Callable[[str], Path], report: Callable[[str, str], None]) -> None:
        self._loop = loop
        self._log = log
        self._report = report
        self.expected: set[str] = set()

    def take(self, name: str, status: int) -> None:
        """Take in the end of a process; report it if it is a crash: unexpected, with a status other than 0."""
        expected = name in self.expected or self._loop.ending
        self.expected.discard(name)
        if not expected and status != 0:
            self._report(f"{name} {how_ended(status)}", log_tail(self._log(name)))


def how_ended(status: int) -> str:
    """Return in words how a process ended."""
    return f"was ended by {signal.Signals(-status).name}" if status < 0 else f"ended with status {status}"


def begin_end(loop: Loop, pool: UavPool | None) -> None:
    """Mark the command as ending: failures no longer matter, and no UAV starts again."""
    loop.ending = True
    if pool is not None:
        pool.to_restart.clear()


def landing_s(mission: Mission, uavs: Collection[str], *, arm: bool) -> float:
    """Return how long the autopilots of some UAVs may take to end their flights and land; 0 if none was armed."""
    if not arm or autopilots(mission).keys().isdisjoint(uavs):
        return 0.0
    return FLY_OUT_SLOTS * mission.dt_s + mission.landing_s + LANDING_SPARE_S


def end_fork_source(pool: UavPool | None, source: Child | None) -> None:
    """End the fork source and with it all UAVs that it has forked."""
    if pool is not None:
        pool.close()
    if source is not None:
        source.end(CLOSE_TIMEOUT_S)
