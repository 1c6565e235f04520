"""Values that a user states by the names of options, as fields of a mission.

`edc-swarm sim --loss 0.1 --area 40000` and `edc_swarm.simulate(loss=0.1, area=40_000)` state the same.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from difflib import get_close_matches
from typing import Any

from msgspec import to_builtins

from edc_swarm.errors import InputError, MissionError
from edc_swarm.mission.configuration import AREA_M2, Mission
from edc_swarm.mission.declarations import option_names
from edc_swarm.mission.link import Link
from edc_swarm.mission.reference import TABLES
from edc_swarm.mission.validation import refuse_idle, with_options

FIELDS = option_names(Mission)
"""Name of the option that sets each field of the mission, for fields that have one."""
LINK_FIELDS = option_names(Link)
"""Name of the option that sets each field of every link of the mission, for fields that have one."""
TABLE_FIELDS = {key: option_names(kind) for key, kind in TABLES.items()}
"""Names of the options that set fields of the mission's tables, by table and field."""


def attribute_of(option: str) -> str:
    """Return the name of an option as a name in Python."""
    return option.replace("-", "_")


def fields_by_option() -> dict[str, str]:
    """Return the option that sets each field; `link.loss` is a field of every link."""
    tables = {"link": LINK_FIELDS, **TABLE_FIELDS}
    inner = {f"{key}.{name}": option for key, names in tables.items() for name, option in names.items()}
    return {**FIELDS, **inner}


def option_attributes() -> Iterator[str]:
    """Yield the name in Python of every option that sets something of a mission."""
    yield from map(attribute_of, fields_by_option().values())


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


def with_stated(base: Mission, stated: Mapping[str, Any]) -> Mission:
    """Return `base` with the stated values, by the Python name of an option or of a field of the mission.

    Faults are added to those of `base`; a value of a link holds for every link.

    Raises
    ------
    MissionError
        A name is neither, or a value is not allowed.
    """
    known = sorted({*option_attributes(), *Mission.__struct_fields__})
    for name in stated:
        if name not in known:
            near = get_close_matches(name, known, 1)
            hint = f"{near[0]}?" if near else "docs/mission.md lists them"
            raise MissionError(name, stated[name], f"an option of edc-swarm sim or a field of the mission ({hint})")
    for field, name in ((field, attribute_of(option)) for field, option in FIELDS.items()):
        if name != field and name in stated and field in stated:
            raise MissionError(name, stated[name], f"left out beside {field}, which is the same")
    # `vehicle` is a table, and an option for the model in it.
    given = {name: value for name, value in stated.items() if name in Mission.__struct_fields__}
    refuse_idle(given.get("vehicle"))
    given.update(_of(stated, FIELDS))
    if "area_m2" in given:
        given = {"area_x_m": 0.0, "area_y_m": 0.0, **given}
    elif "area_x_m" in given or "area_y_m" in given:
        given["area_m2"] = AREA_M2
    if "fault" in given:
        if not isinstance(given["fault"], list | tuple):
            raise MissionError("fault", given["fault"], "a list of texts")
        given["fault"] = [*base.fault, *given["fault"]]
    for key, names in TABLE_FIELDS.items():
        if values := _of(stated, names):
            given[key] = {**to_builtins(getattr(base, key)), **values}
    if values := _of(stated, LINK_FIELDS):
        given["link"] = [values, *({**rule, **values} for rule in to_builtins(base.link))]
    return with_options(base, given)


def _of(stated: Mapping[str, Any], options: Mapping[str, str]) -> dict[str, Any]:
    """Return the stated values of one kind of options, by field."""
    names = {field: attribute_of(option) for field, option in options.items()}
    return {field: stated[name] for field, name in names.items() if not isinstance(stated.get(name), Mapping | None)}
