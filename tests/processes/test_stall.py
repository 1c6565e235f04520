"""A real mission in which nothing can change any more ends, and G7 is still judged."""

from __future__ import annotations

import pytest

from edc_swarm.protocol.completion import STALL_SLOTS
from tests.processes.conftest import Fly

RESTING = "tests.processes.resting:Resting"
CASES = {
    "resting": (["--planner", RESTING, "--fault", "gps u001 white @1"], "broken"),
    "split": (["--fault", "partition halves @4", "--failsafe", "hold"], "not-applicable"),
}


@pytest.mark.long
@pytest.mark.parametrize("name", CASES)
def test_the_end_says_that_nothing_can_change(start: Fly, name: str) -> None:
    """The mission ends soon after, not when the batteries are empty."""
    arguments, status = CASES[name]
    ended = start("run", "--json", "--uavs", "4", "--slot", "0.2", "--time-scale", "2", *arguments).end()
    recording, mission = ended.recording, ended.recording.mission
    end = next(event for event in recording.events if event.kind == "end")
    assert end.detail == "stalled", ended.stderr
    assert end.slot <= 2 * STALL_SLOTS < mission.max_slots
    progress = next(guarantee for guarantee in ended.json["guarantees"] if guarantee["guarantee"] == "G7")
    assert progress["status"] == status
    assert ended.status == 1
