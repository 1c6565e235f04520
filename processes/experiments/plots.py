"""Plots of figures with matplotlib (extra `plots`) as PNG, SVG and PDF, for print and for colour-blind readers.

Colours are those of M. Okabe and K. Ito, "Color Universal Design", 2008; markers and dashes distinguish the lines
without colour.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from edc_swarm.errors import InputError
from edc_swarm.experiments.figures.catalogue import Figure
from edc_swarm.experiments.figures.table import Row, line
from edc_swarm.extras import install_command

SIZE_IN = (5.4, 4.1)
DPI = 200
BAND_SHARE = 1.6
"""Width of a band, as a share of the greatest mean, above which the plot cuts it off."""
LOG_BAND = 2.5
NEGLIGIBLE = 1e-6
AXES_SHARE = 0.75
"""Width of the axes as a share of their panel."""
DIGIT_IN = 0.6 / 72
"""Width of a digit in inches, for each point of its font."""
HOLLOW = {"straight", "bound"}
"""Lines that others may cover; their hollow markers stay visible around those of the others."""
STYLES: dict[str, tuple[str, str, str]] = {
    "straight": ("#D55E00", "s", "--"),
    "bound": ("#000000", "", ":"),
    "paper": ("#E69F00", "^", "-."),
    "edc": ("#0072B2", "o", "-"),
    "edc-slot": ("#56B4E9", "v", ":"),
    "energy": ("#009E73", "o", "-"),
    "distance": ("#0072B2", "s", "--"),
    "time": ("#CC79A7", "D", "-."),
}
"""Colour, marker and dashes of each line."""
HEADS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9", "#F0E442", "#000000")
RC: Any = {
    "font.size": 10,
    "axes.grid": True,
    "grid.color": "#dddddd",
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.hashsalt": "edc-swarm",
    "pdf.fonttype": 42,
    "legend.frameon": False,
    "legend.fontsize": 9,
}


def check_plots() -> None:
    """Raise `InputError` unless matplotlib is installed."""
    try:
        import matplotlib as mpl  # noqa: PLC0415 - an extra
    except ImportError:
        raise InputError("figures", "matplotlib", f"installed: {install_command('plots')}") from None
    mpl.use("Agg")


def draw_figure(figure: Figure, rows: Sequence[Row], stem: Path) -> None:
    """Write the figure to `stem`.png, `stem`.svg and `stem`.pdf, with means and 95 % bands."""
    from matplotlib import pyplot as plt  # noqa: PLC0415 - an extra

    with plt.rc_context(RC):
        picture, axes = plt.subplots(figsize=SIZE_IN, layout="constrained")
        for series in figure.series:
            _draw_line(axes, rows, series.name, series.label)
        _finish_axes(axes, figure, rows)
        save(picture, stem)


def _draw_line(axes: Any, rows: Sequence[Row], name: str, label: str) -> None:
    points = line(rows, name)
    if points is None:
        return
    colour, marker, dashes = STYLES[name]
    hollow = {"markerfacecolor": "white", "markersize": 9} if name in HOLLOW else {"markersize": 5}
    axes.fill_between(points.x, points.low, points.high, color=colour, alpha=0.2, linewidth=0)
    axes.plot(points.x, points.mean, color=colour, marker=marker, linestyle=dashes, label=label, **hollow)


def _finish_axes(axes: Any, figure: Figure, rows: Sequence[Row]) -> None:
    axes.set_xlabel(figure.axis.label)
    axes.set_ylabel(figure.label)
    labels = [f"{value / figure.axis.tick:g}" for value in figure.axis.values]
    set_ticks(axes, figure.axis.values, labels, SIZE_IN[0])
    _limit(axes, figure, [row.mean for row in rows])
    axes.set_title(figure.title, fontsize=10, loc="left")
    axes.figure.legend(loc="outside lower center", ncols=2, title="mean and its 95 % confidence band", title_fontsize=8)


def _limit(axes: Any, figure: Figure, means: Sequence[float]) -> None:
    """Set the range of the axis: all means are visible, and very wide bands are cut off."""
    least, most = min(means), max(means)
    low, high = axes.get_ylim()
    if figure.logarithmic:
        axes.set_yscale("log")
        axes.set_ylim(least / LOG_BAND, most * LOG_BAND)
    elif least < -NEGLIGIBLE:
        axes.axhline(0, color="#000000", linewidth=0.8)
        reach = BAND_SHARE * max(abs(least), most)
        axes.set_ylim(max(low, -reach), min(high, reach))
    else:
        axes.set_ylim(-0.04 * (most or 1.0), min(high, BAND_SHARE * most) or 1.0)


def draw_heads(result: Mapping[str, Any], stem: Path) -> None:
    """Write a figure of a long mission: the heads over time, and every battery relative to their mean."""
    from matplotlib import pyplot as plt  # noqa: PLC0415 - an extra

    uavs = [bill["uav"] for bill in result["bills"]]
    time_s, energy_kj = np.array(result["time_s"]), np.array(result["energy_j"], dtype=float) / 1e3
    heads = result["metrics"]["heads"]
    ever_led = list(dict.fromkeys(head["head"] for head in heads))
    colours = {uav: HEADS[index % len(HEADS)] for index, uav in enumerate(ever_led)}
    with plt.rc_context(RC):
        picture, (above, below) = plt.subplots(
            2, 1, figsize=(6.8, 5.2), sharex=True, layout="constrained", height_ratios=[3, 2]
        )
        mean_kj = np.nanmean(energy_kj, axis=0)
        for uav, battery_kj in zip(uavs, energy_kj, strict=True):
            above.plot(
                time_s,
                battery_kj - mean_kj,
                color=colours.get(uav, "#bbbbbb"),
                linewidth=1.4,
                zorder=2 + (uav in colours),
            )
        above.set_ylabel("Battery above the\nswarm's mean [kJ]")
        above.set_title(
            "Election by energy: heads over time, and all batteries (grey: never head)", fontsize=10, loc="left"
        )
        for head in heads:
            begin_s = head["first_slot"] * result["dt_s"]
            width_s = (head["last_slot"] + 1) * result["dt_s"] - begin_s
            below.barh(ever_led.index(head["head"]), width_s, left=begin_s, height=0.7, color=colours[head["head"]])
        below.set_yticks(range(len(ever_led)), ever_led)
        below.invert_yaxis()
        below.set_ylabel("Head")
        below.set_xlabel("Mission time [s]")
        save(picture, stem)


def set_ticks(axes: Any, values: Sequence[float], labels: Sequence[str], width_in: float, fontsize: float = 9) -> None:
    """Put a tick at each value, and a label at those that leave it room beside the label before it.

    `width_in` is the width of the panel in inches. A label takes as much as its digits and one more.
    """
    span = (max(values) - min(values)) or 1.0
    shown, free = list[str](), -math.inf
    for value, label in zip(values, labels, strict=True):
        middle = (value - min(values)) / span * AXES_SHARE * width_in
        half = (len(label) + 1) * fontsize * DIGIT_IN / 2
        fits = middle - half >= free
        shown.append(label if fits else "")
        free = middle + half if fits else free
    axes.set_xticks(values, shown, fontsize=fontsize)


def save(picture: Any, stem: Path) -> None:
    """Write a picture to `stem`.png, `stem`.svg and `stem`.pdf, with the same bytes for the same picture."""
    from matplotlib import pyplot as plt  # noqa: PLC0415 - an extra

    picture.savefig(stem.with_suffix(".png"), dpi=DPI)
    picture.savefig(stem.with_suffix(".svg"), metadata={"Date": None})
    picture.savefig(stem.with_suffix(".pdf"), metadata={"CreationDate": None})
    plt.close(picture)
