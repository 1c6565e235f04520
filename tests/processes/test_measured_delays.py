"""Real processes on a measured network: what their links did is what the file of the trace says."""

from __future__ import annotations

from pathlib import Path
from statistics import median

import pytest

from edc_swarm.analysis.link_delays import link_delays_of
from edc_swarm.emulation.delay_log import LEVELS_PCT
from tests.processes.conftest import Fly

pytestmark = pytest.mark.timing

MISSION = """
uavs = 3
seed = 5
area_m2 = 2500.0
resends = 0
[[link]]
trace = "steps.csv"
trace_columns = { sent = "sent", delay = "delay" }
trace_unit = "ms"
trace_offset = "none"
"""
SLOT_MS = 500
DELAYS_MS = (10.0, 40.0, 90.0)
"""Delay of the trace in every third slot each: a third of the messages of a link has each."""
WITHIN_MS = 5.0
"""Half of the least delay; on a quiet machine it is less than 1 ms, which `benchmarks/traces.py` shows."""


def test_delays_of_processes_are_those_of_the_file(start: Fly, tmp_path: Path) -> None:
    """The 10, 50 and 80 % quantiles of a link are the delays of the file, never less, and at most 5 ms more.

    The median over the links counts, since a processor that other work holds makes single receivers late.
    """
    rows = [f"{slot * SLOT_MS + at},{delay}" for slot, delay in enumerate(DELAYS_MS) for at in range(0, SLOT_MS, 50)]
    (tmp_path / "steps.csv").write_text("\n".join(["sent,delay", *rows]) + "\n", encoding="utf-8")
    (tmp_path / "stepped.toml").write_text(MISSION, encoding="utf-8")
    ended = start("run", str(tmp_path / "stepped.toml")).end()
    assert ended.status == 0, ended.stderr
    told = link_delays_of(ended.recording)
    assert len(told) == 6
    assert all(link.arrived >= 9 and link.lost == 0 for link in told.values())
    for level_pct, delay_ms in zip((10, 50, 80), DELAYS_MS, strict=True):
        late_ms = [link.delay_ms[LEVELS_PCT.index(level_pct)] - delay_ms for link in told.values()]
        assert min(late_ms) >= 0.0, level_pct
        assert median(late_ms) <= WITHIN_MS, level_pct
