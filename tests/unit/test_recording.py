"""Recordings are read as they were written, the same bytes every time, and torn files are read in part."""

from __future__ import annotations

import hashlib
import io
import random
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import pytest
from mcap.reader import make_reader

from edc_swarm.analysis.guarantees.check import check
from edc_swarm.errors import RecordingError
from edc_swarm.protocol.codec import encode
from edc_swarm.protocol.keys import Keys
from edc_swarm.protocol.messages import Command, Event, Fix, Message, MissionMessage, Report, Truth
from edc_swarm.recording.mcap_file import MAGIC, Channel
from edc_swarm.recording.model import Recording
from edc_swarm.recording.reader import read_recording, recover
from edc_swarm.recording.schemas import json_schema
from edc_swarm.recording.sifting import sift
from edc_swarm.recording.writer import RecordingWriter, TooLarge
from processes.runtime.console import complain
from tests.unit.synthetic import EPOCH_NS, flight, parallel

KEYS = Keys("mission")
SCENE = Channel("swarm/mission/viz/scene", "protobuf", "foxglove.SceneUpdate", "protobuf", b"\x01")
RUN = {"edc_swarm": "0.1.0", "clock": "virtual"}
KINDS = (Fix, Truth, Command, Report, Event, MissionMessage)


def record(messages: list[Message], stream: Any = None, finish: bool = True) -> bytes:
    """Return the bytes of a recording of `messages`, received when sent."""
    stream = stream or io.BytesIO()
    writer = RecordingWriter(stream, RUN)
    for message in messages:
        writer.write(KEYS.of(message), encode(message), message.sent_ns)
    if finish:
        writer.finish({"reason": "completed"})
    else:
        writer.flush()
    written: bytes = stream.getvalue()
    return written


@pytest.fixture
def messages() -> list[Message]:
    """Return a faultless mission of three UAVs."""
    return flight(parallel())


def saved(path: Path, data: bytes) -> Path:
    """Write a file with that content."""
    path.write_bytes(data)
    return path


def test_what_is_written_comes_back(tmp_path: Path, messages: list[Message]) -> None:
    """Every message is in its list, and the facts of the run are there."""
    recording = read_recording(saved(tmp_path / "a.mcap", record(messages)))
    expected = Recording.from_messages(messages)
    assert recording.lists() == expected.lists()
    assert recording.run == {**RUN, "format": "1"}
    assert recording.run_end == {"messages": str(len(messages)), "reason": "completed"}
    assert recording.message_count == len(messages)
    assert recording.problems == []


@pytest.mark.parametrize("run_end", [{"fetched": "1"}, {"recovered": "torn"}, {"fetched": "0"}])
def test_what_came_late_is_read_in_its_place(tmp_path: Path, messages: list[Message], run_end: dict[str, str]) -> None:
    """A late message takes its place by its number, for any `run_end`."""
    late = [m for m in messages if isinstance(m, Fix) and m.uav == "u1" and m.slot in {2, 3}]
    stream = io.BytesIO()
    writer = RecordingWriter(stream, {})
    for message in [*(m for m in messages if m not in late), *late]:
        writer.write(KEYS.of(message), encode(message), message.sent_ns)
    writer.finish(run_end)
    recording = read_recording(saved(tmp_path / "a.mcap", stream.getvalue()))
    said = [fix for fix in recording.fixes if fix.uav == "u1"]
    assert [fix.seq for fix in said] == sorted(fix.seq for fix in said)


def test_same_messages_same_bytes(messages: list[Message]) -> None:
    """The bytes of a file depend only on its messages."""
    assert record(messages) == record(messages)


def test_an_independent_reader_sees_the_promised_layout(messages: list[Message]) -> None:
    """Topic = key, publish time = sent, sequence = seq, `run` first, mission attached."""
    data = record(messages)
    reader = make_reader(io.BytesIO(data), validate_crcs=True)
    seen = list(reader.iter_messages(log_time_order=False))
    logged = [message.log_time for _, _, message in seen]
    assert logged == sorted(logged)
    for (schema, channel, record_), message in zip(seen, messages, strict=True):
        assert channel.topic == KEYS.of(message)
        assert channel.message_encoding == "json"
        assert schema is not None
        assert (schema.name, schema.encoding) == (f"edc_swarm.{type(message).__name__}", "jsonschema")
        assert (record_.publish_time, record_.sequence) == (message.sent_ns, message.seq)
        assert record_.data == encode(message)
    assert [m.name for m in reader.iter_metadata()] == ["run", "run_end"]
    assert [a.name for a in reader.iter_attachments()] == ["mission.json"]


