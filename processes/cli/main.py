"""The command line `edc-swarm`. Every command is a file in `processes/cli/commands` and a line here."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import suppress
from difflib import get_close_matches
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from cyclopts import App, CoercionError, CycloptsError, MissingArgumentError, Parameter, Token, UnknownOptionError
from cyclopts.exceptions import RepeatArgumentError, UnknownCommandError, UnusedCliTokensError
from rich.console import Console

from edc_swarm.errors import InputError, SwarmError
from processes.bus.abort_notice import send_abort_notice
from processes.cli.compiled_code import choose_code_folder
from processes.runtime.children import PartEndedError
from processes.runtime.console import BAD_INPUT, FAILED, UNREAD, complain, note
from processes.runtime.output import unusable
from processes.runtime.streams import UnreadError, discard_unwritten_results, prepare_streams

app = App(
    name="edc-swarm",
    help=(
        "A swarm emulator: UAVs elect a head, which plans steps that keep all UAVs apart. They talk over Zenoh. Every "
        "message is recorded to an MCAP file.\n\n"
        "To begin: `edc-swarm run` flies ten UAVs, `edc-swarm report FILE.mcap` shows the flight in a browser.\n\n"
        "Exit status 0: fine. 1: a guarantee is broken, a UAV is not at its target, or the mission failed. "
        "2: bad input. 3: nothing is broken, but a guarantee could not be judged."
    ),
    version=lambda: f"edc-swarm {version('edc-swarm')}",
    default_parameter=Parameter(negative=(), show_default=False),
    help_format="plaintext",
    print_error=False,
    exit_on_error=False,
    result_action="return_value",
    suppress_keyboard_interrupt=False,
)
app.command("processes.cli.commands.run:run", help="Fly a mission: real processes over Zenoh, recorded.")
app.command("processes.cli.commands.join:join", help="Fly UAVs of a mission that another machine operates.")
app.command("processes.cli.commands.sim:sim", help="Simulate the same mission in one process, in virtual time.")
app.command("processes.cli.commands.metrics:metrics", help="Print every metric of a recording.")
app.command(
    "processes.cli.commands.check:check", help="Check the guarantees of a recording; status 1: broken, 3: not judged."
)
app.command("processes.cli.commands.events:events", help="Print what happened in a recorded mission, and why.")
app.command("processes.cli.commands.faults:faults", help="Print every fault that a mission can suffer, with examples.")
app.command("processes.cli.commands.fuzz:fuzz", help="Search random fault schedules for a broken guarantee.")
app.command("processes.cli.commands.figures:figures", help="Make the paper's figures and the energy bill.")
app.command("processes.cli.commands.latency:latency", help="Fly a grid of delays, jitters and losses.")
app.command("processes.cli.commands.replay:replay", help="Publish a recording on a bus, or plan it again and compare.")
app.command(
    "processes.cli.commands.recover:recover", help="Make a complete recording of a torn one, which ends in the middle."
)
app.command("processes.cli.commands.merge:merge", help="Make one recording of those that several recorders wrote.")
app.command("processes.cli.commands.visualise:visualise", help="Add what Foxglove draws to a recording.")
app.command("processes.cli.commands.certs:certs", help="Make the certificates of a secured swarm.")
app.command(
    "processes.cli.commands.import_files:import_files",
    name="import",
    help="Make one mission file from plans, way points, fences and maps of other programs.",
)
app.command("processes.cli.commands.export:export", help="Write the flown tracks as GeoJSON, KML or CSV.")
app.command("processes.cli.commands.report:report", help="Make a self-contained page of a recording.")


LEAST_HELP_COLUMNS = 40
PLANNING = frozenset({"run", "join", "sim", "fuzz", "figures", "latency", "replay"})
"""Commands that plan, in this process or in others that they start."""
PLANNING_AGAIN = frozenset({"check", "report"})
"""Commands that simulate a recorded mission a second time."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit status.

    0: fine; 1: a guarantee is broken, a UAV is not home, or the mission failed; 2: bad input; 3: nothing is broken,
    but something could not be judged; 141: the reader of standard output has closed it.
    """
    if arguments is None:
        prepare_streams()
        arguments = sys.argv[1:]
    status = BAD_INPUT
    try:
        status = _run(arguments)
    finally:
        if status == BAD_INPUT:
            with suppress(KeyboardInterrupt):
                send_abort_notice(arguments)
    return status


def _run(arguments: Sequence[str]) -> int:
    """Run one command; print an error in one line."""
    try:
        status = _command(arguments)
        sys.stdout.flush()
    except CycloptsError as error:
        status = complain(_in_one_line(error))
    except PartEndedError as error:
        complain(error)
        status = FAILED
    except SwarmError as error:
        status = complain(error)
    except UnreadError:
        status = UNREAD
    except OSError as error:
        status = complain(unusable(error))
    except UnicodeEncodeError as error:
        status = complain(InputError("text", error.object, "in UTF-8"))
    except KeyboardInterrupt:
        note("interrupted")
        status = FAILED
    discard_unwritten_results()
    return status


def _command(arguments: Sequence[str]) -> int:
    plans = bool(arguments) and arguments[0] in PLANNING
    try:
        here = str(Path.cwd())
    except FileNotFoundError:
        if plans:
            raise SwarmError("the working folder was removed: change to one that exists") from None
    else:
        if here not in sys.path:
            sys.path.append(here)  # A user's planner may lie beside the mission.
    if plans or (arguments and arguments[0] in PLANNING_AGAIN):
        choose_code_folder()
    return int(app(arguments, console=_help_console()) or 0)


def _help_console() -> Console:
    """Return the console for `--help`, with a least width: a layout narrower than a word takes minutes."""
    console = Console()
    console.width = max(console.width, LEAST_HELP_COLUMNS)
    return console


def _in_one_line(error: CycloptsError) -> str:
    """Return a parse error as `FIELD = VALUE: must be ALLOWED`."""
    unused = error.unused_tokens or [""]
    match error:
        case CoercionError(token=Token() as token):
            said = (token.keyword or _name(error), token.value, _kind(error.target_type))
        case MissingArgumentError():
            said = (error.keyword or _name(error), "", "given")
        case UnknownOptionError():
            typed = error.token.keyword or error.token.value
            options = [name for argument in error.argument_collection for name in argument.names]
            said = ("option", typed, f"one of those in --help{_meant(typed, options, alike=0.7)}")
        case UnknownCommandError():
            said = ("command", unused[0], f"one of {', '.join(_commands())}{_meant(unused[0], _commands())}")
        case UnusedCliTokensError():
            said = ("arguments", " ".join(unused), "left out")
        case RepeatArgumentError():
            said = (error.token.keyword or _name(error), error.token.value, "given once")
        case _:
            return str(error)
    field, value, allowed = said
    return f"{field} = {value!r}: must be {allowed}"


def _name(error: CycloptsError) -> str:
    return error.argument.name if error.argument is not None else "argument"


def _kind(target: Any) -> str:
    """Return the type of an option in words; `target` may be a union with None."""
    kinds = (target, *get_args(target))
    choices = [choice for kind in kinds if get_origin(kind) is Literal for choice in get_args(kind)]
    if choices:
        return f"one of {', '.join(choices)}"
    return next((_KINDS[kind] for kind in kinds if kind in _KINDS), f"of type {target}")


_KINDS = {int: "a whole number", float: "a number"}


def _meant(word: str, known: Sequence[str], alike: float = 0.6) -> str:
    """Return a question after the command or option of `known` that is most like `word`, "" if none is `alike`."""
    nearest = get_close_matches(word, known, n=1, cutoff=alike)
    return f" (do you mean {nearest[0]}?)" if nearest else ""


def _commands() -> list[str]:
    return [name for name in app if not name.startswith("-")]


if __name__ == "__main__":
    sys.exit(main())
