"""Reading and recovering recordings.

The reader makes one decoder per topic, and reports a file that it cannot read in one line.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Hashable, Iterator
from functools import cache
from operator import attrgetter
from pathlib import Path
from typing import Any, BinaryIO

import msgspec
from msgspec import Struct

from edc_swarm.errors import EarlyEndError, MessageError, RecordingError
from edc_swarm.protocol.codec import MAX_MESSAGE_BYTES, MISPLACED, decode
from edc_swarm.protocol.keys import KEY_FORMS, PREFIX, kind_of
from edc_swarm.protocol.messages import Command, Fix, Message, MissionMessage, Truth
from edc_swarm.recording.mcap_file import Channel, McapFile
from edc_swarm.recording.model import Bin, Garbage, Recording
from edc_swarm.recording.sifting import sift
from edc_swarm.recording.writer import FORMAT, MISSION_ATTACHMENT, TOO_LARGE, RecordingWriter, TooLarge, is_mission

Decode = Callable[[bytes], Message]
"""Decoder of one topic's payloads; it raises MessageError."""
MAX_SEEN = 1_000_000
"""Most payloads of garbage and of unknown topics that are remembered to find duplicates."""
Sink = tuple[Decode | None, Callable[[Any], None]]
"""Decoder of a topic's payloads (None: they stay bytes) and the consumer of the result."""


def read_recording(path: str | Path, *, salvage: bool = False) -> Recording:
    """Read the recording at `path`.

    Parameters
    ----------
    path
        The file.
    salvage
        Read the complete part of a torn file; `Recording.problems` then lists what is missing.

    Raises
    ------
    RecordingError
        The file is missing, empty, not MCAP, not a recording of edc-swarm, of another version, without a
        mission, or (without `salvage`) torn.
    """
    file = McapFile(Path(path))
    recording = Recording()
    _read_messages(file, recording)
    if file.problems and not salvage:
        raise RecordingError(path, f"{file.problems[0]}; `edc-swarm recover` makes the complete part readable")
    recording.problems = file.problems
    _read_metadata(file, recording)
    recording.put_in_order()
    _choose_mission(file, recording)
    sift(recording)
    return recording


def recover(source: str | Path, stream: BinaryIO) -> list[str]:
    """Write the readable part of a torn recording to `stream` as an intact recording.

    Return one line for each part that is missing. Raise `RecordingError` as `read_recording` does.
    """
    file = McapFile(Path(source))
    mission = first_mission(file)
    writer = RecordingWriter(stream, file.metadata["run"])
    for name, (media_type, data) in file.attachments.items():
        writer.attach(name, media_type, data)
    if MISSION_ATTACHMENT not in file.attachments:
        writer.attach(MISSION_ATTACHMENT, "application/json", mission)
    for channel, sequence, log_ns, sent_ns, payload in McapFile(file.path).messages():
        writer.copy(channel, payload, log_ns, sent_ns, sequence)
    writer.finish({**file.metadata.get("run_end", {}), "recovered": "; ".join(file.problems) or "nothing missing"})
    return file.problems


def first_mission(file: McapFile) -> bytes:
    """Read `file` to its end, and return the payload of its first mission message, or of the attached one.

    Raise `RecordingError` as `read_recording` does, but not if the file is torn.
    """
    missions = _missions(file)
    found = next(missions, None)
    deque(missions, maxlen=0)
    _check_version(file)
    if found is None:
        _attached_mission(file)
        found = file.attachments[MISSION_ATTACHMENT][1]
    return found


def _missions(file: McapFile) -> Iterator[bytes]:
    """Yield the payload of every valid mission message."""
    for channel, _, _, _, payload in file.messages():
        if is_mission(channel.topic, payload):
            yield payload


