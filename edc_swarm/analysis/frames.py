"""Data frames of a run for notebooks, with one row per UAV and slot."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edc_swarm.analysis.columns import Columns
from edc_swarm.errors import InputError
from edc_swarm.extras import install_command

LIBRARIES = ("pandas", "polars")


def table_of(columns: Columns) -> dict[str, Any]:
    """Return columns of equal length with one entry per slot and UAV (slot-major) and units in their names.

    `start_*` is the disc's centre when the slot begins, `end_*` and `away_m` (from the target) when it ends. Where the
    record lacks what was flown, all of these are NaN and `executed` is None.
    """
    slots, count = columns.step_m.shape
    lost = columns.lost.ravel()
    (start_x_m, start_y_m), (end_x_m, end_y_m) = (
        np.moveaxis(np.where(columns.lost[..., None], np.nan, points_m), 2, 0).reshape(2, -1)
        for points_m in (columns.centre_m[:-1], columns.centre_m[1:])
    )
    return {
        "slot": np.repeat(np.arange(slots), count),
        "time_s": np.repeat(columns.time_s, count),
        "uav": np.tile(np.array(columns.uavs, dtype=object), slots),
        "start_x_m": start_x_m,
        "start_y_m": start_y_m,
        "end_x_m": end_x_m,
        "end_y_m": end_y_m,
        "step_m": np.where(lost, np.nan, columns.step_m.ravel()),
        "away_m": np.where(lost, np.nan, columns.away_m[1:].ravel()),
        "executed": _where_known(columns.executed.ravel(), lost),
        "alive": columns.alive.ravel(),
        "energy_j": columns.energy_j.ravel(),
    }


def _where_known(flags: NDArray[np.bool_], lost: NDArray[np.bool_]) -> NDArray[np.bool_] | list[bool | None]:
    """Return `flags`, as a list with None in their place where `lost` says so."""
    if not lost.any():
        return flags
    return [None if unknown else flag for flag, unknown in zip(flags.tolist(), lost.tolist(), strict=True)]


def frame_of(columns: Columns, library: str = "pandas") -> Any:
    """Return `table_of(columns)` as a pandas or polars data frame (extra `frames`).

    Raises
    ------
    InputError
        `library` is neither of the two, or is not installed.
    """
    return new_frame(table_of(columns), library)


def new_frame(rows: dict[str, Any] | list[dict[str, Any]], library: str = "pandas") -> Any:
    """Return columns, or a list of rows, as a pandas or polars data frame (extra `frames`).

    Raises
    ------
    InputError
        `library` is neither of the two, or is not installed.
    """
    if library not in LIBRARIES:
        raise InputError("library", library, f"one of {', '.join(LIBRARIES)}")
    try:
        frames = importlib.import_module(library)
    except ImportError:
        raise InputError("library", library, f"installed: {install_command('frames')}") from None
    return frames.DataFrame(rows)
