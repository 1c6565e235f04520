"""This version reads a recording of an earlier one, since recordings outlive code."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from edc_swarm.analysis.guarantees.check import check
from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import complete_mission
from edc_swarm.protocol.messages import mission_message
from edc_swarm.recording.mcap_file import McapFile
from edc_swarm.recording.model import Recording
from edc_swarm.recording.reader import read_recording
from edc_swarm.viz.channels import channel_of
from processes.services.recorded_view import layout_bytes

FOLDER = Path(__file__).parents[2] / "recordings"
GOLDEN = FOLDER / "golden.mcap"
SLOTS, MESSAGES, MAKESPAN_S = 25, 321, 11.5
PATH_M, EXTRA_PCT, PROPULSION_J, GAP_M = 140.21066371570967, 9.273692306429515, 5393.640535214641, 0.5580362663361225
HEADS = [(1, "u004", 1, 7), (2, "u001", 10, 23)]


@pytest.fixture(scope="module")
def golden() -> Recording:
    """Return the recording."""
    return read_recording(GOLDEN)


def test_every_message_is_still_understood(golden: Recording) -> None:
    """There is no garbage, and every topic for viewers has the same schema name."""
    assert golden.garbage == []
    assert golden.run["format"] == "1"
    assert golden.run_end == {"messages": str(golden.message_count + sum(golden.unknown.values())), "dropped": "0"}
    for channel in {channel.topic: channel for channel, *_ in McapFile(GOLDEN).messages()}.values():
        if (known := channel_of(channel.topic)) is not None:
            assert (known.schema_name, known.encoding) == (channel.schema_name, channel.encoding)


def test_its_metrics_are_what_they_were(golden: Recording) -> None:
    """A change here is a change in the definition of a metric."""
    metrics = compute_metrics(golden)
    assert (metrics.uavs, metrics.slots, metrics.arrived, metrics.completed) == (4, SLOTS, 4, True)
    assert (metrics.potential_collisions, metrics.true_collisions, metrics.gaps) == (0, 0, 0)
    assert metrics.messages == MESSAGES
    assert metrics.path_m == pytest.approx(PATH_M)
    assert metrics.extra_distance_pct == pytest.approx(EXTRA_PCT)
    assert metrics.energy_propulsion_j == pytest.approx(PROPULSION_J)
    assert metrics.min_disc_gap_m == pytest.approx(GAP_M)
    assert metrics.makespan_s == MAKESPAN_S
    assert [(h.term, h.head, h.first_slot, h.last_slot) for h in metrics.heads] == HEADS


def test_every_guarantee_still_holds(golden: Recording) -> None:
    """No checker is stricter than the guarantee."""
    assert [result.guarantee for result in check(golden) if result.broken] == []


def test_the_layout_beside_it_is_that_of_the_default_mission() -> None:
    """The layout for import equals the one in recordings."""
    mission = mission_message(complete_mission(Mission()))
    assert (FOLDER / "foxglove-layout.json").read_bytes() == layout_bytes(mission)


def test_it_carries_its_layout_and_its_mission() -> None:
    """The file alone contains both as attachments."""
    file = McapFile(GOLDEN)
    list(file.messages())
    assert set(file.attachments) == {"mission.json", "foxglove-layout.json"}
    assert json.loads(file.attachments["foxglove-layout.json"][1])["layout"]["first"] == "3D!swarm"