def test_garbage_and_unknown_topics_are_kept_verbatim(tmp_path: Path, messages: list[Message]) -> None:
    """The recorder writes every payload; readers report those that are not messages."""
    stream = io.BytesIO()
    writer = RecordingWriter(stream, RUN)
    for message in messages:
        writer.write(KEYS.of(message), encode(message), message.sent_ns)
    last_ns = messages[-4].sent_ns
    junk = [b"", b"\xff\xfe", b"[1", b'{"uav":"u0","slot":1}', b'{"seq":-1,"sent_ns":"x"}']
    for payload in junk:
        writer.write(KEYS.fix("u0"), payload, last_ns)
    writer.write("swarm/mission/else/where", b"\x00\x01", last_ns)
    writer.write_as(SCENE, b"\x0a", last_ns)
    writer.finish({})
    recording = read_recording(saved(tmp_path / "a.mcap", stream.getvalue()))
    assert [g.topic for g in recording.garbage] == [KEYS.fix("u0")] * len(junk)
    assert recording.unknown == {"swarm/mission/else/where": 1, "swarm/mission/viz/scene": 1}
    raw = [m.data for *_, m in make_reader(io.BytesIO(stream.getvalue())).iter_messages(log_time_order=False)]
    assert raw[-7:-2] == junk


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("x_m", b"1e999"),
        ("uav", b'"u1"'),
        ("slot", b"-7"),
        ("head", b'"not an id"'),
        ("term", b"0.5"),
        ("term", b" " * (1 << 20) + b"1"),
    ],
)
def test_the_fast_decoder_refuses_what_the_codec_refuses(
    tmp_path: Path, messages: list[Message], field: str, value: bytes
) -> None:
    """Infinity, a wrong sender, and every value beyond a limit is reported as garbage."""
    fix = next(m for m in messages if isinstance(m, Fix))
    whole = {k: msgspec.Raw(msgspec.json.encode(v)) for k, v in msgspec.to_builtins(fix).items()}
    payload = msgspec.json.encode({**whole, field: msgspec.Raw(value)})
    stream = io.BytesIO()
    writer = RecordingWriter(stream, RUN)
    writer.write(KEYS.mission, encode(messages[0]), 0)
    writer.write(KEYS.fix("u0"), payload, 1)
    writer.finish({})
    recording = read_recording(saved(tmp_path / "a.mcap", stream.getvalue()))
    assert (len(recording.fixes), len(recording.garbage)) == (0, 1)


def test_log_time_never_goes_back(messages: list[Message]) -> None:
    """A clock that goes back does not change the order of the file."""
    stream = io.BytesIO()
    writer = RecordingWriter(stream, RUN)
    for log_ns in (5, 3, 9):
        writer.write(KEYS.mission, encode(messages[0]), log_ns)
    writer.finish({})
    seen = make_reader(io.BytesIO(stream.getvalue())).iter_messages()
    assert [message.log_time for *_, message in seen] == [5, 5, 9]


def test_what_was_flushed_survives(tmp_path: Path, messages: list[Message]) -> None:
    """A file that ends after a flush is torn, and every message in it is still read."""
    path = saved(tmp_path / "a.mcap", record(messages, finish=False))
    with pytest.raises(RecordingError, match="torn"):
        read_recording(path)
    recording = read_recording(path, salvage=True)
    assert recording.message_count == len(messages)
    assert recording.run_end is None
    assert len(recording.problems) == 1


def test_a_torn_file_is_read_at_every_length(tmp_path: Path, messages: list[Message]) -> None:
    """A file cut at any byte gives one line, or its complete part."""
    stream = io.BytesIO()
    writer = RecordingWriter(stream, RUN)
    for number, message in enumerate(messages):
        writer.write(KEYS.of(message), encode(message), message.sent_ns)
        if number % 20 == 19:
            writer.flush()
    writer.finish({})
    data = stream.getvalue()
    counts = []
    for length in range(0, len(data), 97):
        try:
            counts.append(read_recording(saved(tmp_path / "a.mcap", data[:length]), salvage=True).message_count)
        except RecordingError as error:
            assert "\n" not in str(error)  # noqa: PT017
            assert not counts
    assert counts == sorted(counts)
    assert counts[-1] == len(messages)


def test_a_torn_file_says_what_is_missing(tmp_path: Path, messages: list[Message]) -> None:
    """The line gives the bytes of a cut record, or that the file stops."""
    whole, stopped = record(messages), record(messages, finish=False)
    end = len(whole) - len(MAGIC)
    assert problem_of(tmp_path, whole[:-1]) == f"{len(MAGIC) - 1} bytes after byte {end} are unreadable"
    assert problem_of(tmp_path, stopped) == f"it stops after byte {len(stopped)}"


