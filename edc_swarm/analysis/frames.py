"""Data frames of a run for notebooks, with one row per UAV and slot."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np

from edc_swarm.analysis.metrics import Columns
from edc_swarm.errors import InputError

LIBRARIES = ("pandas", "polars")


def table_of(columns: Columns) -> dict[str, Any]:
    """Return columns of equal length with one entry per slot and UAV (slot-major) and units in their names.

    `start_*` is the disc's centre when the slot begins, `end_*` and `away_m` (from the target) when it ends.
    """
    slots, count = columns.step_m.shape
    (start_x_m, start_y_m), (end_x_m, end_y_m) = (
        np.moveaxis(points_m, 2, 0).reshape(2, -1) for points_m in (columns.centre_m[:-1], columns.centre_m[1:])
    )
    return {
        "slot": np.repeat(np.arange(slots), count),
        "time_s": np.repeat(columns.time_s, count),
        "uav": np.tile(np.array(columns.uavs, dtype=object), slots),
        "start_x_m": start_x_m,
        "start_y_m": start_y_m,
        "end_x_m": end_x_m,
        "end_y_m": end_y_m,
        "step_m": columns.step_m.ravel(),
        "away_m": columns.away_m[1:].ravel(),
        "executed": columns.executed.ravel(),
        "alive": columns.alive.ravel(),
        "energy_j": columns.energy_j.ravel(),
    }


def frame_of(columns: Columns, library: str = "pandas") -> Any:
    """Return `table_of(columns)` as a pandas or polars data frame (extra `frames`).

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
        raise InputError("library", library, "installed: pip install 'edc-swarm[frames]'") from None
    return frames.DataFrame(table_of(columns))
