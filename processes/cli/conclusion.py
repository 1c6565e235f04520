"""The end of `run` and `sim`: metrics and guarantees, read back from the recording that was written."""

from __future__ import annotations

from pathlib import Path

import msgspec

from edc_swarm.analysis.metrics import OVERLOADED_PCT, Metrics, compute_metrics
from edc_swarm.analysis.timings import load_timings
from edc_swarm.recording.model import Recording
from edc_swarm.recording.reader import read_recording
from edc_swarm.recording.repeats import failed_plans
from processes.cli.summary import guarantees_status, print_guarantees, print_metrics
from processes.experiments.judging import judged
from processes.runtime.console import FAILED, NOT_JUDGED, note, print_json, stdout_console


def conclude(path: Path, *, as_json: bool, last_slot: int = -1, load_planner: bool = False) -> int:
    """Print metrics and guarantees of the recording at `path`; return the exit status.

    `load_planner`: the user named the planner, so that G6 may load it. `last_slot` is the newest slot that the operator
    saw: a recording that ends before it is not all of the run.
    """
    recording = read_recording(path)
    metrics = compute_metrics(recording, load_timings(path, note))
    guarantees = judged(recording, show_progress=not as_json, load_planner=load_planner)
    if as_json:
        print_json({**msgspec.to_builtins(metrics), "guarantees": guarantees, "recording": str(path)})
    else:
        console = stdout_console()
        print_metrics(metrics, console)
        print_guarantees(guarantees, console, limit=3)
        print(path)
    _warn(recording, metrics)
    recorded_slot = (metrics.slots or 0) - 1
    if recorded_slot < last_slot:
        note(f"warning: the operator saw slot {last_slot}, the recording ends at slot {recorded_slot}")
    status = FAILED if metrics.completed is False else guarantees_status(guarantees)
    return status or (NOT_JUDGED if metrics.completed is None or recorded_slot < last_slot else 0)


def _warn(recording: Recording, metrics: Metrics) -> None:
    """Warn of plans that failed or came too late, and of an overloaded machine."""
    mission = recording.mission
    if failed := failed_plans(recording):
        note(f"warning: {failed}")
    slot_ms, slowest_ms = mission.slot_ns / 1e6, metrics.plan_ms.max or 0.0
    if slowest_ms > slot_ms:
        note(f"warning: a plan took {slowest_ms:.0f} ms, a slot is {slot_ms:g} ms: too late for real UAVs, which hold")
    if metrics.ticks_late_pct is not None and metrics.ticks_late_pct > OVERLOADED_PCT:
        note(f"warning: the machine was overloaded: {metrics.ticks_late_pct:.1f} % of the ticks were late")