def _read_messages(file: McapFile, recording: Recording) -> None:
    lists = recording.lists()
    sinks: dict[int, Sink] = {}
    garbage, seen = Bin(), Seen()
    for channel, sequence, log_ns, sent_ns, payload in file.messages():
        sink = sinks.get(id(channel))
        if sink is None:
            sink = sinks[id(channel)] = _sink(channel, lists)
        decode_payload, append = sink
        if decode_payload is not None:
            try:
                append(decode_payload(payload))
                continue
            except MessageError as error:
                refused = Garbage(channel.topic, log_ns, error.reason)
        if seen.before((channel.topic, sequence, sent_ns, payload)):
            recording.duplicates += 1
        elif decode_payload is not None:
            garbage.add(refused)
        elif channel.topic == TOO_LARGE:
            garbage.add(_too_large(payload, log_ns))
        elif channel.topic.startswith(f"{PREFIX}/") and _is_of_the_swarm(payload):
            garbage.add(Garbage(channel.topic, log_ns, MISPLACED))
        else:
            recording.unknown[channel.topic] = recording.unknown.get(channel.topic, 0) + 1
    recording.garbage = garbage.contents()


class Seen:
    """A bounded set of hashes of the payloads that were read as garbage or from unknown topics."""

    def __init__(self) -> None:
        self._hashes: set[int] = set()

    def before(self, entry: tuple[Hashable, ...]) -> bool:
        """Return True if an equal entry was read before; a new entry is forgotten once `MAX_SEEN` are remembered."""
        number = hash(entry)
        if number in self._hashes:
            return True
        if len(self._hashes) < MAX_SEEN:
            self._hashes.add(number)
        return False


def _is_of_the_swarm(payload: bytes) -> bool:
    """Return True if `payload`, recorded under a key that no message has, is a numbered message of the swarm."""
    for kind in KEY_FORMS:
        try:
            return bool(_json_decoder(kind)(payload).instance)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            continue
    return False


def _too_large(payload: bytes, log_ns: int) -> Garbage:
    try:
        found = msgspec.json.decode(payload, type=TooLarge)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        return Garbage(TOO_LARGE, log_ns, str(error))
    return Garbage(found.key, log_ns, found.reason)


def _sink(channel: Channel, lists: dict[type, list[Any]]) -> Sink:
    kind = kind_of(channel.topic)
    if kind is None or channel.encoding != "json":
        return None, [].append
    return _decoder(channel.topic, kind), lists[kind].append


def _decoder(topic: str, kind: type[Struct]) -> Decode:
    """Return a decoder equal to `codec.decode` for one topic that does the work per topic only once.

    The frequent kinds of message have a fast path here; a test shows that both give the same results.
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
    """Return the JSON decoder of a message type. It is cached, because a recording has hundreds of topics."""
    return msgspec.json.Decoder(kind).decode


def _read_metadata(file: McapFile, recording: Recording) -> None:
    _check_version(file)
    recording.run = file.metadata["run"]
    recording.run_end = file.metadata.get("run_end")


def _check_version(file: McapFile) -> None:
    run = file.metadata.get("run")
    if run is None and file.problems and not file.channels:
        raise EarlyEndError(file.path, "; ".join(["holds no `run` metadata", *file.problems[:1]]))
    if run is None:
        raise RecordingError(file.path, "is MCAP, but not a recording of edc-swarm (no `run` metadata)")
    if run.get("format") != FORMAT:
        found = run.get("format", "none")
        raise RecordingError(file.path, f"has recording format {found}; this version reads {FORMAT}")


def _choose_mission(file: McapFile, recording: Recording) -> None:
    """Put the mission of the run first: the attached one, which is the first one that the recorder received."""
    if not recording.missions:
        recording.missions.append(_attached_mission(file))
    elif len(recording.missions) > 1 and MISSION_ATTACHMENT in file.attachments:
        attached = _attached_mission(file)
        recording.missions.sort(key=lambda mission: mission != attached)


def _attached_mission(file: McapFile) -> MissionMessage:
    if MISSION_ATTACHMENT not in file.attachments:
        error = EarlyEndError if file.problems else RecordingError
        raise error(file.path, "; ".join(["holds no mission", *file.problems[:1]]))
    try:
        mission = decode("mission", file.attachments[MISSION_ATTACHMENT][1])
    except MessageError as error:
        raise RecordingError(file.path, f"holds no mission: {error.reason}") from None
    assert isinstance(mission, MissionMessage)
    return mission
