"""Hostile neighbours on an open bus: a replay of an old recording, then noise and lies on every key."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from edc_swarm.protocol.messages import Event
from edc_swarm.recording.mcap_file import McapFile
from edc_swarm.recording.reader import read_recording
from edc_swarm.recording.sifting import OLDER
from edc_swarm.recording.writer import RecordingWriter
from processes.bus.address import free_endpoint
from tests.processes.conftest import Fly, Started

pytestmark = pytest.mark.timing

NOISE = Path(__file__).parents[2] / "benchmarks" / "noise.py"
MESSAGES = 3000
UAVS = ("--uavs", "5", "--seed", "3", "--speed-max", "3")


def test_neither_replays_nor_fuzzed_bytes_disturb_a_mission(start: Fly, tmp_path: Path) -> None:
    """Every guarantee holds, all UAVs arrive, no process crashes, no term moves; all noise is reported and dropped.

    The replays are of a mission with the same UAVs, starts and targets: once unchanged, under its own
    mission id, and once rewritten under the id of this mission, its end included.
    """
    old, endpoint = tmp_path / "old.mcap", free_endpoint()
    assert start("sim", *UAVS, "--json", name="old.mcap").end().status == 0
    flown = start("run", "--json", "--listen", endpoint, *UAVS, name="live.mcap")
    flown.await_flight(5)
    rewritten = tmp_path / "rewritten.mcap"
    _rewrite(old, rewritten, _mission(flown))
    for path in (old, rewritten):
        _run("-m", "processes.cli.main", "replay", str(path), "--connect", endpoint, "--speed", "50")
    _run(str(NOISE), "--connect", endpoint, "--messages", str(MESSAGES), "--rate", "400")
    assert flown.process.poll() is None, "the mission was still being flown"
    ended = flown.end()
    assert ended.status == 0, ended.stderr
    _check_events(ended.recording.events)
    reasons = Counter[str]()
    for garbage in ended.recording.garbage:
        reasons[garbage.reason] += garbage.count
    assert reasons.total() > MESSAGES / 4
    assert reasons[OLDER] > len(read_recording(old).commands)
    assert len({report.term for report in ended.recording.reports}) == 1


def _check_events(events: list[Event]) -> None:
    told = {event.source for event in events if event.kind == "malformed"}
    assert told > {"operator", "viz", "recorder"}
    assert [event.detail for event in events if event.kind == "exited"] == []


def _run(*arguments: str) -> None:
    said = subprocess.run([sys.executable, *arguments], capture_output=True, text=True, check=False)
    assert said.returncode == 0, said.stderr


def _mission(flown: Started) -> str:
    return read_recording(flown.path.with_name(flown.path.name + ".part"), salvage=True).mission.name


def _rewrite(source: Path, target: Path, mission: str) -> None:
    """Return the same messages on the keys and with the name of another mission."""
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
