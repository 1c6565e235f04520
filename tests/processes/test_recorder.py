"""A slow, frozen or dead recorder does not disturb the swarm, and the record shows what it lacks."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import msgspec
import pytest
import zenoh

from edc_swarm.analysis.guarantees.check import check
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import complete_mission
from edc_swarm.protocol.codec import encode
from edc_swarm.protocol.keys import Keys
from edc_swarm.protocol.messages import Event, mission_message
from edc_swarm.recording.model import Recording
from edc_swarm.recording.reader import read_recording
from edc_swarm.recording.sequences import find_gaps
from processes.bus.session import hand_over, open_client
from processes.runtime.inbox import Inbox
from processes.services.recorder_settings import RecorderSettings
from processes.services.recording_file import MAX_FOREIGN_KEYS
from tests.processes.conftest import Fly, FlyToEnd, await_true

KEYS = Keys("m")
FOREIGN_KEYS = 1500
LARGE, LARGE_BYTES = 200, 8 << 20
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


@dataclass(frozen=True)
class Bench:
    """A recorder process with settings of a test, and a session that publishes to it."""

    process: subprocess.Popen[bytes]
    session: zenoh.Session
    told: Inbox[str]
    out: Path

    def say(self, key: str, payload: bytes) -> None:
        """Publish as a stranger does, and wait where the transport is busy."""
        self.session.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK)

    def begin(self) -> None:
        """Publish a mission of two UAVs."""
        mission = mission_message(complete_mission(Mission(uavs=2)), time.time_ns(), "m")
        self.say(KEYS.mission, encode(msgspec.structs.replace(mission, sent_ns=time.time_ns(), instance="i")))

    def end(self) -> Recording:
        """Say the operator's last word, and return what the recorder has recorded."""
        closed = Event(source="operator", kind="closed", sent_ns=time.time_ns(), instance="i")
        self.say(KEYS.event("operator"), encode(closed))
        assert self.process.wait(60) == 0
        return read_recording(self.out)


@pytest.fixture
def recorder(endpoint: str, tmp_path: Path) -> Iterator[Bench]:
    """Yield a recorder process that listens, and end it."""
    part, out = tmp_path / "run.mcap.part", tmp_path / "run.mcap"
    part.touch()
    settings = RecorderSettings(endpoint=endpoint, mission="m", part=str(part), out=str(out), run={})
    session, told = open_client(endpoint), Inbox[str]()

    def take(sample: zenoh.Sample) -> None:
        told.put(str(sample.key_expr))

    session.liveliness().declare_subscriber(KEYS.all_alive, hand_over(take), history=True)
    session.declare_subscriber(KEYS.event("recorder"), hand_over(take))
    process = subprocess.Popen([sys.executable, "-m", "processes.services.recorder"], stdin=subprocess.PIPE)
    assert process.stdin is not None
    with process.stdin as orders:
        orders.write(msgspec.json.encode(settings))
    await_true(lambda: bool(told.wait(0.05)))
    yield Bench(process, session, told, out)
    session.close()
    process.kill()
    process.wait()


def test_keys_of_nobody_take_no_room_and_no_look_alike_ends_the_recording(recorder: Bench) -> None:
    """The recorder writes a thousand of 1500 foreign keys, and the mission's own keys at any time."""
    for number in range(FOREIGN_KEYS):
        recorder.say(f"{KEYS.root}/uav/x{number}/fix", b"{}")
    recorder.say(KEYS.mission, b"no mission")
    recorder.begin()
    recorder.say(KEYS.event("operator"), b'garbage "kind":"closed"')
    recorder.say(KEYS.event("operator"), encode(Event(source="operator", kind="closed", sent_ns=1)))
    told: list[str] = []

    def has_told_twice() -> bool:
        told.extend(recorder.told.wait(0.05))
        return len(told) >= 2

    await_true(has_told_twice)
    recorder.say(KEYS.event("u001"), encode(Event(source="u001", kind="told", sent_ns=time.time_ns(), instance="i")))
    recording = recorder.end()
    assert sorted(e.kind for e in recording.events if e.source in {"u001", "operator"}) == ["closed", "told"]
    foreign = {garbage.topic for garbage in recording.garbage if "/uav/x" in garbage.topic}
    assert len(foreign) == MAX_FOREIGN_KEYS
    assert recording.run_end is not None
    assert recording.run_end["foreign_left_out"] == str(FOREIGN_KEYS - MAX_FOREIGN_KEYS)
    (complete,) = (result for result in check(recording) if result.guarantee == "G5")
    assert f"left out: {FOREIGN_KEYS - MAX_FOREIGN_KEYS} messages on foreign keys" in complete.notes


def test_a_flood_of_large_messages_takes_neither_memory_nor_disk(recorder: Bench) -> None:
    """The recorder describes payloads of 8 MiB in place of keeping them, and counts each: 1.6 GB fit into 2 MB."""
    recorder.begin()
    payload = bytes(LARGE_BYTES)
    for _ in range(LARGE):
        recorder.say(KEYS.fix("u001"), payload)
    status = Path(f"/proc/{recorder.process.pid}/status").read_text()
    peak_kb = int(next(line for line in status.splitlines() if line.startswith("VmHWM")).split()[1])
    recording = recorder.end()
    found = [garbage for garbage in recording.garbage if garbage.topic == KEYS.fix("u001")]
    assert sum(garbage.count for garbage in found) == LARGE
    assert str(LARGE_BYTES) in found[0].reason
    assert recorder.out.stat().st_size < 2_000_000
    assert peak_kb < 400_000


@pytest.mark.long
def test_a_recorder_frozen_across_the_end_proves_nothing(start: Fly) -> None:
    """A recorder that is frozen until all UAVs have ended has no evidence: the command says so, and nothing is held."""
    command = start("run", "--json", "--uavs", "10", "--time-scale", "4")
    command.await_flight(10)
    (recorder,) = command.pids("processes.services.recorder")
    os.kill(recorder, signal.SIGSTOP)
    await_true(lambda: not command.uav_pids())
    os.kill(recorder, signal.SIGCONT)
    ended = command.end()
    assert ended.status in {1, 3}
    assert "warning: the operator saw slot " in ended.stderr
    assert {result["guarantee"] for result in ended.json["guarantees"] if result["status"] == "held"} == set()
    assert ended.json["completed"] is not True
    for name in ("potential_collisions", "true_collisions", "energy_propulsion_j", "slots_missed"):
        assert ended.json[name] is None, name
