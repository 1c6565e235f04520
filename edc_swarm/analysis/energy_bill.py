"""The energy that each UAV spent on cruise, hover, radio and computation, from a recording alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from edc_swarm.analysis.columns import Floats, columns_of
from edc_swarm.analysis.guarantees.evidence import gather
from edc_swarm.analysis.timings import Timing, measured
from edc_swarm.emulation.energy import compute_energy_j
from edc_swarm.protocol.events import EventKind
from edc_swarm.recording.model import Recording
from edc_swarm.recording.repeats import plans_of


class EnergyBill(Struct, frozen=True, kw_only=True):
    """One UAV's energy over the whole run, waiting for the others at the target included.

    Cruise is every slot in which it moved, hover every other one; radio is what it sent, compute
    what it planned as head. `left_j` is the battery in its last fix. None: not measured, since the record lacks
    fixes of the UAV (`radio_j`, `total_j`, `slots_led`: or commands or reports of it as head).
    """

    uav: str
    cruise_s: float | None
    cruise_j: float | None
    hover_s: float | None
    hover_j: float | None
    radio_j: float | None
    compute_j: float | None
    total_j: float | None
    left_j: float | None
    slots_led: int | None


class Exhausted(Struct, frozen=True):
    """A UAV whose battery is empty: from this slot on it does not move."""

    uav: str
    slot: int


def energy_bills(recording: Recording, timings: Sequence[Timing] = ()) -> list[EnergyBill]:
    """Return the bill of every UAV in roster order. `timings`, if given, replace the recorded plan times."""
    mission, columns, evidence = recording.mission, columns_of(recording), gather(recording)
    slot_j = columns.slot_j
    sent, (plan_s, led) = _messages_sent(recording), _head_work(recording, timings)
    bills = []
    for k, entry in enumerate(mission.roster):
        uav = entry.uav
        flown, reported = not evidence.lacks(uav, "fix"), not evidence.lacks(uav, "report")
        told = flown and reported and not evidence.lacks(uav, "command")
        moving = columns.step_m[:, k] > 0
        cruise, hover = moving & columns.alive[:, k], ~moving & columns.alive[:, k]
        planned_s = plan_s.get(uav, 0.0)
        parts_j = (
            float(slot_j[cruise, k].sum()) if flown else None,
            float(slot_j[hover, k].sum()) if flown else None,
            sent.get(uav, 0) * mission.energy.radio_j_per_message if told else None,
            compute_energy_j(planned_s, mission.head) if reported and planned_s is not None else None,
        )
        cruise_j, hover_j, radio_j, compute_j = parts_j
        known_j = [part for part in parts_j if part is not None]
        bills.append(
            EnergyBill(
                uav=uav,
                cruise_s=float(cruise.sum() * mission.dt_s) if flown else None,
                cruise_j=cruise_j,
                hover_s=float(hover.sum() * mission.dt_s) if flown else None,
                hover_j=hover_j,
                radio_j=radio_j,
                compute_j=compute_j,
                total_j=sum(known_j) if len(known_j) == len(parts_j) else None,
                left_j=_last(columns.energy_j[:, k]),
                slots_led=led.get(uav, 0) if reported else None,
            )
        )
    return bills


def exhausted(recording: Recording) -> list[Exhausted]:
    """Return the UAVs whose battery became empty, in the order of time."""
    return [Exhausted(event.source, event.slot) for event in recording.events if event.kind == EventKind.BATTERY_EMPTY]


def _messages_sent(recording: Recording) -> dict[str, int]:
    """Return the number of messages that each UAV sent by radio, without truths, which the emulation sends."""
    sent: dict[str, int] = {}
    senders = [f.uav for f in recording.fixes] + [c.head for c in recording.commands]
    for uav in senders + [r.head for r in recording.reports]:
        sent[uav] = sent.get(uav, 0) + 1
    return sent


def _head_work(recording: Recording, timings: Sequence[Timing]) -> tuple[dict[str, float | None], dict[str, int]]:
    """Return the seconds that each head planned (None if a plan was not timed), and the number of slots that it led."""
    in_slot_ms: dict[int, list[float]] = {}
    for timing in measured(recording, timings):
        in_slot_ms.setdefault(timing.slot, []).append(timing.plan_ms)
    plan_s: dict[str, float | None] = {}
    led: dict[str, int] = {}
    for report in plans_of(recording):
        times_ms = in_slot_ms.get(report.slot)
        plan_ms = times_ms.pop(0) if times_ms else report.plan_ms
        before_s = plan_s.get(report.head, 0.0)
        plan_s[report.head] = before_s + plan_ms / 1e3 if plan_ms and before_s is not None else None
        led[report.head] = led.get(report.head, 0) + 1
    return plan_s, led


def _last(battery_j: Floats) -> float | None:
    known = battery_j[~np.isnan(battery_j)]
    return float(known[-1]) if len(known) else None
