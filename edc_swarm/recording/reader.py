"""Reading a recording: one decoder per topic, one clear line for a file that cannot be read."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from operator import attrgetter
from pathlib import Path
from typing import Any, BinaryIO

import msgspec
from msgspec import Struct

from edc_swarm.errors import MessageError, RecordingError
from edc_swarm.messages import MAX_MESSAGE_BYTES, Command, Fix, Message, MissionMessage, Truth, decode, kind_of
from edc_swarm.recording.mcap_file import Channel, McapFile
from edc_swarm.recording.model import Garbage, Recording
from edc_swarm.recording.ordering import restore_order
from edc_swarm.recording.sifting import sift
from edc_swarm.recording.writer import FORMAT, MISSION_ATTACHMENT, RecordingWriter

Decode = Callable[[bytes], Message]
"""Raises MessageError."""
Sink = tuple[Decode | None, Callable[[Any], None]]
"""How the payloads of a topic are decoded (None: not at all) and where they go."""


def read_recording(path: str | Path, *, salvage: bool = False) -> Recording:
    """Read the recording at `path`.

    Parameters
    ----------
    path
        The file.
    salvage
        Read whatever is whole of a torn file; `Recording.problems` then says what is missing.

    Raises
    ------
    RecordingError
        Missing, empty, not MCAP, not one of our recordings, of another version, without a mission,
        or (without `salvage`) torn.
    """
    file = McapFile(Path(path))
    recording = Recording()
    _read_messages(file, recording)
    if file.problems and not salvage:
        raise RecordingError(path, f"{file.problems[0]}; `edc-swarm recover` makes what is there readable")
    recording.problems = file.problems
    _read_metadata(file, recording)
    if not recording.missions:
        recording.missions.append(_attached_mission(file))
    sift(recording)
    restore_order(recording)
    return recording


def recover(source: str | Path, stream: BinaryIO) -> list[str]:
    """Write all that can be read of a torn recording to `stream` as a whole one.

    Returns what is missing, one line each. Raises `RecordingError` as `read_recording` does.
    """
    file = McapFile(Path(source))
    messages = list(file.messages())
    _check_version(file)
    has_mission = any(kind_of(channel.topic) is MissionMessage for channel, *_ in messages)
    if not has_mission:
        _attached_mission(file)
    writer = RecordingWriter(stream, file.metadata["run"])
    for name, (media_type, data) in file.attachments.items():
        if name != MISSION_ATTACHMENT or not has_mission:
            writer.attach(name, media_type, data)
    for channel, _, log_ns, sent_ns, payload in messages:
        if kind_of(channel.topic) is None:
            writer.write_as(channel, payload, log_ns, sent_ns)
        else:
            writer.write(channel.topic, payload, log_ns)
    writer.finish({**file.metadata.get("run_end", {}), "recovered": "; ".join(file.problems) or "nothing missing"})
    return file.problems


def _read_messages(file: McapFile, recording: Recording) -> None:
    lists = recording.lists()
    sinks: dict[int, Sink] = {}
    for channel, _, log_ns, _, payload in file.messages():
        sink = sinks.get(id(channel))
        if sink is None:
            sink = sinks[id(channel)] = _sink(channel, lists)
        decode_payload, append = sink
        if decode_payload is None:
            recording.unknown[channel.topic] = recording.unknown.get(channel.topic, 0) + 1
            continue
        try:
            append(decode_payload(payload))
        except MessageError as error:
            recording.garbage.append(Garbage(channel.topic, log_ns, error.reason))


def _sink(channel: Channel, lists: dict[type, list[Any]]) -> Sink:
    kind = kind_of(channel.topic)
    if kind is None or channel.encoding != "json":
        return None, [].append
    return _decoder(channel.topic, kind), lists[kind].append


def _decoder(topic: str, kind: type[Struct]) -> Decode:
    """`messages.decode` for one topic, without what it looks up and lists anew for every message.

    The messages of which there are many have a way of their own here; a test holds the two equal.
    """
    if kind not in {Fix, Truth, Command}:
        return lambda payload: decode(topic, payload)
    decode_json = _json_decoder(kind)
    ends = ("head", "uav") if kind is Command else ("uav",)
    sender = attrgetter(*ends)
    parts = topic.split("/")
    expected: Any = (parts[-3], parts[-1]) if kind is Command else parts[-2]

    def fast(payload: bytes) -> Message:
        try:
            message: Message = decode_json(payload)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise MessageError(topic, str(error)) from None
        if sender(message) != expected or len(payload) > MAX_MESSAGE_BYTES:
            return decode(topic, payload)
        return message

    return fast


@cache
def _json_decoder(kind: type[Struct]) -> Callable[[bytes], Any]:
    """Made once, since a recording has hundreds of topics."""
    return msgspec.json.Decoder(kind).decode


def _read_metadata(file: McapFile, recording: Recording) -> None:
    _check_version(file)
    recording.run = file.metadata["run"]
    recording.run_end = file.metadata.get("run_end")


def _check_version(file: McapFile) -> None:
    run = file.metadata.get("run")
    if run is None:
        raise RecordingError(file.path, "is MCAP, but not a recording of edc-swarm (no `run` metadata)")
    if run.get("format") != FORMAT:
        found = run.get("format", "none")
        raise RecordingError(file.path, f"has recording format {found}; this version reads {FORMAT}")


def _attached_mission(file: McapFile) -> MissionMessage:
    if MISSION_ATTACHMENT not in file.attachments:
        raise RecordingError(file.path, "; ".join(["holds no mission", *file.problems[:1]]))
    try:
        mission = decode("mission", file.attachments[MISSION_ATTACHMENT][1])
    except MessageError as error:
        raise RecordingError(file.path, f"holds no mission ({error.reason})") from None
    assert isinstance(mission, MissionMessage)
    return mission
