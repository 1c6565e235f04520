"""Property: any order of the messages in a file, and a file merged with itself, read the same."""

from __future__ import annotations

import io
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, IndexType, Writer

from edc_swarm.analysis.guarantees.check import check
from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.protocol.codec import encode
from edc_swarm.protocol.keys import Keys
from edc_swarm.recording.mcap_file import McapFile, Raw
from edc_swarm.recording.reader import read_recording, recover
from edc_swarm.recording.writer import RecordingWriter
from tests.property.test_late_messages import fly


@pytest.fixture(scope="module")
def original() -> McapFile:
    """Return a recording with a new head, a restart and losses, in memory except for its messages."""
    path = Path(tempfile.mkdtemp()) / "run.mcap"
    said = fly()
    with path.open("wb") as stream:
        writer, keys = RecordingWriter(stream, {}), Keys(said[0].name)  # type: ignore[union-attr]
        for message in said:
            writer.write(keys.of(message), encode(message), message.sent_ns)
        writer.write(keys.fix("u001"), b"garbage", said[-1].sent_ns)
        writer.write("swarm/strange/key", b"{}", said[-1].sent_ns)
        writer.finish({"dropped": "0", "fetched": "0"})
    return McapFile(path)


def rewritten(file: McapFile, raws: Iterable[Raw], **options: Any) -> bytes:
    """Return a file of the messages as another tool writes it."""
    stream = io.BytesIO()
    writer: Any = Writer(stream, **options)
    writer.start(profile="", library="another tool")
    numbers: dict[str, int] = {}
    for channel, sequence, log_ns, sent_ns, payload in raws:
        if channel.topic not in numbers:
            numbers[channel.topic] = writer.register_channel(channel.topic, channel.encoding, 0)
        writer.add_message(numbers[channel.topic], log_ns, payload, sent_ns, sequence)
    for name, facts in file.metadata.items():
        writer.add_metadata(name, facts)
    for name, (media_type, data) in file.attachments.items():
        writer.add_attachment(0, 0, name, media_type, data)
    writer.finish()
    return stream.getvalue()


def computed(data: bytes, folder: Path) -> tuple[Any, Any]:
    """Return metrics and verdicts."""
    path = folder / "again.mcap"
    path.write_bytes(data)
    recording = read_recording(path)
    return compute_metrics(recording), check(recording)


@settings(max_examples=15, deadline=None)
@given(data=st.data())
def test_any_order_of_the_file_reads_the_same(original: McapFile, data: st.DataObject) -> None:
    """The messages are shuffled by a random seed, then reversed, or sorted by topic."""
    raws = list(original.messages())
    rng = data.draw(st.randoms(use_true_random=True))
    order = data.draw(st.sampled_from(["shuffled", "reversed", "by topic"]))
    with tempfile.TemporaryDirectory() as folder:
        expected = computed(rewritten(original, raws), Path(folder))
        if order == "shuffled":
            rng.shuffle(raws)
        elif order == "reversed":
            raws.reverse()
        else:
            raws.sort(key=lambda raw: raw[0].topic)
        assert computed(rewritten(original, raws), Path(folder)) == expected


def test_a_file_merged_with_itself_counts_each_message_once(original: McapFile, tmp_path: Path) -> None:
    """This holds for garbage and unknown topics too; the number of dropped duplicates is reported."""
    raws = list(original.messages())
    once, verdicts = computed(rewritten(original, raws), tmp_path)
    twice, again = computed(rewritten(original, raws + raws), tmp_path)
    assert (once.duplicates, twice.duplicates) == (0, len(raws))
    assert (twice.messages, twice.gaps, twice.path_m) == (once.messages, once.gaps, once.path_m)
    assert [result.status for result in again] == [result.status for result in verdicts]
    (g5,) = (result for result in again if result.guarantee == "G5")
    assert any(note.startswith(f"duplicates: {len(raws)} messages") for note in g5.notes)


@pytest.mark.parametrize(
    "options",
    [
        {"compression": CompressionType.LZ4},
        {"compression": CompressionType.NONE},
        {"use_chunking": False},
        {"index_types": IndexType.NONE, "use_statistics": False, "use_summary_offsets": False},
        {"enable_crcs": False},
        {"chunk_size": 64},
    ],
)
def test_files_of_other_tools_read_the_same(original: McapFile, tmp_path: Path, options: dict[str, Any]) -> None:
    """Recovery of such a file loses no message."""
    raws = list(original.messages())
    data = rewritten(original, raws, **options)
    assert computed(data, tmp_path) == computed(rewritten(original, raws), tmp_path)
    whole = io.BytesIO()
    assert recover(tmp_path / "again.mcap", whole) == []
    (tmp_path / "whole.mcap").write_bytes(whole.getvalue())
    assert [(c.topic, *rest) for c, *rest in McapFile(tmp_path / "whole.mcap").messages()] == [
        (c.topic, *rest) for c, *rest in raws
    ]
