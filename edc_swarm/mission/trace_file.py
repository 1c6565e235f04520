"""Trace files of measured networks, read from bytes.

Two kinds are known. A table has a row for each probe, with the time at which it was sent and either the time at which
it was received or its delay; the columns are found by name or number. A list of delivery opportunities has one number
a line, the millisecond in which 1500 bytes can leave a queue: the format of Mahimahi (R. Netravali et al., "Mahimahi:
Accurate Record-and-Replay for HTTP", USENIX ATC 2015; `man mm-link`).
"""

from __future__ import annotations

import codecs
import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from typing import Literal

from edc_swarm.errors import MissionError
from edc_swarm.foreign_text import shown
from edc_swarm.mission.link import Link
from edc_swarm.mission.trace import MAX_PERIOD_US, MAX_ROWS, MAX_US, Rows, TraceKind, median_step_us

MAX_TRACE_BYTES = 64 << 20
US_PER = {"ns": Decimal("0.001"), "us": Decimal(1), "ms": Decimal(1000), "s": Decimal(1_000_000)}
MOST = Decimal("1e21")
"""Numbers from here on are no times of any unit."""
_BOMS = {codecs.BOM_UTF8: "utf-8", codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}

Line = tuple[int, list[str]]
"""Number of a line in its file, and its cells."""


def read_trace(data: bytes, link: Link, where: str) -> tuple[TraceKind, Rows]:
    """Return kind and rows of the trace file with the content `data`, read as `link`, the table at `where`, says.

    Raises
    ------
    MissionError
        With the file, the line and what is allowed.
    """
    file = _File(link, where)
    lines = list(_cells(_text(data, file), file))
    if not lines:
        raise file.refusal("empty", "a file with a row for each probe")
    if not link.trace_columns and all(len(cells) == 1 for _, cells in lines):
        return "opportunities", _opportunities(lines, file)
    return "delays", _delays(lines, file)


@dataclass(frozen=True, slots=True)
class _File:
    """A trace file and the link that says how to read it."""

    link: Link
    where: str

    def refusal(self, found: str, allowed: str) -> MissionError:
        """Return the error about what is `found` in the file."""
        return MissionError(f"{self.where}.trace", f"{self.link.trace} ({found})", allowed)

    def number(self, line: Line, place: int) -> Decimal:
        """Return the number in a cell."""
        number, cells = line
        if place >= len(cells):
            raise self.refusal(
                f"line {number}", f"a table whose rows have {place + 1} columns or more, not {len(cells)}"
            )
        value = _number(cells[place])
        if value is None:
            allowed = "a table of finite numbers; lost probes are left out"
            found = shown(cells[place], 40) or "nothing"
            raise self.refusal(f"{found} in column {place + 1} of line {number}", allowed)
        return value

    def columns(self) -> tuple[str | int, str | int]:
        """Return the columns of the time of sending and of the other quantity."""
        columns = self.link.trace_columns
        if set(columns) not in ({"sent", "received"}, {"sent", "delay"}):
            allowed = '{ sent = "...", received = "..." } or { sent = "...", delay = "..." }, by name or number'
            raise MissionError(f"{self.where}.trace_columns", dict(columns) or "nothing", allowed)
        return columns["sent"], columns["received"] if "received" in columns else columns["delay"]

    def place(self, column: str | int, header: Sequence[str]) -> int:
        """Return the index of a column."""
        if isinstance(column, int) and 1 <= column <= len(header):
            return column - 1
        if isinstance(column, str) and header.count(column) == 1:
            return header.index(column)
        names = ", ".join(shown(name, 40) for name in header[:20])
        allowed = f"the name or number of one of the {len(header)} columns of {self.link.trace}: {names}"
        if len(header) == 1:
            allowed = f"columns of {self.link.trace}, separated by commas, semicolons, tabs or spaces, not {names}"
        raise MissionError(f"{self.where}.trace_columns", column, allowed)


