"""Plots of latency experiments: a panel for each jitter and number of UAVs, with means and 95 % intervals.

Lines of the simulator are solid with filled markers; those of real processes are dashed with hollow markers. Shares of
a few missions have intervals so wide that their bands would hide each other: bars stand for them, and the lines lie a
little apart. A dotted line marks the delay at which two delays fill a slot. The title gives engine, slot and missions
per point.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from edc_swarm.experiments.latency.quantities import Quantity
from edc_swarm.experiments.latency.table import CellRow
from processes.experiments.plots import RC, save, set_ticks

Axis = Literal["delay_ms", "loss"]
PANEL_IN = (2.7, 2.2)
LEGEND_IN = 0.8
CHARACTER_IN, HANDLE_IN = 0.075, 0.6
"""Width of a character of the legend, and of the handle before a label."""
LEAST_OF_MEAN = 0.1
"""Lower end of a band on a logarithmic axis, as a share of its mean."""
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9", "#000000", "#999999")
"""M. Okabe, K. Ito, "Color Universal Design", 2008."""
MARKERS = "osD^vP*X"
APART = 0.012
"""Distance of lines that lie apart, as a share of the axis."""
LABELS: dict[Axis, str] = {"delay_ms": "Delay [ms]", "loss": "Loss [%]"}
OTHER: dict[Axis, Axis] = {"delay_ms": "loss", "loss": "delay_ms"}
SMALL: Any = {"svg.fonttype": "none", "font.sans-serif": ["DejaVu Sans", "Verdana", "sans-serif"]}
"""Settings that keep text in SVG files as text, not as outlines, which halves their size."""
DASHES = {"sim": "-", "processes": "--"}
ENGINES = {"sim": "simulated", "processes": "real processes"}
HOLDS = "two delays fill the slot"


@dataclass(frozen=True, slots=True)
class Panel:
    """Rows of one panel: one swarm, one jitter, all delays and losses."""

    uavs: int
    jitter_ms: float
    rows: list[CellRow]


def draw_quantity(quantity: Quantity, axis: Axis, rows: Sequence[CellRow], stem: Path) -> None:
    """Write `stem`.png, `stem`.svg and `stem`.pdf; all rows are of one slot length."""
    from matplotlib import pyplot as plt  # noqa: PLC0415 - an extra

    uavs = list(dict.fromkeys(row.cell.uavs for row in rows))
    jitters_ms = list(dict.fromkeys(row.cell.jitter_ms for row in rows))
    width_in, height_in = PANEL_IN
    size_in = (max(4.2, width_in * len(jitters_ms) + 0.6), height_in * len(uavs) + LEGEND_IN)
    with plt.rc_context({**RC, **SMALL}):
        picture, grid = plt.subplots(
            len(uavs), len(jitters_ms), figsize=size_in, sharex=True, sharey="row", squeeze=False, layout="constrained"
        )
        for line, count in zip(grid, uavs, strict=True):
            for axes, jitter_ms in zip(line, jitters_ms, strict=True):
                own = [row for row in rows if (row.cell.uavs, row.cell.jitter_ms) == (count, jitter_ms)]
                _draw_panel(axes, quantity, axis, Panel(count, jitter_ms, own))
        _finish(picture, grid, quantity, axis)
        picture.suptitle(_what_was_flown(rows), fontsize=8)
        save(picture, stem)


def _what_was_flown(rows: Sequence[CellRow]) -> str:
    engines = " and ".join(ENGINES[engine] for engine in dict.fromkeys(row.engine for row in rows))
    least, most = (pick(row.runs - row.invalid_runs for row in rows) for pick in (min, max))
    missions = f"{least}" if least == most else f"{least} to {most}"
    return f"{engines}, slot {rows[0].cell.slot_s:g} s, valid missions a point: {missions}, mean and 95 % interval"


def _draw_panel(axes: Any, quantity: Quantity, axis: Axis, panel: Panel) -> None:
    others = list(dict.fromkeys(getattr(row.cell, OTHER[axis]) for row in panel.rows))
    for engine in dict.fromkeys(row.engine for row in panel.rows):
        for index, other in enumerate(others):
            line = [row for row in panel.rows if row.engine == engine and getattr(row.cell, OTHER[axis]) == other]
            _draw_line(axes, quantity, axis, line, index)
    if axis == "delay_ms" and panel.rows:
        axes.axvline(panel.rows[0].hold_delay_ms, color="#555555", linestyle=":", linewidth=1, label=HOLDS)
    axes.set_title(f"{panel.uavs} UAVs, jitter {panel.jitter_ms:g} ms", fontsize=9, loc="left")
    values = sorted({getattr(row.cell, axis) for row in panel.rows})
    labels = [f"{100 * value if axis == 'loss' else value:g}" for value in values]
    set_ticks(axes, values, labels, PANEL_IN[0], fontsize=7)


def _draw_line(axes: Any, quantity: Quantity, axis: Axis, rows: Sequence[CellRow], index: int) -> None:
    known = [(row, found) for row in rows if (found := row.quantities.get(quantity.name)) is not None]
    if not known:
        return
    x = [getattr(row.cell, axis) for row, _ in known]
    mean = [found.mean for _, found in known]
    low = [found.mean if found.low is None else found.low for _, found in known]
    high = [found.mean if found.high is None else found.high for _, found in known]
    if quantity.logarithmic:
        low = [max(value, LEAST_OF_MEAN * middle) for value, middle in zip(low, mean, strict=True)]
    colour, engine = COLOURS[index % len(COLOURS)], rows[0].engine
    face = colour if engine == "sim" else "none"
    label = _label(getattr(rows[0].cell, OTHER[axis]), axis, engine)
    if quantity.kind == "share of runs":
        x = [value + APART * index * (max(x) - min(x)) for value in x]
        axes.vlines(x, low, high, color=colour, alpha=0.5, linewidth=1)
    else:
        axes.fill_between(x, low, high, color=colour, alpha=0.15, linewidth=0)
    axes.plot(
        x,
        mean,
        color=colour,
        marker=MARKERS[index % len(MARKERS)],
        linestyle=DASHES[engine],
        markerfacecolor=face,
        markersize=4 if engine == "sim" else 8,
        linewidth=1.2,
        label=label,
    )


def _label(value: float, axis: Axis, engine: str) -> str:
    other = f"loss {100 * value:g} %" if axis == "delay_ms" else f"delay {value:g} ms"
    return other if engine == "sim" else f"{other}, {ENGINES[engine]}"


def _finish(picture: Any, grid: Any, quantity: Quantity, axis: Axis) -> None:
    for axes in grid[-1]:
        axes.set_xlabel(LABELS[axis])
    for line in grid:
        if quantity.kind in {"per cent", "share of runs"}:
            line[0].set_ylim(-4, 104)
        elif quantity.logarithmic:
            line[0].set_yscale("log")
        elif quantity.kind != "signed" or line[0].get_ylim()[0] > 0:
            line[0].set_ylim(bottom=0)
    picture.supylabel(quantity.label, fontsize=10)
    found: dict[str, Any] = {}
    for axes in grid.flat:
        handles, labels = axes.get_legend_handles_labels()
        found.update(zip(labels, handles, strict=True))
    if found:
        column_in = CHARACTER_IN * max(map(len, found)) + HANDLE_IN
        ncols = max(1, int(picture.get_figwidth() / column_in))
        picture.legend(found.values(), found, loc="outside lower center", ncols=ncols, fontsize=8)
