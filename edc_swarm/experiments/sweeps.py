"""Declared sweeps: many runs, each a mission and what is measured on it.

A run is pure data, so that it can be made in any process or on any machine of a cluster, be found
again in a file of results by its key, and be flown again by a printed command.
"""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from typing import Any

import msgspec

from edc_swarm.errors import InputError
from edc_swarm.mission.configuration import Link, Mission
from edc_swarm.mission.declarations import option_names


@dataclass(frozen=True, slots=True)
class Run:
    """One run of a sweep.

    Attributes
    ----------
    measure
        Name of the measurement, as whoever makes the run knows it, or "module:function" of a function of your own
        from a `Mission` to plain data.
    mission
        As it would be in a mission file; what is left out is derived or drawn from its seed.
    alone
        Whether its result is a time, so that nothing else may run meanwhile.
    file
        A mission file that says the same, for missions that options cannot say.
    verb
        The command that flies it, `sim` or `run`.
    """

    measure: str
    mission: Mission
    alone: bool = False
    file: str = ""
    verb: str = "sim"

    @property
    def key(self) -> str:
        """What tells this run from all others: the measure and every field that is no default."""
        return f"{self.measure} {msgspec.json.encode(changed_fields(self.mission), order='deterministic').decode()}"

    @property
    def command(self) -> str:
        """The command line that flies this mission.

        Raises
        ------
        InputError
            A field of the mission has no option, and there is no mission file.
        """
        if self.file:
            return shlex.join(["edc-swarm", self.verb, self.file])
        return command_of(self.mission, self.verb)


def changed_fields(mission: Mission) -> dict[str, Any]:
    """The fields of `mission` that are not at their default, as plain data."""
    default = msgspec.to_builtins(Mission())
    return {name: value for name, value in msgspec.to_builtins(mission).items() if value != default[name]}


def mission_toml(mission: Mission) -> str:
    """The mission file that says `mission`: what is not at its default."""
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
    """Numbers, texts and lists of texts, which TOML writes as JSON does."""
    return "".join(f"{name} = {msgspec.json.encode(value).decode()}\n" for name, value in values.items())


def command_of(mission: Mission, verb: str = "sim") -> str:
    """`edc-swarm sim` or `run` with the options that say this mission.

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
        elif name == "link" and len(value) == 1:
            words += _link_words(mission)
        elif name != "name":
            raise InputError(name, value, f"a field that an option of edc-swarm {verb} sets, or in a mission file")
    return shlex.join(words)


def _link_words(mission: Mission) -> list[str]:
    link, default = msgspec.to_builtins(mission.link[0]), msgspec.to_builtins(type(mission.link[0])())
    changed = {name: value for name, value in link.items() if value != default[name]}
    options = option_names(Link)
    if unsaid := changed.keys() - options.keys():
        raise InputError("link", sorted(unsaid), "delay, jitter and loss of all links, or in a mission file")
    return [word for name, value in changed.items() for word in (f"--{options[name]}", str(value))]
