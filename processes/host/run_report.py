"""The report of a run on its processes, beside the results that the recording gives."""

from __future__ import annotations

from dataclasses import dataclass

from processes.host.run_state import RunState


@dataclass(frozen=True, slots=True)
class RunReport:
    """Report of a run on its processes.

    `flew`: there was a mission to record; `failed`: a failure ended it, which the last of the `notes` names;
    `last_slot`: the newest slot of which the operator heard a fix, -1 if it heard none.
    """

    flew: bool
    warm_s: float
    connected_s: float
    publishing_s: float | None
    first_flown_slot: int
    interrupted: bool
    failed: bool
    last_slot: int
    notes: list[str]


def report_on(state: RunState) -> RunReport:
    """Return the report of a run that has ended."""
    times, operator, monitor = state.times, state.operator, state.monitor
    publishing_at_s = times.publishing_at_s
    return RunReport(
        flew=monitor is not None,
        warm_s=times.warm_s,
        connected_s=times.connected_at_s - times.ready_at_s,
        publishing_s=None if publishing_at_s is None else publishing_at_s - times.ready_at_s,
        first_flown_slot=operator.seen.first_flown_slot if operator is not None else -1,
        interrupted=state.loop.interrupted,
        failed=state.failed,
        last_slot=monitor.slot if monitor is not None else -1,
        notes=state.notes,
    )
