"""A slow, frozen or dead recorder does not disturb the swarm, and the record shows what it lacks."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import msgspec
import pytest
import zenoh

from edc_swarm.analysis.guarantees.check import check
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import complete_mission
from edc_swarm.protocol.codec import encode
from edc_swarm.protocol.keys import Keys
from edc_swarm.protocol.messages import Event, mission_message
from edc_swarm.recording.reader import read_recording
from edc_swarm.recording.sequences import find_gaps
from processes.bus.session import hand_over, open_client
from processes.runtime.inbox import Inbox
from processes.services.recorder import RecorderSettings
from processes.services.recording_file import MAX_FOREIGN_KEYS
from tests.processes.conftest import Fly, FlyToEnd, await_true

FOREIGN_KEYS = 1500
FROZEN_FROM, FROZEN_SLOTS = 6, 10


@pytest.mark.timing
def test_a_frozen_recorder_delays_no_command_and_fetches_what_it_missed(start: Fly) -> None:
    """Five seconds without a recorder: UAVs fly on by commands, and every message is recorded in the end.

    A UAV counts the slots in which it held; a quarter of the frozen ones is granted to a busy machine.
    """
    fault = f"freeze recorder @{FROZEN_FROM} for {FROZEN_SLOTS}"
    ended = start("run", "--json", "--uavs", "6", "--fault", fault).end()
    recording = ended.recording
    before = {f.uav: f.held_slots for f in recording.fixes if f.slot < FROZEN_FROM}
    after = {f.uav: f.held_slots for f in reversed(recording.fixes) if f.slot > FROZEN_FROM + FROZEN_SLOTS}
    assert len(before) == len(after) == 6
    assert all(after[uav] - held <= FROZEN_SLOTS / 4 for uav, held in before.items())
    assert [result.guarantee for result in check(recording) if result.broken] == []
    assert ended.json["fetched"] > 0
    assert "fetched again" in start("metrics", str(ended.path)).end().stdout


def test_every_message_of_the_view_is_recorded_too(run: FlyToEnd) -> None:
    """The visualiser's `closed` event counts its messages per topic, and none is missing."""
    recording = run("--uavs", "4", "--area", "2500").recording
    (said,) = (event.detail for event in recording.events if event.source == "viz")
    assert '"viz/uavs":' in said
    assert find_gaps(recording) == []
    recording.unknown["/viz/uavs"] -= 1
    (gap,) = find_gaps(recording)
    assert (gap.key, gap.count) == ("viz/uavs", 1)


def test_without_a_view_there_is_none(run: FlyToEnd) -> None:
    """No visualiser runs, and the record has none of its topics."""
    recording = run("--uavs", "2", "--area", "900", "--no-viz").recording
    assert recording.unknown == {}
    assert not any(event.source == "viz" for event in recording.events)


def test_keys_of_nobody_take_no_room_and_no_look_alike_ends_the_recording(endpoint: str, tmp_path: Path) -> None:
    """The recorder writes a thousand of 1500 foreign keys, and the mission's own keys at any time."""
    part, out = tmp_path / "run.mcap.part", tmp_path / "run.mcap"
    part.touch()
    settings = RecorderSettings(endpoint=endpoint, mission="m", part=str(part), out=str(out), run={})
    session, keys, inbox = open_client(endpoint), Keys("m"), Inbox[str]()

    def take(sample: zenoh.Sample) -> None:
        inbox.put(str(sample.key_expr))

    session.liveliness().declare_subscriber(keys.all_alive, hand_over(take), history=True)
    session.declare_subscriber(keys.event("recorder"), take)
    recorder = subprocess.Popen([sys.executable, "-m", "processes.services.recorder"], stdin=subprocess.PIPE)
    assert recorder.stdin is not None
    with recorder.stdin as orders:
        orders.write(msgspec.json.encode(settings))
    await_true(lambda: bool(inbox.wait(0.05)))

    def say(key: str, payload: bytes) -> None:
        session.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK)

    for number in range(FOREIGN_KEYS):
        say(f"{keys.root}/uav/x{number}/fix", b"{}")
    mission = mission_message(complete_mission(Mission(uavs=2)), time.time_ns(), "m")
    now: dict[str, Any] = {"sent_ns": time.time_ns(), "instance": "i"}
    say(keys.mission, b"no mission")
    say(keys.mission, encode(msgspec.structs.replace(mission, **now)))
    say(keys.event("operator"), b'garbage "kind":"closed"')
    say(keys.event("operator"), encode(Event(source="operator", kind="closed", sent_ns=1)))
    told: list[str] = []

    def told_twice() -> bool:
        told.extend(inbox.wait(0.05))
        return len(told) >= 2

    await_true(told_twice)
    say(keys.event("u001"), encode(Event(source="u001", kind="told", **now)))
    say(keys.event("operator"), encode(Event(source="operator", kind="closed", **now)))
    assert recorder.wait(30) == 0
    session.close()
    recording = read_recording(out)
    assert sorted(e.kind for e in recording.events if e.source in {"u001", "operator"}) == ["closed", "told"]
    foreign = {garbage.topic for garbage in recording.garbage if "/uav/x" in garbage.topic}
    assert len(foreign) == MAX_FOREIGN_KEYS
    assert recording.run_end is not None
    assert recording.run_end["foreign_left_out"] == str(FOREIGN_KEYS - MAX_FOREIGN_KEYS)
    (complete,) = (result for result in check(recording) if result.guarantee == "G5")
    assert f"left out: {FOREIGN_KEYS - MAX_FOREIGN_KEYS} messages on foreign keys" in complete.notes
