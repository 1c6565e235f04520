"""Writing recordings: MCAP files with zstd chunks and one JSON channel per topic.

This module reads no clock, so the same calls write the same bytes.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any, BinaryIO

import msgspec
from mcap.writer import CompressionType, Writer
from msgspec import Struct

from edc_swarm.errors import MessageError
from edc_swarm.protocol.codec import decode
from edc_swarm.protocol.keys import kind_of
from edc_swarm.protocol.messages import Instance, MissionMessage, Ns, Seq
from edc_swarm.recording.mcap_file import Channel
from edc_swarm.recording.schemas import json_schema

FORMAT = "1"
"""Version of the recording format; the writer puts it as `format` into the `run` metadata."""
MISSION_ATTACHMENT = "mission.json"
CHUNK_BYTES = 1 << 20
MAX_CHANNELS = 65_000
"""MCAP numbers channels with 16 bits."""
TOO_LARGE = "/too-large"
"""Topic with a `TooLarge` for every payload that was not recorded whole."""
KEPT_OF_TOO_LARGE_BYTES = 4096
_MAX_U32 = 0xFFFF_FFFF


class TooLarge(Struct, frozen=True, kw_only=True):
    """Record of a payload above the size limit: its size, its SHA-256 as hex, its first bytes (base64 in JSON)."""

    key: str
    size_bytes: int
    sha256: str
    first: bytes

    @property
    def reason(self) -> str:
        """One line that describes the rejected payload."""
        return f"too large: {self.size_bytes} bytes, sha256 {self.sha256[:64]}, first {len(self.first)} bytes kept"

    @classmethod
    def of(cls, key: str, payload: bytes) -> TooLarge:
        """Return the size, the digest and the first bytes of `payload`."""
        digest = hashlib.sha256(payload).hexdigest()
        return cls(key=key, size_bytes=len(payload), sha256=digest, first=payload[:KEPT_OF_TOO_LARGE_BYTES])


class RecordingWriter:
    """Writer of one recording to a binary stream that the caller opens and closes.

    Parameters
    ----------
    stream
        Destination of the bytes; it must support `tell`.
    run
        Facts about the run (versions, commit, command line, machine, clock), written as metadata `run`.

    Errors of the stream (such as a full disk) pass through as `OSError`.
    """

    def __init__(self, stream: BinaryIO, run: Mapping[str, str]) -> None:
        self._mcap: Any = Writer(stream, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._channels: dict[str, int] = {}
        self._copied: dict[Channel, int] = {}
        self._schemas: dict[str, int] = {}
        self._last_ns = 0
        self._count = 0
        self._has_mission = False
        self._mcap.start(profile="", library=f"edc-swarm {FORMAT}")
        self._mcap.add_metadata("run", {**run, "format": FORMAT})

    def has_room_for(self, key: str) -> bool:
        """Return True if `key` can be recorded: a file holds at most `MAX_CHANNELS` topics."""
        return key in self._channels or len(self._channels) < MAX_CHANNELS

    def write(self, key: str, payload: bytes, log_time_ns: int) -> None:
        """Record `payload` byte for byte, even if it is not a message.

        `log_time_ns` is the time of receipt; a time that goes back is recorded as the latest one so far.
        """
        stamp = stamp_of(payload)
        if not self._has_mission and is_mission(key, payload):
            self._has_mission = True
            self.attach(MISSION_ATTACHMENT, "application/json", payload, log_time_ns)
        channel = self._channels.get(key) or self._json_channel(key)
        self._add(channel, payload, log_time_ns, stamp.sent_ns, stamp.seq)

    def write_as(
        self, channel: Channel, payload: bytes, log_time_ns: int, publish_time_ns: int | None = None, seq: int = 0
    ) -> None:
        """Record a payload that is not a swarm message, such as a `foxglove.SceneUpdate`, on `channel`."""
        number = self._channels.get(channel.topic)
        if number is None:
            schema = self._schema(channel.schema_name, channel.schema_encoding, channel.schema_data)
            number = self._channel(channel.topic, channel.encoding, schema)
        self._add(number, payload, log_time_ns, publish_time_ns, seq)

    def copy(self, channel: Channel, payload: bytes, log_time_ns: int, publish_time_ns: int, seq: int) -> None:
        """Record a message of another recording with all its times and numbers unchanged."""
        known = self._copied.get(channel)
        if known is None:
            schema = self._schema(channel.schema_name, channel.schema_encoding, channel.schema_data)
            known = self._copied[channel] = self._mcap.register_channel(channel.topic, channel.encoding, schema)
        self._mcap.add_message(known, log_time_ns, payload, publish_time_ns, seq)
        self._count += 1

    def write_too_large(self, found: TooLarge, log_time_ns: int) -> None:
        """Record the description of a payload above the size limit."""
        schema = msgspec.json.encode(json_schema(TooLarge))
        channel = Channel(TOO_LARGE, "json", "edc_swarm.TooLarge", "jsonschema", schema)
        self.write_as(channel, msgspec.json.encode(found), log_time_ns)

    def attach(self, name: str, media_type: str, data: bytes, log_time_ns: int = 0) -> None:
        """Add an attachment, such as the layout of a viewer."""
        self._mcap.add_attachment(0, log_time_ns, name, media_type, data)

    def flush(self) -> None:
        """Close the current chunk, so that everything written so far survives the end of the process."""
        self._mcap.flush()

    def finish(self, run_end: Mapping[str, str]) -> None:
        """Write the metadata `run_end`, the summary and the footer; the stream stays open.

        `messages` is the number of messages written, unless `run_end` contains it.
        """
        self._mcap.flush()
        self._mcap.add_metadata("run_end", {"messages": str(self._count), **run_end})
        self._mcap.finish()

    def _channel(self, key: str, encoding: str, schema: int) -> int:
        channel: int = self._mcap.register_channel(key, encoding, schema)
        self._channels[key] = channel
        return channel

    def _add(self, channel: int, payload: bytes, log_ns: int, publish_ns: int | None, seq: int) -> None:
        self._last_ns = max(self._last_ns, log_ns)
        sent_ns = self._last_ns if publish_ns is None else publish_ns
        self._count += 1
        self._mcap.add_message(channel, self._last_ns, payload, sent_ns, seq & _MAX_U32)

    def _json_channel(self, key: str) -> int:
        kind = kind_of(key)
        if kind is None:
            return self._channel(key, "application/octet-stream", 0)
        schema = msgspec.json.encode(json_schema(kind))
        return self._channel(key, "json", self._schema(f"edc_swarm.{kind.__name__}", "jsonschema", schema))

    def _schema(self, name: str, encoding: str, data: bytes) -> int:
        if not name:
            return 0
        if name not in self._schemas:
            self._schemas[name] = self._mcap.register_schema(name, encoding, data)
        return self._schemas[name]


def is_mission(key: str, payload: bytes) -> bool:
    """Return True if `payload` is a valid mission message and `key` is the key of missions."""
    try:
        return kind_of(key) is MissionMessage and decode(key, payload) is not None
    except MessageError:
        return False


class Stamp(Struct, gc=False):
    """The fields of every message that identify it and give its time of sending."""

    instance: Instance = ""
    seq: Seq = 0
    sent_ns: Ns | None = None


_decode_stamp = msgspec.json.Decoder(Stamp).decode


def stamp_of(payload: bytes) -> Stamp:
    """Return the stamp of a message, or an empty stamp if `payload` is not a message."""

    try:
        return _decode_stamp(payload)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return Stamp()
