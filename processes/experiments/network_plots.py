"""Plots of one recording: distributions of the ages of information and of the delays of its emulated links."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from edc_swarm.analysis.information_age import command_updates, fix_updates, sawtooth_of
from edc_swarm.analysis.link_delays import link_delays_of
from edc_swarm.emulation.delay_log import LEVELS_PCT
from edc_swarm.errors import InputError
from edc_swarm.recording.model import Recording
from processes.experiments.plots import RC, SIZE_IN, save

BY_NAME = 8
"""Most links that are told apart by name and colour."""


def draw_ages(recording: Recording, stem: Path) -> None:
    """Write the distributions of the ages over time, and of their peaks, to `stem`.png, `stem`.svg and `stem`.pdf.

    Raises
    ------
    InputError
        No UAV flew two commands, so no update follows another.
    """
    from matplotlib import pyplot as plt  # noqa: PLC0415 - an extra

    ages = {"fixes at the head": fix_updates(recording), "commands at the UAVs": command_updates(recording)}
    stem.parent.mkdir(parents=True, exist_ok=True)
    with plt.rc_context(RC):
        picture, axes = plt.subplots(figsize=SIZE_IN, layout="constrained")
        for (label, updates), colour in zip(ages.items(), ("#0072B2", "#D55E00"), strict=True):
            sawtooth = sawtooth_of(updates)
            if not len(sawtooth.low_ms):
                raise InputError("--plots", recording.mission.name, f"a recording with several {label}")
            steps_ms = np.unique(np.concatenate([sawtooth.low_ms, sawtooth.high_ms]))
            axes.plot(steps_ms, 100 * sawtooth.share_below(steps_ms), color=colour, label=label)
            peaks_ms = np.sort(sawtooth.peak_ms)
            shares = 100 * np.arange(1, len(peaks_ms) + 1) / len(peaks_ms)
            axes.step(peaks_ms, shares, where="post", color=colour, linestyle="--", label=f"{label}, peaks")
        axes.set(xlabel="Age of information [ms]", ylabel="Share below [%]", ylim=(0, 102))
        picture.legend(loc="outside lower center", ncols=2)
        save(picture, stem)


def draw_links(recording: Recording, stem: Path) -> None:
    """Write the distribution of the delays of each emulated link that told any, as `draw_ages` does.

    Lost messages count as never arrived, so the line of a lossy link ends below 100 %. Nothing is written where no
    link told anything, as in missions without `[[link]]`.
    """
    from matplotlib import pyplot as plt  # noqa: PLC0415 - an extra

    told = {ends: found for ends, found in link_delays_of(recording).items() if found.delay_ms}
    if not told:
        return
    with plt.rc_context(RC):
        picture, axes = plt.subplots(figsize=SIZE_IN, layout="constrained")
        for number, ((sender, receiver), found) in enumerate(sorted(told.items())):
            share = found.arrived / (found.arrived + found.lost)
            label = f"{sender} to {receiver}" if len(told) <= BY_NAME else None
            colour = f"C{number}" if label else "#0072B2"
            axes.plot(found.delay_ms, share * np.array(LEVELS_PCT), color=colour, alpha=0.6, linewidth=1, label=label)
        axes.set(xlabel="Delay of the emulated link [ms]", ylabel="Share arrived [%]", ylim=(0, 102))
        axes.set_title(f"{len(told)} directed links", fontsize=10, loc="left")
        if len(told) <= BY_NAME:
            picture.legend(loc="outside lower center", ncols=2)
        save(picture, stem)
