"""Options of `run` and `sim` about the mission, made from the declarations of its fields."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, make_dataclass, replace
from pathlib import Path
from typing import Annotated, Any, get_origin, get_type_hints

from cyclopts import Parameter
from msgspec import Struct, to_builtins

from edc_swarm.emulation.energy import check_batteries, stranded
from edc_swarm.errors import InputError
from edc_swarm.foreign_text import listed
from edc_swarm.mission.airspace import check_zones
from edc_swarm.mission.configuration import AREA_M2, Mission
from edc_swarm.mission.declarations import declarations, option_names
from edc_swarm.mission.faults import parse_faults
from edc_swarm.mission.link import Link
from edc_swarm.mission.reference import TABLES
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.validation import load_mission, with_options
from edc_swarm.planner.registry import check_planner
from edc_swarm.simulation.plug_in_trial import try_plug_ins
from processes.cli.whole_number import WholeNumber
from processes.runtime.console import note
from processes.runtime.extras import check_planner_extra
from processes.runtime.voice import Voice

MISSION_HELP = "Mission file (TOML); without one, a random mission."

FIELDS = option_names(Mission)
"""Name of the option that sets each field of the mission, for fields that have one."""
LINK_FIELDS = option_names(Link)
"""Name of the option that sets each field of every link of the mission, for fields that have one."""
TABLE_FIELDS = {key: option_names(kind) for key, kind in TABLES.items()}
"""Names of the options that set fields of the mission's tables, by table and field."""


@contextmanager
def named_as_options(options: Mapping[str, str]) -> Iterator[None]:
    """Replace fields by options in an `InputError`, where the user has given options.

    `options` maps each field to the option that sets it. An element of a list, such as link[0].loss or delays_ms[2],
    belongs to the option for the whole list.
    """
    try:
        yield
    except InputError as error:
        field = options.get(re.sub(r"\[\d+\]", "", error.field), error.field)
        allowed = re.sub(r"\w+_\w+", lambda name: options.get(name[0], name[0]), error.allowed)
        raise type(error)(field, error.value, allowed) from None


def _warn_of_batteries(mission: Mission) -> None:
    """Warn before take-off of batteries that do not reach the target: the mission is valid all the same."""
    needed_j = stranded(mission)
    if not needed_j:
        return
    battery_j = {entry.uav: entry.energy_j for entry in mission.roster}
    named = [f"{uav} ({battery_j[uav]:.4g} of {needed_j[uav]:.4g} J)" for uav in needed_j]
    note(f"warning: no battery for the straight flight to the target at full speed: {listed(named)}")


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
            yield _attribute(option), Annotated[list[str], parameter], field(default_factory=list)
        else:
            taken = WholeNumber if plain is int else plain
            yield _attribute(option), Annotated[taken | None, Parameter(help=help_text)], None


def _attribute(option: str) -> str:
    return option.replace("-", "_")


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
        with named_as_options(self._options()):
            mission = complete_mission(with_options(base, self._given(base)))
            parse_faults(mission)
            check_planner_extra(mission.planner)
            check_planner(mission)
            try_plug_ins(mission)
            check_batteries(mission)
        _warn_of_batteries(mission)
        for said in check_zones(mission):
            note(f"warning: {said}")
        return mission

    def with_slot(self, slot_s: float) -> MissionOptions:
        """Return the same options with another length of a slot."""
        fields: dict[str, Any] = {_attribute(FIELDS["dt_s"]): slot_s}
        return replace(self, **fields)

    def _options(self) -> dict[str, str]:
        """Return the given options by the field that they set; `link.loss` is a field of every link."""
        tables = {"link": LINK_FIELDS, **TABLE_FIELDS}
        inner = {f"{key}.{name}": option for key, names in tables.items() for name, option in names.items()}
        fields = {**FIELDS, **inner}
        return {name: f"--{option}" for name, option in fields.items() if self._value(option) not in (None, [])}

    def _given(self, base: Mission) -> dict[str, Any]:
        given = self._stated(FIELDS)
        if "area_m2" in given:
            given = {"area_x_m": 0.0, "area_y_m": 0.0, **given}
        elif "area_x_m" in given or "area_y_m" in given:
            given["area_m2"] = AREA_M2
        given["fault"] = [*base.fault, *given["fault"]]
        for key, names in TABLE_FIELDS.items():
            if stated := self._stated(names):
                given[key] = {**to_builtins(getattr(base, key)), **stated}
        if stated := self._stated(LINK_FIELDS):
            given["link"] = [stated, *({**rule, **stated} for rule in to_builtins(base.link))]
        return given

    def _stated(self, options: Mapping[str, str]) -> dict[str, Any]:
        """Return the values that the user has given, by field."""
        return {name: value for name, option in options.items() if (value := self._value(option)) is not None}

    def _value(self, option: str) -> Any:
        return getattr(self, _attribute(option))
