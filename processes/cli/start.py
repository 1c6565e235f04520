"""The entry point `edc-swarm`: it loads the command line, which takes a while on a busy machine, and runs it."""

from __future__ import annotations

import sys


def main() -> int:
    """Run one command and return its exit status; Ctrl-C while the command line loads ends in one line, too."""
    try:
        from processes.cli.main import main as run_command  # noqa: PLC0415 - nothing is loaded before the `try`
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 1
    return run_command()
