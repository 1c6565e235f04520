"""JSON of other programs, read with limits."""

from __future__ import annotations

from typing import Any

import msgspec

from edc_swarm.errors import FormatError
from edc_swarm.formats.content import decoded


def json_value(data: bytes) -> Any:
    """Return what a JSON file holds.

    Raises
    ------
    FormatError
        It is not JSON, is cut short, or is nested too deeply.
    """
    try:
        return msgspec.json.decode(decoded(data))
    except msgspec.DecodeError as error:
        raise FormatError("", f"must be whole, valid JSON ({error})") from None
    except RecursionError:
        raise FormatError("", "must be JSON with fewer levels") from None


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
