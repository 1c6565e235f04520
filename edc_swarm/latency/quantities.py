"""The quantities of a latency experiment: what is drawn, and how a run gives it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from edc_swarm.latency.measures import Sample


@dataclass(frozen=True, slots=True)
class Quantity:
    """One of them: its name in tables and files, its label with the unit, and its value in a run.

    `home` says that only missions that brought every UAV home have it; `share` that it is in per cent.
    """

    name: str
    label: str
    value: Callable[[Sample], float | None]
    home: bool = False
    share: bool = False


QUANTITIES = (
    Quantity("completed_pct", "Missions completed [%]", lambda s: 100.0 * s.completed, share=True),
    Quantity("fix_to_command_ms", "Fix to command, median [ms]", lambda s: s.fix_to_command_ms),
    Quantity("fix_age_ms", "Age of fixes at the head [ms]", lambda s: s.fix_age_ms),
    Quantity("command_age_ms", "Age of commands at the UAVs [ms]", lambda s: s.command_age_ms),
    Quantity("held_pct", "UAV-slots held [%]", lambda s: s.held_pct, share=True),
    Quantity("extra_distance_pct", "Extra distance [%]", lambda s: s.extra_distance_pct, home=True),
    Quantity("makespan_s", "Makespan [s]", lambda s: s.makespan_s, home=True),
    Quantity("energy_kj", "Propulsion energy [kJ]", lambda s: s.energy_kj if s.completed else None, home=True),
    Quantity("min_disc_gap_m", "Least gap of two discs [m]", lambda s: s.min_disc_gap_m),
    Quantity("failover_slots", "Fail-over slots per mission", lambda s: float(s.failover_slots)),
)