def problem_of(folder: Path, data: bytes) -> str:
    """Return the problem that is reported for a file without an end."""
    (problem,) = read_recording(saved(folder / "torn.mcap", data), salvage=True).problems
    return problem.removeprefix("torn: no end of file; ")


def test_recover_makes_a_whole_file(tmp_path: Path, messages: list[Message]) -> None:
    """A recovered file is intact and lists what was missing."""
    torn = saved(tmp_path / "a.mcap.part", record(messages, finish=False)[:-3])
    stream = io.BytesIO()
    problems = recover(torn, stream)
    recording = read_recording(saved(tmp_path / "a.mcap", stream.getvalue()))
    assert len(problems) == 1
    assert "torn" in problems[0]
    assert recording.run_end == {"messages": str(recording.message_count), "recovered": problems[0]}
    assert recording.lists() == read_recording(torn, salvage=True).lists()


def test_recover_changes_nothing_of_a_whole_file(tmp_path: Path, messages: list[Message]) -> None:
    """Topics, payloads, times and schemas stay, protobuf ones too."""
    stream = io.BytesIO()
    writer = RecordingWriter(stream, RUN)
    writer.write(KEYS.mission, encode(messages[0]), 3)
    writer.write_as(SCENE, b"\x0a", 4, 2)
    writer.attach("layout.json", "application/json", b"{}")
    writer.finish({"reason": "completed"})
    again = io.BytesIO()
    assert recover(saved(tmp_path / "a.mcap", stream.getvalue()), again) == []
    before, after = (list(make_reader(io.BytesIO(s.getvalue())).iter_messages()) for s in (stream, again))
    assert before == after
    assert {a.name for a in make_reader(io.BytesIO(again.getvalue())).iter_attachments()} == {
        "layout.json",
        "mission.json",
    }


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "is empty"),
        (b"hello, world", "is not an MCAP file"),
        (b"\x89MCAP9\r\n", "version other than 0"),
    ],
)
def test_bad_files_are_one_clear_line(tmp_path: Path, data: bytes, reason: str) -> None:
    """The error names the file and the problem."""
    path = saved(tmp_path / "bad.mcap", data)
    with pytest.raises(RecordingError, match=reason) as caught:
        read_recording(path, salvage=True)
    assert caught.value.path == path


def test_a_missing_file_is_one_clear_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The error is a sentence with the operating system's reason, and without brackets in brackets."""
    path = tmp_path / "none.mcap"
    with pytest.raises(RecordingError, match="No such file") as caught:
        read_recording(path)
    assert complain(caught.value) == 2
    said = f"error: recording = '{path}': must be a readable recording; it cannot be read: No such file or directory\n"
    assert capsys.readouterr().err == said


def test_other_formats_are_refused(tmp_path: Path, messages: list[Message]) -> None:
    """The error names a recording of another format version, or of another program."""
    data = record(messages)
    newer = data.replace(b"format\x01\x00\x00\x001", b"format\x01\x00\x00\x009")
    with pytest.raises(RecordingError, match="has recording format 9; this version reads 1"):
        read_recording(saved(tmp_path / "a.mcap", newer))
    foreign = data.replace(b"\x03\x00\x00\x00run", b"\x03\x00\x00\x00ran")
    with pytest.raises(RecordingError, match="not a recording of edc-swarm"):
        read_recording(saved(tmp_path / "b.mcap", foreign))


def test_a_recording_without_a_mission_is_refused(tmp_path: Path, messages: list[Message]) -> None:
    """No metric can be computed without the mission."""
    with pytest.raises(RecordingError, match="holds no mission"):
        read_recording(saved(tmp_path / "a.mcap", record(messages[1:])))


def in_subset(schema: dict[str, Any]) -> bool:
    """Return True if viewers accept a schema: every field typed, no references, no nested arrays."""
    assert schema.keys() <= {"title", "type", "enum", "properties", "items"}
    assert schema["type"] in {"object", "array", "string", "number", "integer", "boolean"}
    if schema["type"] == "array":
        assert schema["items"]["type"] != "array"
        return in_subset(schema["items"])
    assert ("properties" in schema) == (schema["type"] == "object")
    return all(in_subset(field) for field in schema.get("properties", {}).values())


