"""The recorder's file of a running mission: its counts, its limits, and the layout of its mission."""

from __future__ import annotations

from pathlib import Path

from edc_swarm.protocol.codec import MAX_MESSAGE_BYTES, encode
from edc_swarm.protocol.keys import Keys
from edc_swarm.recording.reader import read_recording
from processes.services.recording_file import MAX_FOREIGN_KEYS, MAX_SCENE_BYTES, Received, RecordingFile
from tests.unit.synthetic import flight, mission_of, parallel

KEYS = Keys(mission_of(parallel()).name)


def test_the_file_counts_what_it_writes_and_what_it_leaves_out(tmp_path: Path) -> None:
    """Every message of the mission is written, foreign keys up to their limit, and the facts count both."""
    path, messages = tmp_path / "flight.mcap", flight(parallel())
    with path.open("wb") as stream:
        file = RecordingFile(stream, KEYS, {"clock": "wall"})
        foreign = [KEYS.event(f"x{number}") for number in range(MAX_FOREIGN_KEYS + 7)]
        written = [file.has_place(key) for key in foreign]
        missions = [
            file.write(Received(KEYS.of(m), encode(m), m.sent_ns), fetched=i < 3) for i, m in enumerate(messages)
        ]
        assert all(file.has_place(KEYS.of(message)) for message in messages)
        file.flush()
        file.finish(dropped=2)
    assert written == [True] * MAX_FOREIGN_KEYS + [False] * 7
    assert [found for found in missions if found is not None] == messages[:1]
    recording = read_recording(path)
    assert recording.message_count == len(messages)
    assert recording.run_end == {
        "messages": str(len(messages)),
        "dropped": "2",
        "foreign_left_out": "7",
        "fetched": "3",
    }


def test_scenes_may_be_larger_than_messages(tmp_path: Path) -> None:
    """The limit of a payload follows from its key."""
    with (tmp_path / "flight.mcap").open("wb") as stream:
        file = RecordingFile(stream, KEYS, {})
        assert file.limit_bytes(f"{KEYS.root}/viz/scene") == MAX_SCENE_BYTES
        assert file.limit_bytes(KEYS.fix("u0")) == MAX_MESSAGE_BYTES
