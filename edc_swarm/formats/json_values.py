"""JSON of other programs, read with limits."""

from __future__ import annotations

import json
from collections import Counter
from typing import Any

import msgspec

from edc_swarm.errors import FormatError
from edc_swarm.formats.content import decoded


def json_value(data: bytes) -> Any:
    """Return what a JSON file holds.

    Raises
    ------
    FormatError
        It is not JSON, is cut short, is nested too deeply, or has a key twice in one object.
    """
    text = decoded(data)
    try:
        value = msgspec.json.decode(text)
        # msgspec keeps the last of equal keys and does not say so. Numbers stay texts: Python refuses very long ones.
        json.loads(text, object_pairs_hook=_check_keys, parse_int=str, parse_float=str)
        return value
    except msgspec.DecodeError as error:
        raise FormatError("", f"must be whole, valid JSON ({error})") from None
    except RecursionError:
        raise FormatError("", "must be JSON with fewer levels") from None


def _check_keys(pairs: list[tuple[str, Any]]) -> None:
    """Raise `FormatError` if a key is there twice: programs differ in which of its values they take."""
    key, count = next(iter(Counter(key for key, _ in pairs).most_common(1)), ("", 0))
    if count > 1:
        raise FormatError(f"key {key[:40]!r}", f"{count} times in one object: must be there once")


def as_table(place: str, value: Any) -> dict[str, Any]:
    """Return `value` if it is a JSON object, else raise `FormatError`."""
    if isinstance(value, dict):
        return value
    raise FormatError(place, "must be a JSON object")


def as_list(place: str, value: Any) -> list[Any]:
    """Return `value` if it is a JSON array, else raise `FormatError`."""
    if isinstance(value, list):
        return value
    raise FormatError(place, "must be a JSON array")


def as_word(value: Any) -> str:
    """Return a JSON text of up to 40 characters as it is, and any other value as a text that is no known word."""
    return value if isinstance(value, str) and len(value) <= 40 else f"({type(value).__name__})"
