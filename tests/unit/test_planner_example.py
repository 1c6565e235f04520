"""The documented example of the planner as a library."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).parents[2] / "examples" / "plan_without_processes.py"


def test_example_flies_everyone_to_the_target(capsys: pytest.CaptureFixture[str]) -> None:
    """The example ends, and reports a gap that is not negative."""
    slots = runpy.run_path(str(EXAMPLE))["main"]()
    assert 32 <= slots < 200
    said = capsys.readouterr().out
    assert said.startswith("8 UAVs arrived")
    assert float(said.split()[-2]) >= 0
