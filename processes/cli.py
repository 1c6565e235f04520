"""`edc-swarm`: the command line. Every command is a file in `processes/commands` and a line here."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.metadata import version

from cyclopts import App, CoercionError, CycloptsError, MissingArgumentError, Parameter, UnknownOptionError
from cyclopts.exceptions import UnknownCommandError

from edc_swarm.errors import SwarmError
from processes.console import BAD_INPUT, complain

app = App(
    name="edc-swarm",
    help="A swarm emulator for centrally planned UAVs: elected head, safe slot QP, Zenoh bus, MCAP record.",
    version=lambda: f"edc-swarm {version('edc-swarm')}",
    default_parameter=Parameter(negative=()),
    help_format="plaintext",
    print_error=False,
    exit_on_error=False,
    result_action="return_value",
    suppress_keyboard_interrupt=False,
)
app.command("processes.commands.run:run")
app.command("processes.commands.sim:sim")
app.command("processes.commands.metrics:metrics")
app.command("processes.commands.check:check")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; exit status 0 fine, 1 something is broken, 2 bad input."""
    try:
        return int(app(arguments) or 0)
    except CycloptsError as error:
        return complain(_in_one_line(error))
    except SwarmError as error:
        return complain(error)
    except BrokenPipeError:
        sys.stderr.close()
        return 1


def _in_one_line(error: CycloptsError) -> str:
    """A parse error as `FIELD = VALUE: must be ALLOWED`."""
    match error:
        case UnknownOptionError():
            return f"{error.token.keyword} = {error.token.value!r}: must be one of the options in --help"
        case _:
            return f"{type(error).__name__}: {error}"


__all__ = ["BAD_INPUT", "CoercionError", "MissingArgumentError", "UnknownCommandError", "app", "main"]

if __name__ == "__main__":
    sys.exit(main())
