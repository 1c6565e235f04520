"""The table of a figure: one row per line and point, equal to its CSV file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from msgspec import Struct

from edc_swarm.experiments.figures.catalogue import Figure
from edc_swarm.experiments.statistics import estimate


class Row(Struct, frozen=True):
    """One point of one line.

    `ci95_low` and `ci95_high` bound the mean over independent runs (`statistics.estimate`; None for one run),
    `smallest` and `largest` are of single runs, `incomplete` counts runs that are not known to
    have brought every UAV home (None: no run is a flight, or tells).
    """

    figure: str
    series: str
    x_name: str
    x: float
    y_name: str
    runs: int
    mean: float
    ci95_low: float | None
    ci95_high: float | None
    smallest: float
    largest: float
    incomplete: int | None


def rows_of(figure: Figure, runs: int, results: Mapping[str, Any]) -> list[Row]:
    """Return the rows of a figure from the results by key; points without runs are left out."""
    rows = []
    for series in figure.series:
        for x in figure.axis.values:
            samples = [[results[run.key] for run in sample] for sample in figure.samples(series, x, runs)]
            values = [value for sample in samples if math.isfinite(value := series.value(*sample))]
            if not values:
                continue
            mean = estimate(values, figure.kind)
            rows.append(
                Row(
                    figure.name,
                    series.name,
                    figure.axis.field,
                    x,
                    figure.quantity,
                    mean.runs,
                    mean.mean,
                    mean.low,
                    mean.high,
                    min(values),
                    max(values),
                    _incomplete(samples),
                )
            )
    return rows


def _incomplete(samples: Sequence[Sequence[Mapping[str, Any]]]) -> int | None:
    told = [[result.get("completed") for result in sample] for sample in samples]
    if not any(flag is not None for flags in told for flag in flags):
        return None
    return sum(not all(flags) for flags in told)


class Line(Struct, frozen=True):
    """One line of a figure, as parallel lists."""

    x: list[float]
    mean: list[float]
    low: list[float]
    high: list[float]
    runs: int
    largest: float
    incomplete: int | None


def line(rows: Sequence[Row], series: str) -> Line | None:
    """Return the line `series`, None if it has no points."""
    own = [row for row in rows if row.series == series]
    if not own:
        return None
    return Line(
        x=[row.x for row in own],
        mean=[row.mean for row in own],
        low=[row.mean if row.ci95_low is None else row.ci95_low for row in own],
        high=[row.mean if row.ci95_high is None else row.ci95_high for row in own],
        runs=sum(row.runs for row in own),
        largest=max(row.largest for row in own),
        incomplete=sum(counts) if (counts := [row.incomplete for row in own if row.incomplete is not None]) else None,
    )
