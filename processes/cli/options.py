"""Options of `run` and `sim` about the mission, made from the declarations of its fields."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, make_dataclass, replace
from pathlib import Path
from typing import Annotated, Any, get_origin, get_type_hints

from cyclopts import Parameter
from msgspec import Struct

from edc_swarm.extras import check_planner_extra
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.declarations import declarations, option_names
from edc_swarm.mission.link import Link
from edc_swarm.mission.reference import TABLES
from edc_swarm.mission.stated import (
    FIELDS,
    attribute_of,
    fields_by_option,
    named_as_options,
    option_attributes,
    with_stated,
)
from edc_swarm.mission.validation import load_mission
from edc_swarm.simulation.take_off import ready_mission, warnings_of
from processes.cli.whole_number import WholeNumber
from processes.runtime.console import note
from processes.runtime.voice import Voice

MISSION_HELP = "Mission file (TOML); without one, a random mission."


def swept(name: str) -> Parameter:
    """Return the help of an option that takes several values of the field `name` of a mission or a link."""
    field = {**declarations(Link), **declarations(Mission)}[name]
    unit = f", in {field.unit[1]}" if field.unit[1] else ""
    return Parameter(help=f"{field.summary}{unit}: numbers separated by commas.")


def _options_of(kind: type[Struct], more: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Yield name, type and default of the option for each field that has one; `more` ends each help."""
    declared, hints = declarations(kind), get_type_hints(kind, include_extras=True)
    for name, option in option_names(kind).items():
        plain = hints[name].__origin__
        help_text = f"{declared[name].help}{more}"
        if get_origin(plain) is list:
            parameter = Parameter(help=f"{help_text} May be given more than once.")
            yield attribute_of(option), Annotated[list[str], parameter], field(default_factory=list)
        else:
            taken = WholeNumber if plain is int else plain
            yield attribute_of(option), Annotated[taken | None, Parameter(help=help_text)], None


_FieldOptions: Any = make_dataclass(
    "_FieldOptions",
    [
        *_options_of(Mission),
        *(option for kind in TABLES.values() for option in _options_of(kind)),
        *_options_of(Link, " For every link."),
    ],
    frozen=True,
    kw_only=True,
)
"""One attribute for each field of a mission, a table of it or a link that declares an option."""


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class MissionOptions(_FieldOptions):  # type: ignore[misc]  # The declarations decide its attributes.
    """Options about the mission and its recording; without an option the value of the file holds.

    Parameters
    ----------
    fault_help
        Print the fault vocabulary and exit.
    out
        The recording to write (a new name in recordings/).
    no_viz
        Leave out of the recording what Foxglove and Lichtblick show.
    json
        Print the metrics as JSON alone on standard output.
    force
        Overwrite an existing recording.
    quiet
        Say nothing on standard error but warnings and errors.
    verbose
        Tell the story of the mission with all details, on a terminal too.
    """

    fault_help: bool = False
    out: Path | None = None
    no_viz: bool = False
    json: bool = False
    force: bool = False
    quiet: bool = False
    verbose: bool = False

    @property
    def voice(self) -> Voice:
        """The amount that the command says while it works; with --json nothing, unless --verbose asks for it."""
        return Voice(quiet=self.quiet or (self.json and not self.verbose), verbose=self.verbose)

    def mission(self, file: Path | None) -> Mission:
        """Return the mission: the file, with options in place of its fields, completed by draws and derived values.

        Raises
        ------
        MissionError
            With the field, the value and what is allowed.
        """
        base = load_mission(file) if file is not None else Mission()
        stated = self._stated()
        options = {
            field: f"--{option}" for field, option in fields_by_option().items() if attribute_of(option) in stated
        }
        with named_as_options(options):
            mission = ready_mission(with_stated(base, stated))
            check_planner_extra(mission.planner)
        for said in warnings_of(mission):
            note(f"warning: {said}")
        return mission

    def with_slot(self, slot_s: float) -> MissionOptions:
        """Return the same options with another length of a slot."""
        fields: dict[str, Any] = {attribute_of(FIELDS["dt_s"]): slot_s}
        return replace(self, **fields)

    def _stated(self) -> dict[str, Any]:
        """Return the values that the user has given, by the attribute of their option."""
        return {name: value for name in option_attributes() if (value := getattr(self, name)) not in (None, [])}
