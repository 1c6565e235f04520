"""The recorder may be slow, frozen or dead: the swarm does not notice, and the record says what it lacks."""

from __future__ import annotations

from edc_swarm.invariants import check
from edc_swarm.recording import find_gaps

FROZEN_FROM, FROZEN_SLOTS = 6, 10


def test_a_frozen_recorder_delays_no_command_and_its_gaps_are_reported(start) -> None:
    """Five seconds without a recorder: UAVs fly on by commands, and every message that is missing is counted.

    A UAV counts the slots in which it held; a quarter of the frozen ones is granted to a busy machine.
    """
    fault = f"freeze recorder @{FROZEN_FROM} for {FROZEN_SLOTS}"
    ended = start("run", "--json", "--uavs", "6", "--fault", fault).end()
    assert ended.status == 1, ended.stderr
    recording = ended.recording
    before = {f.uav: f.held_slots for f in recording.fixes if f.slot < FROZEN_FROM}
    after = {f.uav: f.held_slots for f in reversed(recording.fixes) if f.slot > FROZEN_FROM + FROZEN_SLOTS}
    assert len(before) == len(after) == 6
    assert all(after[uav] - held <= FROZEN_SLOTS / 4 for uav, held in before.items())
    lost = sum(gap.count for gap in find_gaps(recording) if not gap.duplicate)
    assert ended.json["gaps"] == lost > 0
    (complete,) = (result for result in check(recording) if not result.held)
    assert complete.guarantee == "G5"
    assert complete.status == "broken"
    assert any("are missing" in where for where in complete.where)


def test_every_message_of_the_view_is_recorded_too(run) -> None:
    """The visualiser's last word counts its messages per topic, and none is missing."""
    recording = run("--uavs", "4", "--area", "2500").recording
    (said,) = (event.detail for event in recording.events if event.source == "viz")
    assert '"viz/uavs":' in said
    assert find_gaps(recording) == []
    recording.unknown["/viz/uavs"] -= 1
    (gap,) = find_gaps(recording)
    assert (gap.key, gap.count) == ("viz/uavs", 1)


def test_without_a_view_there_is_none(run) -> None:
    """No visualiser runs, and its topics are not in the record."""
    recording = run("--uavs", "2", "--area", "900", "--no-viz").recording
    assert recording.unknown == {}
    assert not any(event.source == "viz" for event in recording.events)
