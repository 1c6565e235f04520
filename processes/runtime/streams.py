"""Standard input, output and error of a command, usable even if the caller closed or redirected them."""

from __future__ import annotations

import io
import os
import sys
from contextlib import suppress

from edc_swarm.errors import SwarmError


class UnreadError(Exception):
    """The reader of the results has closed the pipe, so no error text can reach it."""


class Results(io.TextIOWrapper):
    """Standard output. A failed write raises an error of ours; an escape replaces a character its encoding lacks."""

    def write(self, text: str) -> int:
        """Write `text`; raise `SwarmError` if that fails, or `UnreadError` if the reader has closed the pipe."""
        try:
            return super().write(text)
        except OSError as error:
            raise _unwritten(error) from None

    def flush(self) -> None:
        """Write the buffered text; raise as `write` does."""
        try:
            super().flush()
        except OSError as error:
            raise _unwritten(error) from None


class Notes(io.TextIOWrapper):
    """Standard error. It ignores failed writes: a mission must not end because a note cannot be printed."""

    def write(self, text: str) -> int:
        """Write `text` if possible."""
        with suppress(OSError):
            return super().write(text)
        return len(text)

    def flush(self) -> None:
        """Write the buffered text if possible."""
        with suppress(OSError):
            super().flush()


def prepare_streams() -> None:
    """Replace Python's standard streams by `Results` and `Notes`.

    The function first opens the streams that the caller closed. Otherwise the next opened file, perhaps a recording,
    would get the number of a closed stream and receive the printed text. It opens a closed output read-only, so that
    writing fails.
    """
    for number, mode in enumerate((os.O_RDONLY, os.O_RDONLY, os.O_WRONLY)):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, mode)
    if sys.stdout is sys.__stdout__:
        sys.stdout = _wrapped(Results, 1, sys.stdout)
    if sys.stderr is sys.__stderr__:
        sys.stderr = _wrapped(Notes, 2, sys.stderr)


def discard_unwritten_results() -> None:
    """Drop the results that standard output did not take, so that the interpreter does not write them at its end."""
    try:
        sys.stdout.flush()
    except (SwarmError, UnreadError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.close(nowhere)


def _wrapped(kind: type[io.TextIOWrapper], number: int, given: object) -> io.TextIOWrapper:
    """Return a stream on descriptor `number`, with the encoding of Python's own stream `given`, if there is one."""
    encoding = given.encoding if isinstance(given, io.TextIOWrapper) else "utf-8"
    raw = io.FileIO(number, "w", closefd=False)
    return kind(io.BufferedWriter(raw), encoding, "backslashreplace", line_buffering=number == 2 or raw.isatty())


def _unwritten(error: OSError) -> Exception:
    if isinstance(error, BrokenPipeError):
        return UnreadError()
    why = (error.strerror or str(error)).lower()
    return SwarmError(f"standard output cannot be written ({why})")
