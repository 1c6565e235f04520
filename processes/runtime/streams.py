"""Standard input, output and error of a command, whatever the caller has made of them."""

from __future__ import annotations

import io
import os
import sys
from contextlib import suppress

from edc_swarm.errors import SwarmError


class UnreadError(Exception):
    """Whoever was to read the results has closed the pipe: nobody is there to be told."""


class Results(io.TextIOWrapper):
    """Standard output. What cannot be written is an error of ours; what its encoding lacks is written as an escape."""

    def write(self, text: str) -> int:
        """Write `text`; raises `SwarmError`, or `UnreadError` for a pipe that nobody reads any more."""
        try:
            return super().write(text)
        except OSError as error:
            raise _unwritten(error) from None

    def flush(self) -> None:
        """Write what is still held back; raises as `write` does."""
        try:
            super().flush()
        except OSError as error:
            raise _unwritten(error) from None


class Notes(io.TextIOWrapper):
    """Standard error. A mission does not end because nobody can be told of it."""

    def write(self, text: str) -> int:
        """Write `text` if that can be."""
        with suppress(OSError):
            return super().write(text)
        return len(text)

    def flush(self) -> None:
        """Write what is still held back if that can be."""
        with suppress(OSError):
            super().flush()


def prepare_streams() -> None:
    """Put streams of our own in place of Python's.

    A stream that the caller has closed is opened first: else the next file to be opened, a recording perhaps, would
    take its number, and with it all that is printed. Output that was closed is opened so that writing fails.
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


def let_go_of_results() -> None:
    """Drop what standard output could not take, so that the interpreter does not try again at its end."""
    try:
        sys.stdout.flush()
    except (SwarmError, UnreadError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.close(nowhere)


def _wrapped(kind: type[io.TextIOWrapper], number: int, given: object) -> io.TextIOWrapper:
    """A stream on descriptor `number`, encoded as the one that Python has made for it, if it has made one."""
    encoding = given.encoding if isinstance(given, io.TextIOWrapper) else "utf-8"
    raw = io.FileIO(number, "w", closefd=False)
    return kind(io.BufferedWriter(raw), encoding, "backslashreplace", line_buffering=number == 2 or raw.isatty())


def _unwritten(error: OSError) -> Exception:
    if isinstance(error, BrokenPipeError):
        return UnreadError()
    why = (error.strerror or str(error)).lower()
    return SwarmError(f"standard output cannot be written ({why})")
