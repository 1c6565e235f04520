"""`edc-swarm faults`: the vocabulary of faults."""

from __future__ import annotations

from edc_swarm.mission.fault_help import fault_help
from processes.runtime.console import stdout_console


def faults() -> int:
    """Print every fault: what it does, its syntax, its bounds, an example, and who carries it out."""
    console = stdout_console()
    if console.is_terminal:
        from rich.markdown import Markdown  # noqa: PLC0415  (slow to import)

        console.print(Markdown(fault_help(), code_theme="ansi_dark"))
    else:
        print(fault_help(), end="")
    return 0
