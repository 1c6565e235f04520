"""The quantities of a latency experiment, with their values in a run and their labels in figures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from edc_swarm.analysis.latency_sample import Sample
from edc_swarm.experiments.statistics import Kind


@dataclass(frozen=True, slots=True)
class Quantity:
    """A quantity: its name in tables and files, its label with the unit, and its value in a run.

    `kind` decides the interval (`statistics.estimate`), `logarithmic` is True for a logarithmic axis.
    """

    name: str
    label: str
    value: Callable[[Sample], float | None]
    kind: Kind = "amount"
    logarithmic: bool = False


def _fix_age_ms(sample: Sample) -> float | None:
    """Return the age of fixes, None in a run without a head, which would use them."""
    return sample.fix_age_ms if sample.terms else None


def _failover_slots(sample: Sample) -> float | None:
    return None if sample.failover_slots is None else float(sample.failover_slots)


def _command_age_ms(sample: Sample) -> float | None:
    """Return the age of commands, None if only heads flew, since the age is the mission's declared length then."""
    return sample.command_age_ms if sample.others_flew else None


def _completed_pct(sample: Sample) -> float | None:
    return None if sample.completed is None else 100.0 * sample.completed


QUANTITIES = (
    Quantity("completed_pct", "Missions completed [%]", _completed_pct, "share of runs"),
    Quantity("fix_to_command_ms", "Fix to command, median [ms]", lambda s: s.fix_to_command_ms),
    Quantity("fix_age_ms", "Age of fixes at the head [ms]", _fix_age_ms, logarithmic=True),
    Quantity("command_age_ms", "Age of commands at the UAVs [ms]", _command_age_ms, logarithmic=True),
    Quantity("held_pct", "UAV-slots held [%]", lambda s: s.held_pct, "per cent"),
    Quantity("extra_distance_pct", "Extra distance [%]", lambda s: s.extra_distance_pct),
    Quantity("makespan_s", "Makespan [s]", lambda s: s.makespan_s),
    Quantity("energy_kj", "Propulsion energy [kJ]", lambda s: s.energy_kj if s.completed else None),
    Quantity("min_disc_gap_m", "Least gap of two discs [m]", lambda s: s.min_disc_gap_m, "signed"),
    Quantity("failover_slots", "Fail-over slots per mission", _failover_slots, "count"),
)
