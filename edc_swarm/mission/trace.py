"""A measured network: table `[[trace]]` of a mission, which is what a link plays back.

The mission carries the rows themselves, so that every UAV process, a second simulation and a recording have them
without the file. A row takes 8 bytes before compression: the first 4 are the time since the row before, the others the
delay, both in whole microseconds. The bytes are sorted by their place in the number, which compresses better.
"""

from __future__ import annotations

import base64
import binascii
import sys
import zlib
from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate, pairwise
from typing import Annotated, Literal

from msgspec import Meta, Struct

from edc_swarm.errors import MissionError

MAX_TRACES = 100
MAX_ROWS = 100_000
MAX_PACKED = 512 << 10
"""Most characters of the rows of all traces, so that the largest mission still fits into one message."""
MAX_US = 2_000_000_000
"""Longest time between two rows, and longest delay, in microseconds: a third of an hour fits into 4 bytes."""
MAX_PERIOD_US = MAX_ROWS * MAX_US
MTU_BYTES = 1500
"""Bytes that leave the queue at one delivery opportunity."""
GAP_MEDIANS = 4
"""Median intervals between two rows beyond which there is a gap, unless the link states `trace_gap_ms`."""
MAX_KEPT = 8
"""Most traces whose rows are kept unpacked."""
_BYTES = 4

TraceKind = Literal["delays", "opportunities"]
TraceName = Annotated[str, Meta(min_length=1, max_length=200)]


class Trace(Struct, frozen=True, kw_only=True):
    """The rows of a trace file, as the links that name it play them back.

    The program writes these tables when it reads a mission file; nobody writes them by hand.

    Source: this project.
    """

    name: TraceName
    """Name by which links refer to the trace: the name of its file."""
    kind: TraceKind = "delays"
    """Content of the rows: one-way `delays`, or `opportunities` to deliver 1500 bytes."""
    rows: Annotated[int, Meta(ge=1, le=MAX_ROWS)] = 1
    """Number of rows."""
    period_us: Annotated[int, Meta(ge=1, le=MAX_PERIOD_US)] = 1
    """Microseconds after which the rows begin again."""
    sha256: Annotated[str, Meta(pattern=r"^([0-9a-f]{64})?$(?!\n)")] = ""
    """SHA-256 of the file.

    Default: empty, for a trace without a file.
    """
    packed: Annotated[str, Meta(max_length=MAX_PACKED)] = ""
    """Rows, compressed (zlib) and in base64.

    Default: none, which is no trace.
    """


@dataclass(frozen=True, slots=True)
class Rows:
    """The rows of a trace.

    Attributes
    ----------
    at_us
        (N,) times since the first row, in microseconds, in order.
    delay_us
        (N,) delays in microseconds; all 0 for opportunities.
    period_us
        Time after which the rows begin again.
    """

    at_us: Sequence[int]
    delay_us: Sequence[int]
    period_us: int


def median_step_us(at_us: Sequence[int]) -> int:
    """Return the median time between two rows, at least a microsecond."""
    steps_us = sorted(later - earlier for earlier, later in pairwise(at_us))
    return max(1, steps_us[len(steps_us) // 2]) if steps_us else 1


def pack(rows: Rows) -> str:
    """Return the rows as text, for `Trace.packed`."""
    steps_us = [0, *(later - earlier for earlier, later in pairwise(rows.at_us))]
    raw = b"".join(_planes(column) for column in (steps_us, rows.delay_us))
    return base64.b64encode(zlib.compress(raw, 9)).decode()


@lru_cache(maxsize=MAX_KEPT)
def unpack(trace: Trace) -> Rows:
    """Return the rows of a trace.

    Raises
    ------
    MissionError
        The text does not hold `rows` rows within the limits.
    """
    size = trace.rows * _BYTES
    try:
        inflater = zlib.decompressobj()
        raw = inflater.decompress(base64.b64decode(trace.packed, validate=True), 2 * size + 1)
        if len(raw) != 2 * size or not inflater.eof:
            raise _unsound(trace)
    except (zlib.error, binascii.Error, ValueError):
        raise _unsound(trace) from None
    steps_us, delay_us = _column(raw[:size]), _column(raw[size:])
    if steps_us[0] or max(steps_us) > MAX_US or max(delay_us) > MAX_US or sum(steps_us) > trace.period_us:
        raise _unsound(trace)
    return Rows(list(accumulate(steps_us)), delay_us.tolist(), trace.period_us)


def check_traces(traces: Sequence[Trace]) -> None:
    """Raise `MissionError` unless the names of the traces differ and their rows fit into a message and unpack."""
    seen: set[str] = set()
    for index, trace in enumerate(traces):
        if trace.name in seen:
            raise MissionError(f"trace[{index}].name", trace.name, "a name that no other trace has")
        seen.add(trace.name)
        unpack(trace)
    size = sum(len(trace.packed) for trace in traces)
    if size > MAX_PACKED:
        allowed = f"few enough rows for one message: {MAX_PACKED} characters when compressed, not {size}"
        raise MissionError("trace", f"{sum(trace.rows for trace in traces)} rows", allowed)


def _unsound(trace: Trace) -> MissionError:
    return MissionError("trace.packed", trace.name, f"{trace.rows} rows, as the program packs them from a file")


def _planes(column: Sequence[int]) -> bytes:
    """Return the numbers as bytes: all lowest bytes first, all highest last."""
    raw = b"".join(value.to_bytes(_BYTES, "little") for value in column)
    return b"".join(raw[place::_BYTES] for place in range(_BYTES))


def _column(planes: bytes) -> array[int]:
    count = len(planes) // _BYTES
    raw = bytearray(len(planes))
    for place in range(_BYTES):
        raw[place::_BYTES] = planes[place * count : (place + 1) * count]
    column = array("I")
    assert column.itemsize == _BYTES
    column.frombytes(raw)
    if sys.byteorder == "big":
        column.byteswap()
    return column
