"""The declarations of the mission's fields as data, from which docs and option help are made.

The texts are the docstrings below the fields, so they are read from the source of the class.
"""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Annotated, get_args, get_origin, get_type_hints

import msgspec
from msgspec import Struct
from msgspec.structs import FieldInfo

from edc_swarm.mission.field_types import Option
from edc_swarm.mission.wording import in_words, plain_number, type_at

UNITS = {
    "_j_per_message": ("J", "joules"),
    "_kgpm3": ("kg/m³", "kilograms per cubic metre"),
    "_bytes": ("bytes", "bytes"),
    "_slots": ("slots", "slots"),
    "_kbps": ("kbit/s", "kilobits per second"),
    "_mps2": ("m/s²", "metres per second squared"),
    "_mps": ("m/s", "metres per second"),
    "_per_s": ("1/s", "per second"),
    "_deg": ("°", "degrees"),
    "_m2": ("m²", "square metres"),
    "_db": ("dB", "decibels"),
    "_ms": ("ms", "milliseconds of wall time"),
    "_us": ("µs", "microseconds of wall time"),
    "_m": ("m", "metres"),
    "_s": ("s", "seconds of the mission"),
    "_w": ("W", "watts"),
    "_j": ("J", "joules"),
}
"""Symbol and name of the unit that the suffix of a field's name stands for."""


@dataclass(frozen=True, slots=True)
class Declaration:
    """One field, as its declaration says.

    Attributes
    ----------
    name
        Name of the field.
    summary
        What the field is, in one line without a full stop.
    effect
        What it does, and limits that depend on other fields; "" if the summary says it all.
    default
        The default in words; "" where the field must be given.
    source
        Where the default comes from.
    allowed
        The values that the type allows, in words.
    option
        Name of the option that sets the field, without dashes; "" if there is none.
    """

    name: str
    summary: str
    effect: str
    default: str
    source: str
    allowed: str
    option: str

    @property
    def unit(self) -> tuple[str, str]:
        """Symbol and name of the unit; empty for a plain number or a text."""
        return next((unit for suffix, unit in UNITS.items() if self.name.endswith(suffix)), ("", ""))

    @property
    def help(self) -> str:
        """Help of the option: summary, unit and default."""
        unit = f", in {self.unit[1]}" if self.unit[1] and self.unit[0] != "slots" else ""
        return f"{self.summary}{unit} ({self.default})."


@cache
def declarations(kind: type[Struct]) -> dict[str, Declaration]:
    """Return the declarations of a Struct's fields by name, in order.

    Only what the class itself declares counts; each of its fields must have a docstring.
    """
    tree = ast.parse(inspect.getsource(kind)).body[0]
    assert isinstance(tree, ast.ClassDef)
    general = _sections(ast.get_docstring(tree) or "")
    options, fields = option_names(kind), {field.name: field for field in msgspec.structs.fields(kind)}
    found = {}
    for name, text in _documented(tree):
        said = _sections(text)
        summary, _, effect = said["text"].partition("\n\n")
        found[name] = Declaration(
            name,
            _flowing(summary).removesuffix("."),
            _flowing(effect),
            _flowing(said["Default"] if "Default" in said else _default(fields[name])).removesuffix("."),
            _flowing(said.get("Source", general["Source"])).removesuffix("."),
            in_words(type_at(kind, name)),
            options.get(name, ""),
        )
    assert list(found) == list(kind.__struct_fields__), f"a field of {kind.__name__} has no docstring"
    return found


def option_names(kind: type[Struct]) -> dict[str, str]:
    """Return the name of the option, without dashes, of each field of a Struct that has one."""
    found = dict[str, str]()
    for name, hint in get_type_hints(kind, include_extras=True).items():
        marks = get_args(hint)[1:] if get_origin(hint) is Annotated else ()
        found.update((name, mark.name) for mark in marks if isinstance(mark, Option))
    return found


def _documented(tree: ast.ClassDef) -> Iterator[tuple[str, str]]:
    """Yield name and docstring of each field."""
    for field, below in zip(tree.body, tree.body[1:], strict=False):
        match field, below:
            case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(text))):
                yield name, inspect.cleandoc(text)


def _sections(text: str) -> dict[str, str]:
    """Split a docstring into its text and what follows the lines "Default:" and "Source:"."""
    first, *rest = re.split(r"^(Default|Source): ", text, flags=re.MULTILINE)
    return {"text": first.strip(), **dict(zip(rest[::2], rest[1::2], strict=True))}


def _flowing(text: str) -> str:
    return " ".join(text.split())


def _default(field: FieldInfo) -> str:
    """Return the default of a field in words."""
    match field.default:
        case str(text):
            return text
        case bool(flag):
            return str(flag).lower()
        case int(number) | float(number):
            return plain_number(number)
        case Struct():
            return "those of its keys"
        case _:
            return "" if field.required else "none"
