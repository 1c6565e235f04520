"""A fast reader of MCAP files.

The `mcap` package's reader makes several Python objects per message, which is too slow for the million messages
that a metric may need. So this module unpacks the records itself (format: https://mcap.dev/spec), in the order of
the file. It delivers every complete record before the first torn one. It holds one record in memory at a time,
never the whole file. It needs neither summary nor index; chunks and checksums are optional.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import lz4.frame
import zstandard

from edc_swarm.errors import EarlyEndError, RecordingError
from edc_swarm.files import open_regular

MAGIC = b"\x89MCAP0\r\n"
_RECORD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_CHUNK_HEAD = struct.Struct("<QQQI")
CODECS = ("", "zstd", "lz4")
"""Compressions of chunks that MCAP defines."""
MAX_CHUNK_BYTES = 1 << 28
"""Largest size of a decompressed chunk, and of any other record."""


class _Op:
    """Record types that this module reads; it skips all others."""

    FOOTER = 2
    SCHEMA = 3
    CHANNEL = 4
    MESSAGE = 5
    CHUNK = 6
    ATTACHMENT = 9
    METADATA = 12


_READ = frozenset({_Op.FOOTER, _Op.SCHEMA, _Op.CHANNEL, _Op.MESSAGE, _Op.CHUNK, _Op.ATTACHMENT, _Op.METADATA})


@dataclass(frozen=True, slots=True)
class Channel:
    """A topic with the encoding and the schema of its payloads."""

    topic: str
    encoding: str
    schema_name: str = ""
    schema_encoding: str = ""
    schema_data: bytes = b""


Raw = tuple[Channel, int, int, int, bytes]
"""Channel, sequence, log time and publish time in nanoseconds, payload."""


@dataclass(slots=True)
class McapFile:
    """One MCAP file. Exhaust `messages()` first: it fills the other attributes as it reads.

    Attributes
    ----------
    problems
        One line for each part that could not be read; empty for an intact file.
    """

    path: Path
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    attachments: dict[str, tuple[str, bytes]] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    _schemas: dict[int, tuple[str, str, bytes]] = field(default_factory=dict)
    _channels: dict[int, Channel] = field(default_factory=dict)

    @property
    def channels(self) -> set[Channel]:
        """Topics that the file describes, each with its schema."""
        return set(self._channels.values())

    def messages(self) -> Iterator[Raw]:
        """Yield every message in the order of the file.

        Raises
        ------
        RecordingError
            The file cannot be opened, is empty, is not MCAP of a known version, or has a chunk of an unknown codec.
        """
        try:
            with open_regular(self.path) as stream:
                self._check_magic(stream)
                yield from self._walked(stream)
        except OSError as error:
            raise RecordingError(self.path, f"cannot be read: {error.strerror}") from None

    def _walked(self, stream: BinaryIO) -> Iterator[Raw]:
        """Yield the messages of all complete records up to the footer."""
        size = os.fstat(stream.fileno()).st_size
        end = len(MAGIC)
        finished = False
        while not finished and end + _RECORD.size <= size:
            opcode, length = _RECORD.unpack(stream.read(_RECORD.size))
            begin = end + _RECORD.size
            if begin + length > size:
                break
            end = begin + length
            finished = opcode == _Op.FOOTER
            if opcode not in _READ:
                stream.seek(end)
            elif length > MAX_CHUNK_BYTES:
                self.problems.append(
                    f"the record at byte {begin - _RECORD.size} has {length} bytes, too many to be read"
                )
                stream.seek(end)
            else:
                yield from self._record(opcode, stream.read(length), begin - _RECORD.size)
        if not finished or stream.read() != MAGIC:
            self.problems.append(_torn(size, end))

    def _record(self, opcode: int, data: bytes, at: int) -> Iterator[Raw]:
        """Yield the messages of the record with content `data` that starts at byte `at` of the file."""
        if opcode == _Op.CHUNK:
            yield from self._chunk(data, at)
        elif opcode == _Op.MESSAGE:
            yield from self._messages(_RECORD.pack(opcode, len(data)) + data)
        else:
            self._other(opcode, data, at)

    def _check_magic(self, stream: BinaryIO) -> None:
        start = stream.read(len(MAGIC))
        if not start:
            raise EarlyEndError(self.path, "is empty")
        if start[:5] != MAGIC[:5]:
            raise RecordingError(self.path, "is not an MCAP file")
        if MAGIC.startswith(start) and start != MAGIC:
            raise EarlyEndError(self.path, f"is torn after byte {len(start)}")
        if start != MAGIC:
            raise RecordingError(self.path, "is torn or of an MCAP version other than 0")

    def _chunk(self, data: bytes, at: int) -> Iterator[Raw]:
        try:
            plain = _decompressed(data)
        except _UnknownCodecError as error:
            known = ", ".join(map(repr, CODECS))
            raise RecordingError(self.path, f"is compressed with {str(error)[:60]!r}; known are {known}") from None
        except (zstandard.ZstdError, RuntimeError, ValueError, struct.error, EOFError) as error:
            self.problems.append(f"the chunk at byte {at} is unreadable ({error})")
            return
        yield from self._messages(plain)

    def _messages(self, data: bytes) -> Iterator[Raw]:
        """Yield the messages of a decompressed chunk. The loop is unrolled, because it decides the read rate."""
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
                self._other(opcode, data[begin:offset], begin - _RECORD.size)

    def _other(self, opcode: int, data: bytes, at: int) -> None:
        fields = _Fields(data)
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
            self.problems.append(f"the record at byte {at} is unreadable")


class _Fields:
    """A cursor over the fields of a small record."""

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


def _torn(size: int, end: int) -> str:
    """Return one line on what is missing from a file of `size` bytes whose last complete record ends at byte `end`."""
    unread = f"{size - end} bytes after byte {end} are unreadable" if size > end else f"it stops after byte {end}"
    return f"torn: no end of file; {unread}"


class _UnknownCodecError(Exception):
    """A chunk is compressed with a codec that MCAP does not define."""


def _decompressed(data: bytes) -> bytes:
    """Return the content of the chunk record `data` after its checksum has been verified."""
    _, _, size, crc = _CHUNK_HEAD.unpack_from(data)
    fields = _Fields(data[_CHUNK_HEAD.size :])
    compression, packed = fields.text(), fields.sized_u64()
    if compression not in CODECS:
        raise _UnknownCodecError(compression)
    if size > MAX_CHUNK_BYTES:
        raise ValueError(f"{size} bytes, more than {MAX_CHUNK_BYTES}")
    if compression == "zstd" and zstandard.frame_content_size(packed) not in {-1, size}:
        raise ValueError("its sizes disagree")
    if not compression:
        plain = packed
    elif not size:
        plain = b""
    elif compression == "zstd":
        plain = zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)
    else:
        plain = lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size)
    if len(plain) != size or (crc and zlib.crc32(plain) != crc):
        raise ValueError("checksum differs")
    return plain
