"""Hostile neighbours on a bus that lets everybody in: noise, lies, and an old recording replayed."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from edc_swarm.recording import RecordingWriter, read_recording
from edc_swarm.recording.mcap_file import McapFile
from processes.address import free_endpoint
from tests.processes.conftest import Fly

NOISE = Path(__file__).parents[2] / "benchmarks" / "noise.py"
MESSAGES = 4000


def test_fuzzed_bytes_on_every_key_disturb_nobody(start: Fly):
    """Every guarantee holds, everybody arrives, nobody crashes, and it is told and dropped."""
    endpoint = free_endpoint()
    flown = start("run", "--json", "--listen", endpoint, "--uavs", "5", "--seed", "3")
    noise = [sys.executable, str(NOISE), "--connect", endpoint, "--messages", str(MESSAGES), "--rate", "600"]
    said = subprocess.run(noise, capture_output=True, text=True, check=True)
    assert said.stdout.strip() == str(MESSAGES)
    assert flown.process.poll() is None, "the mission was still being flown"
    ended = flown.end()
    assert ended.status == 0, ended.stderr
    events = ended.recording.events
    assert {"operator", "viz"} < {event.source for event in events if event.kind == "malformed"}
    assert not [event for event in events if event.kind == "exited"]
    assert len(ended.recording.garbage) > MESSAGES / 4


def test_replaying_an_old_recording_into_a_live_mission_has_no_effect(start: Fly, tmp_path: Path):
    """Neither as it was, under its own mission id, nor rewritten as if it were this mission's."""
    old = start("run", "--json", "--time-scale", "4", name="old.mcap").end()
    assert old.status == 0
    endpoint = free_endpoint()
    live = start("run", "--json", "--listen", endpoint, name="live.mcap")
    live.await_flight(10)
    root = read_recording(live.path.with_name("live.mcap.part"), salvage=True).mission.name
    rewritten = tmp_path / "rewritten.mcap"
    _rewrite(old.path, rewritten, root)
    for path in (old.path, rewritten):
        _replay(path, endpoint)
    assert live.process.poll() is None, "the mission was still being flown"
    ended = live.end()
    assert ended.status == 0, ended.stderr
    assert len({report.term for report in ended.recording.reports}) == 1
    older = {command.instance for command in old.recording.commands}
    assert len([g for g in ended.recording.garbage if g.reason == "of an older run"]) > 100
    assert older.isdisjoint(command.instance for command in ended.recording.commands)


def _replay(path: Path, endpoint: str) -> None:
    replay = [sys.executable, "-m", "processes.cli", "replay", str(path), "--connect", endpoint, "--speed", "20"]
    said = subprocess.run(replay, capture_output=True, text=True, check=False)
    assert said.returncode == 0, said.stderr


def _rewrite(source: Path, target: Path, mission: str) -> None:
    """The same messages on the keys of another mission, and in its name."""
    file, old = McapFile(source), read_recording(source).mission.name
    messages = list(file.messages())
    with target.open("wb") as stream:
        writer = RecordingWriter(stream, file.metadata["run"])
        for channel, _, log_ns, _, payload in messages:
            prefix, _, *rest = channel.topic.split("/")
            if prefix == "swarm":
                said = payload.replace(old.encode(), mission.encode())
                writer.write("/".join([prefix, mission, *rest]), said, log_ns)
        writer.finish({})
