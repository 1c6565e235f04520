"""Tick labels do not overprint each other, however dense the values are."""

from __future__ import annotations

from itertools import pairwise

import pytest

from processes.experiments.plots import RC, check_plots, set_ticks

DENSE = [0.0, 1.0, 2.0, 5.0, 10.0, 12.5, 100.0, 101.0, 200.0, 350.0, 400.0, 1234.5]


@pytest.mark.parametrize(("width_in", "fontsize"), [(2.7, 7.0), (5.4, 9.0)])
@pytest.mark.parametrize("values", [DENSE, [10.0, 20.0, 30.0, 40.0, 50.0], [3.0]])
def test_no_two_labels_overlap(values: list[float], width_in: float, fontsize: float) -> None:
    """The boxes of the labels that are left are apart; well spaced values keep all labels."""
    check_plots()
    from matplotlib import pyplot as plt  # noqa: PLC0415 - an extra

    with plt.rc_context(RC):
        picture, axes = plt.subplots(figsize=(width_in, 2.2), layout="constrained")
        axes.plot(values, values)
        axes.set_ylabel("something [m]")
        set_ticks(axes, values, [f"{value:g}" for value in values], width_in, fontsize=fontsize)
        picture.canvas.draw()
        boxes = [label.get_window_extent() for label in axes.get_xticklabels() if label.get_text()]
        plt.close(picture)
    assert all(left.x1 < right.x0 for left, right in pairwise(boxes))
    assert len(boxes) == len(values) or values == DENSE
