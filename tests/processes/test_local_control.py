"""A swarm without a head, with real processes."""

from __future__ import annotations

from tests.processes.conftest import Fly


def test_processes_fly_without_a_head(start: Fly) -> None:
    """Every UAV hears all fixes, plans for itself, and arrives; no process leads."""
    options = "--control local --planner bvc --uavs 4 --fence none --slot 1 --time-scale 2 --speed-max 10"
    ended = start("run", "--json", *options.split()).end()
    assert ended.status == 0, ended.stderr + ended.stdout
    said = ended.json
    assert said["arrived"] == 4
    assert said["heads"] == []
    assert said["true_collisions"] == 0
    assert ended.recording.commands == ended.recording.reports == []
    assert {fix.term for fix in ended.recording.fixes} == {0}
