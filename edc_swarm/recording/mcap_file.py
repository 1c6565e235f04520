"""The MCAP container, read straight from its bytes.

The `mcap` package's reader makes several Python objects per message; metrics read a million
messages, so records are unpacked here (format: https://mcap.dev/spec) and chunks are walked in the
order of the file. Whatever is whole before the first torn record is delivered.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import zstandard

from edc_swarm.errors import RecordingError
from edc_swarm.files import read_regular

MAGIC = b"\x89MCAP0\r\n"
_RECORD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_CHUNK_HEAD = struct.Struct("<QQQI")
MAX_CHUNK_BYTES = 1 << 30


class _Op:
    """Record types that are read; all others are skipped."""

    FOOTER = 2
    SCHEMA = 3
    CHANNEL = 4
    MESSAGE = 5
    CHUNK = 6
    ATTACHMENT = 9
    METADATA = 12


@dataclass(frozen=True, slots=True)
class Channel:
    """A topic and what its payloads are."""

    topic: str
    encoding: str
    schema_name: str = ""
    schema_encoding: str = ""
    schema_data: bytes = b""


Raw = tuple[Channel, int, int, int, bytes]
"""Channel, sequence, log time and publish time in nanoseconds, payload."""


@dataclass(slots=True)
class McapFile:
    """Reads one file. `messages()` is to be exhausted first: the rest fills up on the way.

    Attributes
    ----------
    problems
        What could not be read, one line each; a whole file has none.
    """

    path: Path
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    attachments: dict[str, tuple[str, bytes]] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    _schemas: dict[int, tuple[str, str, bytes]] = field(default_factory=dict)
    _channels: dict[int, Channel] = field(default_factory=dict)

    def messages(self) -> Iterator[Raw]:
        """Every message in the order of the file.

        Raises
        ------
        RecordingError
            The file cannot be opened, is empty, or is not MCAP of a known version.
        """
        data = self._bytes()
        end = len(MAGIC)
        finished = False
        for opcode, begin, end in _records(data, len(MAGIC)):
            if opcode == _Op.CHUNK:
                yield from self._chunk(data, begin, end)
            elif opcode == _Op.MESSAGE:
                yield from self._messages(data[begin - _RECORD.size : end])
            else:
                self._other(opcode, data, begin, end)
            finished = opcode == _Op.FOOTER
            if finished:
                break
        if not finished or data[end:] != MAGIC:
            self.problems.append(_torn(len(data), end))

    def _bytes(self) -> bytes:
        try:
            data = read_regular(self.path)
        except OSError as error:
            raise RecordingError(self.path, f"cannot be read ({error.strerror})") from None
        if not data:
            raise RecordingError(self.path, "is empty")
        if data[:5] != MAGIC[:5]:
            raise RecordingError(self.path, "is not an MCAP file")
        if not data.startswith(MAGIC):
            raise RecordingError(self.path, "is torn or of an MCAP version other than 0")
        return data

    def _chunk(self, data: bytes, begin: int, end: int) -> Iterator[Raw]:
        try:
            plain = _decompressed(data, begin, end)
        except (zstandard.ZstdError, ValueError, struct.error, UnicodeDecodeError) as error:
            self.problems.append(f"the chunk at byte {begin - _RECORD.size} is unreadable ({error})")
            return
        yield from self._messages(plain)

    def _messages(self, data: bytes) -> Iterator[Raw]:
        """Messages of a chunk. Unrolled, not `_records`: this loop decides the read rate."""
        unpack, unpack_head, channels = _RECORD.unpack_from, _MESSAGE_HEAD.unpack_from, self._channels
        offset, size, message = 0, len(data), _Op.MESSAGE
        while offset + 9 <= size:
            opcode, length = unpack(data, offset)
            begin = offset + 9
            offset = begin + length
            if offset > size:
                self.problems.append("a record reaches beyond its chunk")
            elif opcode == message and length >= _MESSAGE_HEAD.size:
                number, sequence, log_ns, sent_ns = unpack_head(data, begin)
                channel = channels.get(number)
                if channel is None:
                    self.problems.append(f"a message of a channel that is not described ({number})")
                else:
                    yield channel, sequence, log_ns, sent_ns, data[begin + 22 : offset]
            else:
                self._other(opcode, data, begin, offset)

    def _other(self, opcode: int, data: bytes, begin: int, end: int) -> None:
        fields = _Fields(data[begin:end])
        try:
            match opcode:
                case _Op.SCHEMA:
                    number, name, encoding = fields.u16(), fields.text(), fields.text()
                    self._schemas[number] = (name, encoding, fields.sized())
                case _Op.CHANNEL:
                    number, schema = fields.u16(), fields.u16()
                    topic, encoding = fields.text(), fields.text()
                    described = self._schemas.get(schema, ("", "", b""))
                    self._channels.setdefault(number, Channel(topic, encoding, *described))
                case _Op.ATTACHMENT:
                    fields.skip(16)
                    name, media_type = fields.text(), fields.text()
                    self.attachments[name] = (media_type, fields.sized_u64())
                case _Op.METADATA:
                    name = fields.text()
                    self.metadata[name] = fields.text_map()
        except (struct.error, UnicodeDecodeError):
            self.problems.append(f"the record at byte {begin - _RECORD.size} is unreadable")


class _Fields:
    """Reads the fields of a small record one after the other."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._offset = 0

    def u16(self) -> int:
        return self._number("<H", 2)

    def text(self) -> str:
        return self.sized().decode()

    def sized(self) -> bytes:
        return self._take(self._number("<I", 4))

    def sized_u64(self) -> bytes:
        return self._take(self._number("<Q", 8))

    def text_map(self) -> dict[str, str]:
        end = self._number("<I", 4) + self._offset
        found = {}
        while self._offset < end:
            name = self.text()
            found[name] = self.text()
        return found

    def skip(self, count: int) -> None:
        self._take(count)

    def _number(self, form: str, size: int) -> int:
        number: int = struct.unpack(form, self._take(size))[0]
        return number

    def _take(self, count: int) -> bytes:
        piece = self._data[self._offset : self._offset + count]
        if len(piece) < count:
            raise struct.error("record too short")
        self._offset += count
        return piece