def _text(data: bytes, file: _File) -> str:
    """Return the text of the file: UTF-8, or UTF-16 with its mark, or else Latin-1, which matters to names alone."""
    encodings = ["utf-8", "latin-1"]
    for mark, encoding in _BOMS.items():
        if data.startswith(mark):
            data, encodings = data.removeprefix(mark), [encoding]
    for encoding in encodings:
        try:
            text = data.decode(encoding)
        except UnicodeDecodeError:
            continue
        if "\0" not in text:
            return text
    raise file.refusal("a binary file", "a text file with a row for each probe")


def _cells(text: str, file: _File) -> Iterator[Line]:
    """Yield the lines that are neither blank nor comments; the first one decides the separator of all."""
    separator, found = "", 0
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        found += 1
        if found == 1:
            separator = next((mark for mark in "\t;," if mark in line.strip()), "")
        if found > MAX_ROWS + 1:
            raise file.refusal(f"more than {MAX_ROWS} rows", f"a file of at most {MAX_ROWS} rows")
        yield number, _split(line.strip(), separator)


def _split(line: str, separator: str) -> list[str]:
    if not separator:
        return line.split()
    quoting: Literal[0, 3] = csv.QUOTE_NONE if line.count('"') % 2 else csv.QUOTE_MINIMAL
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, quoting=quoting))]


def _delays(lines: Sequence[Line], file: _File) -> Rows:
    """Return the rows of a table."""
    link, chosen = file.link, file.columns()
    header = lines[0][1]
    sent, other = (file.place(column, header) for column in chosen)
    headless = all(isinstance(column, int) for column in chosen) and _number(header[sent]) is not None
    us_per, limit_us = US_PER[link.trace_unit], MAX_US
    sent_us, delay_us = list[int](), list[int]()
    for line in lines if headless else lines[1:]:
        at_us, last_us = (_us(file.number(line, place), us_per) for place in (sent, other))
        last_us -= at_us if "received" in link.trace_columns else 0
        step_us = at_us - sent_us[-1] if sent_us else 0
        if step_us < 0:
            raise file.refusal(f"line {line[0]} was sent before the line above", "a table in the order of sending")
        if not 0 <= last_us <= limit_us or step_us > limit_us:
            found = f"line {line[0]}: {step_us / 1000:g} ms after the line above, delay {last_us / 1000:g} ms"
            raise file.refusal(found, f"a table with times between rows, and delays, from 0 to {limit_us // 1000} ms")
        sent_us.append(at_us)
        delay_us.append(last_us // 2 if link.round_trip else last_us)
    if len(sent_us) < 2:
        raise file.refusal(f"{len(sent_us)} rows", "a table of at least 2 rows")
    since_us = [when_us - sent_us[0] for when_us in sent_us]
    return Rows(since_us, delay_us, since_us[-1] + median_step_us(since_us))


def _us(value: Decimal, us_per: Decimal) -> int:
    return int((value * us_per).to_integral_value())


def _number(text: str) -> Decimal | None:
    """Return a number with a decimal point or, where the separator leaves it, a decimal comma; None for no number."""
    try:
        value = Decimal(text.replace(",", ".", 1))
    except InvalidOperation:
        return None
    return value if value.is_finite() and abs(value) < MOST else None


def _opportunities(lines: Sequence[Line], file: _File) -> Rows:
    """Return the rows of a list of delivery opportunities, which begins again at its last millisecond."""
    at_ms = list[int]()
    for line in lines:
        value = file.number(line, 0)
        if value < 0 or value != value.to_integral_value():
            raise file.refusal(f"{value} in line {line[0]}", "a list of whole milliseconds, or trace_columns are given")
        at_ms.append(int(value))
        if len(at_ms) > 1 and not 0 <= at_ms[-1] - at_ms[-2] <= MAX_US // 1000:
            allowed = f"a list of milliseconds in order, at most {MAX_US // 1000} apart"
            raise file.refusal(f"line {line[0]}", allowed)
    if not 0 < at_ms[-1] <= MAX_PERIOD_US // 1000:
        raise file.refusal(f"last line {at_ms[-1]}", f"a list that ends between 1 and {MAX_PERIOD_US // 1000} ms")
    return Rows([1000 * (when_ms - at_ms[0]) for when_ms in at_ms], [0] * len(at_ms), 1000 * at_ms[-1])
