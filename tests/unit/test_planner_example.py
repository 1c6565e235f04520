"""The documented examples: the planner as a library, and a planner of one's own."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.mission.configuration import Mission
from edc_swarm.protocol.events import EventKind
from processes.experiments.measures import simulate

REPO = Path(__file__).parents[2]
EXAMPLES = REPO / "examples"


def test_example_flies_everyone_to_the_target(capsys: pytest.CaptureFixture[str]) -> None:
    """The example ends, and reports a gap that is not negative."""
    slots = runpy.run_path(str(EXAMPLES / "plan_without_processes.py"))["main"]()
    assert 32 <= slots < 200
    said = capsys.readouterr().out
    assert said.startswith("8 UAVs arrived")
    assert float(said.split()[-2]) >= 0


def test_planner_of_the_docs_flies_as_written(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is a file of the examples, so mypy checks its types, and it brings everyone home."""
    written = (REPO / "docs" / "planner.md").read_text().partition("```python\n")[2].partition("```")[0]
    assert written == (EXAMPLES / "my_planner.py").read_text()
    monkeypatch.syspath_prepend(EXAMPLES)
    recording, _ = simulate(Mission(uavs=3, planner="my_planner:MyPlanner"))
    assert compute_metrics(recording).completed


def test_own_planner_brings_everyone_home_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    """The example flies the default mission to its end, without a fence, with detours and without an overlap."""
    monkeypatch.syspath_prepend(EXAMPLES)
    recording, _ = simulate(Mission(planner="own_planner:TurnRight", fence="none"))
    found = compute_metrics(recording)
    assert (found.completed, found.potential_collisions) == (True, 0)
    assert found.extra_distance_pct is not None
    assert found.extra_distance_pct > 5
    assert {event.kind for event in recording.events}.isdisjoint({EventKind.PLANNER_FAILED})
