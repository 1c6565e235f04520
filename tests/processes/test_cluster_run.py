"""Two clusters of real processes, one of which loses its head to SIGKILL."""

from __future__ import annotations

from pathlib import Path

import pytest

from edc_swarm.analysis.head_terms import heads_of
from tests.processes.conftest import start_command

CROSSING = Path(__file__).parents[2] / "scenarios" / "crossing_clusters.toml"


@pytest.mark.long
def test_two_clusters_cross_and_one_loses_its_head(tmp_path: Path) -> None:
    """Both lead at the same time; the killed head lands, and all others are at their targets."""
    path = tmp_path / "clusters.mcap"
    fault = ("--fault", "kill head-a @12")
    ended = start_command("run", str(CROSSING), "--json", "--time-scale", "0.5", *fault, path=path).end()
    said = ended.json
    assert said["arrived"] == 7, ended.stderr
    assert said["potential_collisions"] == said["true_collisions"] == said["gaps"] == 0
    verdicts = {guarantee["guarantee"]: guarantee["status"] for guarantee in said["guarantees"]}
    assert {name: verdicts[name] for name in ("G1", "G2", "G3", "G4", "G7")} == dict.fromkeys(
        ("G1", "G2", "G3", "G4", "G7"), "held"
    )
    heads = heads_of(ended.recording)
    assert len(heads["a"]) >= 2
    assert len({term.head for term in heads["a"]}) >= 2
    assert {cluster["name"]: cluster["arrived"] for cluster in said["clusters"]} == {"a": 3, "b": 4}
