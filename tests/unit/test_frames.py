"""Data frames of a run."""

from __future__ import annotations

import numpy as np
import pytest

from edc_swarm.analysis.columns import columns_of
from edc_swarm.analysis.frames import LIBRARIES, frame_of
from edc_swarm.errors import InputError
from edc_swarm.protocol.messages import Fix
from tests.unit.synthetic import flight, parallel, recorded


@pytest.mark.parametrize("library", LIBRARIES)
def test_frame_holds_the_columns(library: str) -> None:
    """There is one row per slot and UAV, and the steps sum to the distance flown."""
    pytest.importorskip(library)
    columns = columns_of(recorded(flight(parallel())))
    frame = frame_of(columns, library)
    assert len(frame) == columns.step_m.size
    assert float(frame["step_m"].sum()) == pytest.approx(float(columns.step_m.sum()))
    second = np.array(frame["uav"]) == columns.uavs[1]
    assert np.array_equal(np.array(frame["end_x_m"])[second], columns.centre_m[1:, 1, 0])


@pytest.mark.parametrize("library", LIBRARIES)
def test_lost_slots_are_unknown_in_a_frame(library: str) -> None:
    """No way of 0 m, and no "not executed", where the record lacks the fixes."""
    pytest.importorskip(library)
    messages = [m for m in flight(parallel()) if not (isinstance(m, Fix) and m.uav == "u1" and 3 <= m.slot <= 5)]
    frame = frame_of(columns_of(recorded(messages)), library)
    lost = (np.array(frame["uav"]) == "u1") & np.isin(np.array(frame["slot"]), [3, 4, 5])
    assert np.isnan(np.array(frame["step_m"], float)).tolist() == lost.tolist()
    assert [flag is None for flag in list(frame["executed"])] == lost.tolist()


def test_unknown_library_is_refused() -> None:
    """The error lists the libraries."""
    with pytest.raises(InputError, match="pandas, polars"):
        frame_of(columns_of(recorded(flight(parallel()))), "excel")