@pytest.mark.parametrize("kind", KINDS)
def test_every_schema_is_inside_what_viewers_accept(kind: type[msgspec.Struct]) -> None:
    """Viewers reject a whole topic with any other schema; no field is left out."""
    schema = json_schema(kind)
    assert in_subset(schema)
    assert set(schema["properties"]) == set(kind.__struct_fields__)


def test_nullable_fields_are_flattened() -> None:
    """An optional field is described by its type alone."""

    class Odd(msgspec.Struct):
        name: str | None = None

    assert json_schema(Odd)["properties"]["name"] == {"type": "string"}


def test_chunks_do_not_overlap(messages: list[Message]) -> None:
    """Viewers warn of chunks that overlap in time and read them slowly, so times that go back are held."""
    stream = io.BytesIO()
    writer = RecordingWriter(stream, RUN)
    for number, message in enumerate(messages):
        writer.write(KEYS.of(message), encode(message), message.sent_ns - (number % 3) * 10**9)
        if number % 20 == 19:
            writer.flush()
    writer.finish({})
    summary = make_reader(io.BytesIO(stream.getvalue())).get_summary()
    assert summary is not None
    spans = [(chunk.message_start_time, chunk.message_end_time) for chunk in summary.chunk_indexes]
    assert len(spans) > 3
    assert all(before[1] <= after[0] for before, after in pairwise(spans))


def test_what_is_of_nobody_or_of_an_older_run_counts_for_nothing(tmp_path: Path, messages: list[Message]) -> None:
    """Foreign messages are in the file and reported; a wrong message of a UAV of this run stays."""
    fix = next(m for m in messages if isinstance(m, Fix))
    report = next(m for m in messages if isinstance(m, Report))
    older = {"instance": "old", "sent_ns": fix.sent_ns - 10**12}
    strange = [
        msgspec.structs.replace(fix, uav="zz"),
        msgspec.structs.replace(fix, uav="zz", instance="old"),
        msgspec.structs.replace(fix, **older),
        msgspec.structs.replace(messages[0], instance="old"),
        Event(source="zz", kind="closed", sent_ns=fix.sent_ns, detail='{"uav/u0/fix":99}'),
        msgspec.structs.replace(Event(source="u0", kind="closed", detail='{"uav/u0/fix":99}'), **older),
    ]
    wrong = msgspec.structs.replace(report, slot=9, seq=9, grants=["u0"], quorum=1)
    recording = read_recording(saved(tmp_path / "a.mcap", record([*messages, *strange, wrong])))
    assert recording.garbage_count == len(strange)
    assert {garbage.reason for garbage in recording.garbage} == {"from an older run", "from no process of the mission"}
    assert recording.lists() == Recording.from_messages([*messages, wrong]).lists()
    (complete,) = (result for result in check(recording) if result.guarantee == "G5")
    assert not any("99" in where for where in complete.where)


def test_a_mission_that_ends_before_its_first_slot_is_of_this_run(messages: list[Message]) -> None:
    """Autopilots take off before slot 0: what is said from the publication on counts, and what is older does not."""
    mission = messages[0]
    assert isinstance(mission, MissionMessage)
    published_ns = mission.epoch_ns - 20 * 10**9
    said = Event(source="u0", instance="new", kind="autopilot", detail="armed", sent_ns=published_ns + 1)
    older = msgspec.structs.replace(said, instance="old", sent_ns=published_ns - 1)
    recording = Recording.from_messages([msgspec.structs.replace(mission, sent_ns=published_ns), said, older])
    sift(recording)
    assert recording.events == [said]
    assert [garbage.reason for garbage in recording.garbage] == ["from an older run"]


def test_a_flood_of_garbage_makes_few_notes(tmp_path: Path, messages: list[Message]) -> None:
    """There is one note per topic and reason, within a limit."""
    stream = io.BytesIO()
    writer = RecordingWriter(stream, RUN)
    writer.write(KEYS.mission, b"garbage first", 0)
    writer.write(KEYS.mission, encode(messages[0]), 0)
    for number in range(300):
        writer.write(KEYS.fix(f"x{number % 50}"), b"{", 1 + number)
    writer.finish({})
    recording = read_recording(saved(tmp_path / "a.mcap", stream.getvalue()))
    attached = next(make_reader(io.BytesIO(stream.getvalue())).iter_attachments())
    assert attached.data == encode(messages[0])
    (complete,) = (result for result in check(recording) if result.guarantee == "G5")
    notes = [note for note in complete.notes if note.startswith("not ")]
    assert len(notes) == 21
    assert notes[0].endswith(", 6 times")
    assert notes[-1] == "not messages: 301 in all, 51 kinds of them"


