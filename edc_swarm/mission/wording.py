"""The values that a declared type allows, in plain words, for errors and for the reference of the mission."""

from __future__ import annotations

import re
from functools import cache

from msgspec import inspect
from msgspec.inspect import (
    BoolType,
    DictType,
    FloatType,
    IntType,
    ListType,
    LiteralType,
    NoneType,
    StrType,
    StructType,
    TupleType,
    Type,
    UnionType,
)

_NAME = re.compile(r"\^\[A-Za-z0-9_-\]\{(\d+),(\d+)\}\$.*")
"""The pattern of an id or a name."""
_PLAIN = {
    StructType: "a table",
    DictType: "a table",
    TupleType: "a point [x, y]",
    BoolType: "true or false",
    NoneType: "null",
}


def in_words(kind: Type) -> str:
    """Return what `kind` allows, to complete "must be ...": "a number from 0 to 1"."""
    match kind:
        case IntType() | FloatType():
            return _number(kind)
        case StrType():
            return _text(kind)
        case LiteralType(values=values):
            return "one of " + ", ".join(str(value) or '""' for value in values)
        case ListType():
            return _list(kind)
        case UnionType(types=types):
            return " or ".join(in_words(each) for each in types)
        case _:
            return _PLAIN.get(type(kind), "of another type")


def type_at(kind: type, path: str) -> Type:
    """Return the declared type at `path`, such as `roster[2].r_m`, inside the Struct `kind`.

    `[...]` in a path is any value of a table.
    """
    found = _described(kind)
    for part in re.findall(r"\.\.\.|[^.\[\]]+", path):
        options = found.types if isinstance(found, UnionType) else (found,)
        found = next(inner for each in options if (inner := _inside(each, part)) is not None)
    return found


def plain_number(value: float) -> str:
    """Return a number as a user writes it: 10000, 0.25, 1e12."""
    if isinstance(value, int):
        return str(value)
    digits, _, exponent = f"{value:.12e}".partition("e")
    return f"{value:.12g}" if -4 <= int(exponent) < 7 else f"{digits.rstrip('0').rstrip('.')}e{int(exponent)}"


@cache
def _described(kind: type) -> Type:
    return inspect.type_info(kind)


def _inside(kind: Type, part: str) -> Type | None:
    if isinstance(kind, StructType):
        return next((field.type for field in kind.fields if field.encode_name == part), None)
    if isinstance(kind, TupleType):
        return kind.item_types[min(int(part), len(kind.item_types) - 1)]
    if isinstance(kind, DictType):
        return kind.value_type
    return kind.item_type if isinstance(kind, ListType) else None


def _number(kind: IntType | FloatType) -> str:
    noun = "a whole number" if isinstance(kind, IntType) else "a number"
    if kind.ge is not None and kind.le is not None:
        return f"{noun} from {plain_number(kind.ge)} to {plain_number(kind.le)}"
    limits = {"above": kind.gt, "at least": kind.ge, "below": kind.lt, "at most": kind.le}
    said = [f"{word} {plain_number(limit)}" for word, limit in limits.items() if limit is not None]
    return f"{noun} {' and '.join(said)}".rstrip()


def _list(kind: ListType) -> str:
    nouns = {
        StructType: "tables",
        StrType: "texts",
        IntType: "whole numbers",
        FloatType: "numbers",
        TupleType: "points [x, y]",
    }
    items = nouns.get(type(kind.item_type), "values")
    if kind.max_length is None:
        return f"a list of {items}"
    least = f"{kind.min_length} to " if kind.min_length else "at most "
    return f"a list of {least}{kind.max_length} {items}"


def _text(kind: StrType) -> str:
    if kind.pattern is not None and (name := _NAME.fullmatch(kind.pattern)):
        return f"{name[1]} to {name[2]} of the letters a-z and A-Z, digits, - and _"
    if kind.max_length is None:
        return "a text"
    least = f"{kind.min_length} to " if kind.min_length else "at most "
    return f"a text of {least}{kind.max_length} characters"
