"""A damaged recording gives either a recording or one clear line, for any change of its bytes."""

from __future__ import annotations

import io
import tempfile
from functools import cache
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from edc_swarm.errors import RecordingError
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import complete_mission
from edc_swarm.protocol.codec import encode
from edc_swarm.protocol.keys import Keys
from edc_swarm.protocol.messages import Message, MissionMessage
from edc_swarm.recording.reader import read_recording, recover
from edc_swarm.recording.writer import RecordingWriter
from tests.builders import fix

KEYS = Keys("mission")


@cache
def whole() -> tuple[list[Message], bytes]:
    """Return a small recording in three chunks."""
    mission = complete_mission(Mission(uavs=2))
    fields = {name: getattr(mission, name) for name in mission.__struct_fields__}
    messages: list[Message] = [MissionMessage(**fields, epoch_ns=1)]
    messages += [fix("u001", slot, (1.0, 2.0), seq=slot, sent_ns=slot) for slot in range(30)]
    stream = io.BytesIO()
    writer = RecordingWriter(stream, {})
    for number, message in enumerate(messages):
        writer.write(KEYS.of(message), encode(message), message.sent_ns)
        if number % 10 == 9:
            writer.flush()
    writer.finish({})
    return messages, stream.getvalue()


def read(data: bytes) -> int:
    """Return the number of readable messages, -1 if the file is rejected, and assert that recovery agrees."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.mcap"
        path.write_bytes(data)
        try:
            recording = read_recording(path, salvage=True)
            recover(path, io.BytesIO())
        except RecordingError as error:
            assert "\n" not in str(error)  # noqa: PT017
            return -1
        return recording.message_count


@given(changes=st.lists(st.tuples(st.integers(0, 10**6), st.integers(0, 255)), min_size=1, max_size=6))
def test_changed_bytes_never_raise_anything_else(changes: list[tuple[int, int]]) -> None:
    """Bytes are overwritten at any place."""
    messages, data = whole()
    damaged = bytearray(data)
    for place, value in changes:
        damaged[place % len(data)] = value
    assert read(bytes(damaged)) <= len(messages)


@given(begin=st.integers(0, 10**6), count=st.integers(1, 400))
def test_missing_bytes_never_raise_anything_else(begin: int, count: int) -> None:
    """A piece is cut out at any place."""
    messages, data = whole()
    begin %= len(data)
    assert read(data[:begin] + data[begin + count :]) <= len(messages)


@given(data=st.binary(max_size=300))
def test_any_bytes_after_the_magic_never_raise_anything_else(data: bytes) -> None:
    """A file starts like MCAP and continues with any bytes."""
    assert read(b"\x89MCAP0\r\n" + data) == -1
