"""Property: what stands late in a record, since it was fetched again, changes nothing that is read from it."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edc_swarm.analysis.guarantees.check import check
from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.analysis.replanning import replan
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.validation import mission_from_dict
from edc_swarm.planner.registry import make_planner
from edc_swarm.protocol.codec import encode
from edc_swarm.protocol.keys import Keys
from edc_swarm.protocol.messages import Message, mission_message
from edc_swarm.recording.model import Recording
from edc_swarm.recording.reader import read_recording
from edc_swarm.recording.writer import RecordingWriter
from edc_swarm.report_page.data import Page
from edc_swarm.simulation.simulator import Simulation

FAULTS = ["kill head @4", "restart u002 @6", "link *>* loss 0.2 @2 for 6"]
Read = tuple[dict[str, Any], list[Any], Any, Page]


def fly() -> list[Message]:
    """A mission with a change of head, a restart and losses: fixes that are sent again, holds, silent steps."""
    said = list[Message]()
    fields = {"uavs": 5, "seed": 3, "area_m2": 3600.0, "fault": FAULTS}
    mission = mission_message(complete_mission(mission_from_dict(fields)))
    Simulation(mission, lambda: make_planner("edc", mission), lambda _key, now, _ns: said.append(now)).run()
    return said


@pytest.fixture(scope="module")
def said() -> list[Message]:
    """The messages of one mission, in the order in which they were said."""
    return fly()


def read(messages: list[Message], run_end: dict[str, str]) -> Recording:
    """A record of the messages in this order, read back."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.mcap"
        with path.open("wb") as stream:
            writer, keys = RecordingWriter(stream, {}), Keys(messages[0].name)  # type: ignore[union-attr]
            for message in messages:
                writer.write(keys.of(message), encode(message), message.sent_ns)
            writer.finish(run_end)
        return read_recording(path)


def computed(recording: Recording) -> Read:
    """What every reader makes of a record."""
    metrics = msgspec.to_builtins(compute_metrics(recording))
    mission = recording.mission
    plans = replan(recording, lambda: make_planner(mission.planner, mission))
    return {**metrics, "fetched": 0}, check(recording), plans, Page.of(recording, [])


@pytest.fixture(scope="module")
def expected(said: list[Message]) -> Read:
    """What is made of the record in which nothing is late."""
    return computed(read(said, {"fetched": "0"}))


@settings(max_examples=6, deadline=None)
@given(data=st.data())
def test_late_messages_change_no_reader(said: list[Message], expected: Read, data: st.DataObject) -> None:
    """Metrics, guarantees, plans made again and the report page are the same, whatever came how late."""
    order = list(said[1:])
    late = data.draw(st.lists(st.tuples(st.integers(0, len(order) - 1), st.integers(1, 80)), min_size=1, max_size=30))
    for at, by in late:
        order.insert(min(at + by, len(order)), order.pop(at))
    recording = read([said[0], *order], {"fetched": str(len(late))})
    assert compute_metrics(recording).fetched == len(late)
    assert computed(recording) == expected
