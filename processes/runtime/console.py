"""Output of the command: results on standard output, all else on standard error; and the exit statuses."""

from __future__ import annotations

import sys
from collections.abc import Callable
from textwrap import fill
from typing import NoReturn

import msgspec
from rich.console import Console

from edc_swarm.errors import RecordingError, SwarmError
from edc_swarm.foreign_text import shown_lines

FAILED = 1
"""Exit status: a guarantee is broken, a UAV is not at its target, or the mission failed."""
BAD_INPUT = 2
"""Exit status: an option, a file or the environment is not acceptable."""
NOT_JUDGED = 3
"""Exit status: nothing is broken, but a guarantee could not be judged for lack of evidence."""

UNREAD = 128 + 13
"""Exit status: the reader closed the pipe of standard output (a shell's status for a process ended by SIGPIPE)."""

MAX_NAMES = 10
"""Most names of UAVs or missions in a note."""


def note(text: str) -> None:
    """Print `text` for the user on standard error."""
    print(shown_lines(text), file=sys.stderr, flush=True)


def complain(error: SwarmError | str) -> int:
    """Print one line about bad input, and return the exit status."""
    text = str(error)
    if isinstance(error, RecordingError):
        text = f"recording = {str(error.path)!r}: must be a readable recording; it {error.reason}"
    note(f"error: {' '.join(text.split())}")
    return BAD_INPUT


def run_main(main: Callable[[], int]) -> NoReturn:
    """Run the main function of a process and end with its status, or with one line about what is wrong."""
    try:
        sys.exit(main())
    except SwarmError as error:
        sys.exit(complain(error))


def print_json(value: object) -> None:
    """Print `value` as JSON on standard output."""
    sys.stdout.write(msgspec.json.format(msgspec.json.encode(value), indent=2).decode() + "\n")


def stdout_console() -> Console:
    """Return a console on standard output that wraps lines between words on a terminal, and nowhere else."""
    return Console(highlight=False, soft_wrap=not sys.stdout.isatty())


def print_line(line: str, console: Console) -> None:
    """Print a line; where the console wraps, its further lines are indented and cut only between words."""
    if not console.soft_wrap:
        indent = " " * (len(line) - len(line.lstrip()) + 4)
        line = fill(line, console.width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)
    print(line)
