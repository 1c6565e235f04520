"""What each UAV spent its battery on, from a recording alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from edc_swarm.analysis.metrics import Floats, Timing, columns_of, measured
from edc_swarm.emulation.energy import compute_energy_j, propulsion_power_w, propulsion_powers_w
from edc_swarm.mission.configuration import Mission
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.messages import PLANNED
from edc_swarm.recording.model import Recording


class EnergyBill(Struct, frozen=True, kw_only=True):
    """One UAV's energy over the whole run, waiting for the others at the target included.

    Cruise is every slot in which it moved, hover every other one; radio is what it sent, compute
    what it planned as head. `left_j` is the battery in its last fix. None: not measured.
    """

    uav: str
    cruise_s: float
    cruise_j: float
    hover_s: float
    hover_j: float
    radio_j: float
    compute_j: float | None
    total_j: float | None
    left_j: float | None
    slots_led: int


class Exhausted(Struct, frozen=True):
    """A UAV whose battery ran empty: from this slot on it is an obstacle."""

    uav: str
    slot: int


def energy_bills(recording: Recording, timings: Sequence[Timing] = ()) -> list[EnergyBill]:
    """The bill of every UAV, in roster order. `timings`, when given, replace the recorded plan times."""
    mission, columns = recording.mission, columns_of(recording)
    slot_j = _slot_energy_j(mission, columns.step_m)
    sent, (plan_s, led) = _messages_sent(recording), _head_work(recording, timings)
    bills = []
    for k, entry in enumerate(mission.roster):
        moving = columns.step_m[:, k] > 0
        cruise, hover = moving & columns.alive[:, k], ~moving & columns.alive[:, k]
        spent_j = {
            "cruise_j": float(slot_j[cruise, k].sum()),
            "hover_j": float(slot_j[hover, k].sum()),
            "radio_j": sent.get(entry.uav, 0) * mission.energy.radio_j_per_message,
        }
        planned_s = plan_s.get(entry.uav, 0.0)
        compute_j = None if planned_s is None else compute_energy_j(planned_s, mission.head)
        bills.append(
            EnergyBill(
                uav=entry.uav,
                cruise_s=float(cruise.sum() * mission.dt_s),
                hover_s=float(hover.sum() * mission.dt_s),
                **spent_j,
                compute_j=compute_j,
                total_j=None if compute_j is None else sum(spent_j.values()) + compute_j,
                left_j=_last(columns.energy_j[:, k]),
                slots_led=led.get(entry.uav, 0),
            )
        )
    return bills


def _slot_energy_j(mission: Mission, step_m: Floats) -> Floats:
    """Propulsion energy of every slot, as a UAV's battery pays it: flown outside the guards, hovered within."""
    flown_s = mission.dt_s - 2 * mission.guard_s
    hovered_j = propulsion_power_w(0.0, mission.energy) * (mission.dt_s - flown_s)
    return propulsion_powers_w(step_m / flown_s, mission.energy) * flown_s + hovered_j


def exhausted(recording: Recording) -> list[Exhausted]:
    """UAVs that fell out with an empty battery, in the order in which they did."""
    return [Exhausted(event.source, event.slot) for event in recording.events if event.kind == EventKind.BATTERY_EMPTY]


def _messages_sent(recording: Recording) -> dict[str, int]:
    """Messages that each UAV put on the air; truths are the emulator's."""
    sent: dict[str, int] = {}
    senders = [f.uav for f in recording.fixes] + [c.head for c in recording.commands]
    for uav in senders + [r.head for r in recording.reports]:
        sent[uav] = sent.get(uav, 0) + 1
    return sent


def _head_work(recording: Recording, timings: Sequence[Timing]) -> tuple[dict[str, float | None], dict[str, int]]:
    """Seconds that each head planned (None where a plan was not timed), and slots that it led."""
    in_slot_ms: dict[int, list[float]] = {}
    for timing in measured(recording, timings):
        in_slot_ms.setdefault(timing.slot, []).append(timing.plan_ms)
    plan_s: dict[str, float | None] = {}
    led: dict[str, int] = {}
    for report in recording.reports:
        if report.status in PLANNED:
            times_ms = in_slot_ms.get(report.slot)
            plan_ms = times_ms.pop(0) if times_ms else report.plan_ms
            before_s = plan_s.get(report.head, 0.0)
            plan_s[report.head] = before_s + plan_ms / 1e3 if plan_ms and before_s is not None else None
            led[report.head] = led.get(report.head, 0) + 1
    return plan_s, led


def _last(battery_j: Floats) -> float | None:
    known = battery_j[~np.isnan(battery_j)]
    return float(known[-1]) if len(known) else None