def _records(data: bytes, offset: int) -> Iterator[tuple[int, int, int]]:
    """Opcode, begin and end of every whole record from `offset` on."""
    while offset + _RECORD.size <= len(data):
        opcode, length = _RECORD.unpack_from(data, offset)
        begin = offset + _RECORD.size
        offset = begin + length
        if offset > len(data):
            return
        yield opcode, begin, offset


def _torn(size: int, end: int) -> str:
    """What is missing of a file of `size` bytes whose last whole record ends at byte `end`."""
    unread = f"{size - end} bytes after byte {end} are unreadable" if size > end else f"it stops after byte {end}"
    return f"torn: no end of file; {unread}"


def _decompressed(data: bytes, begin: int, end: int) -> bytes:
    """Content of the chunk record data[begin:end], its checksum verified."""
    _, _, size, crc = _CHUNK_HEAD.unpack_from(data, begin)
    fields = _Fields(data[begin + _CHUNK_HEAD.size : end])
    compression, packed = fields.text(), fields.sized_u64()
    if size > MAX_CHUNK_BYTES:
        raise ValueError(f"{size} bytes, more than {MAX_CHUNK_BYTES}")
    if compression == "zstd" and zstandard.frame_content_size(packed) not in {-1, size}:
        raise ValueError("its sizes disagree")
    if compression == "zstd":
        plain = zstandard.ZstdDecompressor().decompress(packed, max_output_size=size) if size else b""
    elif not compression:
        plain = packed
    else:
        raise ValueError(f"compression {compression!r} is not supported")
    if len(plain) != size or (crc and zlib.crc32(plain) != crc):
        raise ValueError("checksum differs")
    return plain
