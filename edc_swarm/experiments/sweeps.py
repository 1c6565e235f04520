"""Declared sweeps: lists of runs, each of which is a mission and the name of a measurement.

A run is pure data. So any process on any machine of a cluster can execute it, its key finds it in a file of results,
and a printed command repeats it.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import msgspec

from edc_swarm.errors import InputError
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.declarations import option_names
from edc_swarm.mission.link import Link
from edc_swarm.mission.reference import TABLES


@dataclass(frozen=True, slots=True)
class Run:
    """One run of a sweep.

    Attributes
    ----------
    measure
        Name of a measurement that the caller defines, or "module:function" of a user's function from a `Mission` to
        plain data.
    mission
        The mission as in a mission file; missing fields are derived or drawn from its seed.
    alone
        True if the result is a time, so that no other run may execute at the same time.
    file
        A mission file of the same content, for missions that options cannot express.
    verb
        The command that runs it, `sim` or `run`.
    """

    measure: str
    mission: Mission
    alone: bool = False
    file: str = ""
    verb: str = "sim"

    @property
    def key(self) -> str:
        """Unique key of this run: the measure and every field that is not at its default."""
        return f"{self.measure} {msgspec.json.encode(changed_fields(self.mission), order='deterministic').decode()}"

    @property
    def command(self) -> str:
        """The command line that runs this mission.

        Raises
        ------
        InputError
            A field of the mission has no option, and there is no mission file.
        """
        if self.file:
            return shlex.join(["edc-swarm", self.verb, self.file])
        return command_of(self.mission, self.verb)


def changed_fields(mission: Mission) -> dict[str, Any]:
    """Return the fields of `mission` that are not at their default, as plain data."""
    default = msgspec.to_builtins(Mission())
    return {name: value for name, value in msgspec.to_builtins(mission).items() if value != default[name]}


def mission_toml(mission: Mission) -> str:
    """Return `mission` as the text of a mission file, with the fields that are not at their default."""
    scalars, tables = [], []
    for name, value in changed_fields(mission).items():
        if isinstance(value, dict):
            tables.append(f"\n[{name}]\n{_lines(value)}")
        elif isinstance(value, list) and isinstance(value[0], dict):
            tables += [f"\n[[{name}]]\n{_lines(entry)}" for entry in value]
        else:
            scalars.append(_lines({name: value}))
    return "".join([*scalars, *tables])


def _lines(values: dict[str, Any]) -> str:
    """Return lines of TOML for numbers, texts and lists of texts, whose syntax is that of JSON."""
    return "".join(f"{name} = {msgspec.json.encode(value).decode()}\n" for name, value in values.items())


def command_of(mission: Mission, verb: str = "sim") -> str:
    """Return the command line of `edc-swarm sim` or `run` whose options give this mission.

    Raises
    ------
    InputError
        A field has no option.
    """
    words, options = ["edc-swarm", verb], option_names(Mission)
    for name, value in changed_fields(mission).items():
        if name in options:
            for each in value if isinstance(value, list) else [value]:
                short = isinstance(each, float) and each == float(f"{each:g}")
                words += [f"--{options[name]}", f"{each:g}" if short else str(each)]
        elif name in TABLES and _changed_in(mission, name).keys() <= option_names(TABLES[name]).keys():
            words += _words(_changed_in(mission, name), option_names(TABLES[name]))
        elif name == "link" and len(value) == 1:
            words += _link_words(mission)
        elif name != "name":
            raise InputError(name, value, f"a field that an option of edc-swarm {verb} sets, or in a mission file")
    return shlex.join(words)


def _changed_in(mission: Mission, table: str) -> dict[str, Any]:
    """Return the fields of a mission's table that differ from their defaults."""
    default = msgspec.to_builtins(TABLES[table]())
    return {
        name: value for name, value in msgspec.to_builtins(getattr(mission, table)).items() if value != default[name]
    }


def _link_words(mission: Mission) -> list[str]:
    link, default = msgspec.to_builtins(mission.link[0]), msgspec.to_builtins(type(mission.link[0])())
    changed = {name: value for name, value in link.items() if value != default[name]}
    options = option_names(Link)
    if unsaid := changed.keys() - options.keys():
        raise InputError("link", sorted(unsaid), "delay, jitter and loss of all links, or in a mission file")
    return _words(changed, options)


def _words(changed: Mapping[str, Any], options: Mapping[str, str]) -> list[str]:
    return [word for name, value in changed.items() for word in (f"--{options[name]}", str(value))]