def test_a_file_of_huge_payloads_is_read_in_bounded_memory(tmp_path: Path, messages: list[Message]) -> None:
    """Each payload is freed before the next is read: 80 MB of them need less than half of that."""
    path = tmp_path / "a.mcap"
    with path.open("wb") as stream:
        writer = RecordingWriter(stream, RUN)
        writer.write(KEYS.mission, encode(messages[0]), 0)
        for number in range(20):
            writer.write(KEYS.event("u0"), random.Random(number).randbytes(4 << 20), number)
        writer.finish({})
    code = (
        "import resource, sys; from edc_swarm.recording.reader import read_recording;"
        "before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss;"
        "count = read_recording(sys.argv[1]).garbage_count;"
        "print(count, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)"
    )
    told = subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, text=True, check=True).stdout
    count, grown_kb = map(int, told.split())
    assert count == 20
    assert grown_kb < 40_000


def test_of_a_payload_that_was_too_large_is_told_what_was_kept(tmp_path: Path, messages: list[Message]) -> None:
    """Key, size and hash of a too large payload are reported as garbage."""
    stream = io.BytesIO()
    writer = RecordingWriter(stream, RUN)
    writer.write(KEYS.mission, encode(messages[0]), 0)
    writer.write_too_large(TooLarge.of(KEYS.event("u0"), bytes(8 << 20)), 1)
    writer.finish({})
    assert len(stream.getvalue()) < 50_000
    (garbage,) = read_recording(saved(tmp_path / "a.mcap", stream.getvalue())).garbage
    digest = hashlib.sha256(bytes(8 << 20)).hexdigest()
    assert garbage.topic == KEYS.event("u0")
    assert garbage.reason == f"too large: 8388608 bytes, sha256 {digest}, first 4096 bytes kept"


def test_an_unknown_codec_is_named_and_nothing_is_recovered(tmp_path: Path, messages: list[Message]) -> None:
    """A reader with the codec would read more than recovery could keep."""
    stream = io.BytesIO()
    writer = RecordingWriter(stream, RUN)
    writer.write(KEYS.mission, encode(messages[0]), 0)
    writer.finish({})
    path = saved(tmp_path / "a.mcap", stream.getvalue().replace(b"\x04\x00\x00\x00zstd", b"\x04\x00\x00\x00oops"))
    kept = io.BytesIO()
    for work in (lambda: read_recording(path, salvage=True), lambda: recover(path, kept)):
        with pytest.raises(RecordingError, match="is compressed with 'oops'; known are '', 'zstd', 'lz4'"):
            work()
    assert kept.getvalue() == b""


def test_messages_and_the_file_of_them_are_in_one_order(tmp_path: Path) -> None:
    """Whatever order they come in, and with one of them twice."""
    messages = flight(parallel())
    path, shuffled = tmp_path / "run.mcap", [*reversed(messages), messages[-1]]
    with path.open("w+b") as stream:
        writer = RecordingWriter(stream, {})
        for message in shuffled:
            writer.write(Keys("mission").of(message), encode(message), EPOCH_NS)
        writer.finish({})
    made, read = Recording.from_messages(shuffled), read_recording(path)
    assert made.lists() == read.lists() == Recording.from_messages(messages).lists()
    assert (made.duplicates, read.duplicates) == (1, 1)


def test_a_message_under_the_key_of_another_is_told(tmp_path: Path) -> None:
    """Under another UAV's key, and under one that nobody uses: how many, and the first; noise there is only unknown."""
    messages, path = flight(parallel()), tmp_path / "run.mcap"
    fixes = [encode(m) for m in messages if isinstance(m, Fix) and m.uav == "u1"]
    with path.open("w+b") as stream:
        writer = RecordingWriter(stream, {})
        for message in messages:
            writer.write(Keys("mission").of(message), encode(message), EPOCH_NS)
        writer.write("swarm/mission/head/u1/fix", fixes[0], EPOCH_NS + 1)
        writer.write("swarm/mission/head/u1/fix", fixes[1], EPOCH_NS + 2)
        writer.write("swarm/mission/uav/u0/fix", fixes[2], EPOCH_NS + 3)
        writer.write("swarm/mission/head/u2/fix", b"{}", EPOCH_NS + 4)
        writer.finish({})
    (complete,) = (result for result in check(read_recording(path)) if result.guarantee == "G5")
    told = "recorded under the key of another: 3 messages, the first under swarm/mission/head/u1/fix"
    assert [note for note in complete.notes if "another" in note] == [told]
    assert any("unknown topics: 1 with 1 messages: 'swarm/mission/head/u2/fix'" in note for note in complete.notes)
