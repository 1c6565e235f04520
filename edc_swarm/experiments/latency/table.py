"""The table of a latency experiment: one row per engine and cell, equal to its CSV file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from msgspec import Struct

from edc_swarm.analysis.latency_sample import Sample
from edc_swarm.experiments.latency.arithmetic import hold_delay_ms, in_time_share, lands, only_holds, starves
from edc_swarm.experiments.latency.declared import Cell, Engine, LatencySweep, mission_of
from edc_swarm.experiments.latency.quantities import QUANTITIES
from edc_swarm.experiments.statistics import Estimate, estimate


class CellRow(Struct, frozen=True, kw_only=True):
    """All runs of one cell.

    Predictions come from the slot arithmetic: `predicted_in_time_pct` is the share of commands in time;
    `predicted_to_hold` is True if none can be in time, which is so from `hold_delay_ms` on; `predicted_to_starve` is
    True if they are too few to fly the longest way within the limit, and `predicted_to_land` if so few that UAVs wait
    for one until they land. `only_holds` is True if only heads flew commands.

    `potential_collisions`, `true_collisions`, `broken`, `not_judged` and `min_disc_gap_m` are over all runs.
    `quantities` are means by name with 95 % intervals over the valid runs that have the quantity; `invalid_runs`
    counts the runs on an overloaded machine.
    """

    engine: Engine
    cell: Cell
    runs: int
    invalid_runs: int
    limit_slots: int
    predicted_in_time_pct: float
    predicted_to_hold: bool
    predicted_to_starve: bool
    predicted_to_land: bool
    hold_delay_ms: float
    only_holds: bool
    potential_collisions: int | None
    true_collisions: int | None
    broken: list[str]
    not_judged: list[str]
    min_disc_gap_m: float | None
    ticks_late_pct: float | None
    terms: float
    quantities: dict[str, Estimate]

    @property
    def completed_pct(self) -> float | None:
        """Share of the valid missions that brought every UAV home, in per cent."""
        found = self.quantities.get("completed_pct")
        return None if found is None else found.mean


def row_of(sweep: LatencySweep, engine: Engine, cell: Cell, samples: Sequence[Sample]) -> CellRow:
    """Return the row of one cell."""
    valid = [sample for sample in samples if not sample.invalid]
    mission = mission_of(sweep, cell, 0)
    share, limit_slots = in_time_share(mission), min(sample.limit_slots for sample in samples)
    return CellRow(
        engine=engine,
        cell=cell,
        runs=len(samples),
        invalid_runs=len(samples) - len(valid),
        limit_slots=limit_slots,
        predicted_in_time_pct=100 * share,
        predicted_to_hold=only_holds(mission),
        predicted_to_starve=starves(mission, share, limit_slots),
        predicted_to_land=lands(mission, share),
        hold_delay_ms=hold_delay_ms(mission),
        only_holds=not any(sample.others_flew for sample in samples),
        potential_collisions=total([sample.potential_collisions for sample in samples]),
        true_collisions=total([sample.true_collisions for sample in samples]),
        broken=sorted({name for sample in samples for name in sample.broken}),
        not_judged=sorted({name for sample in samples for name in sample.not_judged}),
        min_disc_gap_m=min((s.min_disc_gap_m for s in samples if s.min_disc_gap_m is not None), default=None),
        ticks_late_pct=max((s.ticks_late_pct for s in samples if s.ticks_late_pct is not None), default=None),
        terms=sum(sample.terms for sample in samples) / len(samples),
        quantities=_estimates(valid),
    )


def total(counts: Sequence[int | None]) -> int | None:
    """Return the sum of the counts that are known, unless it is 0 only because another is unknown."""
    return sum(filter(None, counts)) or (None if None in counts else 0)


def _estimates(samples: Sequence[Sample]) -> dict[str, Estimate]:
    found = dict[str, Estimate]()
    for quantity in QUANTITIES:
        values = [value for sample in samples if (value := quantity.value(sample)) is not None]
        if values:
            found[quantity.name] = estimate(values, quantity.kind)
    return found


def flat(row: CellRow) -> dict[str, Any]:
    """Return the row as one line of the CSV file."""
    cell = row.cell
    line: dict[str, Any] = {
        "engine": row.engine,
        **{name: getattr(cell, name) for name in ("uavs", "slot_s", "delay_ms", "jitter_ms", "loss")},
        **{name: getattr(row, name) for name in row.__struct_fields__ if name not in {"engine", "cell", "quantities"}},
        "broken": " ".join(row.broken),
        "not_judged": " ".join(row.not_judged),
    }
    for quantity in QUANTITIES:
        found = row.quantities.get(quantity.name)
        key = "mean_" + quantity.name if quantity.name in line else quantity.name
        line |= {key: found and found.mean, f"{key}_low": found and found.low, f"{key}_high": found and found.high}
    return line


def rows_of(sweep: LatencySweep, engine: Engine, results: Mapping[Cell, Sequence[Sample]]) -> list[CellRow]:
    """Return all rows of an engine, in the order of the cells."""

    return [row_of(sweep, engine, cell, results[cell]) for cell in sweep.cells]
