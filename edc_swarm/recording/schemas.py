"""JSON schemas of the messages, in the subset that viewers accept.

Foxglove and Lichtblick reject a whole topic if its schema has `$ref`, `anyOf`, an array of arrays, or a field
without a type. So this module inlines references, keeps only types, and leaves out lists of points.
"""

from __future__ import annotations

from typing import Any

import msgspec
from msgspec import Struct


def json_schema(kind: type[Struct]) -> dict[str, Any]:
    """Return the schema of a message type, reduced to titles, types, properties, items and enumerations."""
    whole: dict[str, Any] = msgspec.json.schema(kind)
    return _plain(whole, whole["$defs"])


def _plain(schema: dict[str, Any], definitions: dict[str, Any]) -> dict[str, Any]:
    if "$ref" in schema:
        schema = definitions[schema["$ref"].rpartition("/")[2]]
    if "anyOf" in schema:
        schema = next(option for option in schema["anyOf"] if option.get("type") != "null")
        return _plain(schema, definitions)
    plain: dict[str, Any] = {key: schema[key] for key in ("title", "type", "enum") if key in schema}
    if "enum" in schema:
        plain.setdefault("type", "string")
    if "properties" in schema:
        fields = schema["properties"].items()
        plain["properties"] = {name: _plain(field, definitions) for name, field in fields if not _is_nested(field)}
    elif plain.get("type") == "object":
        plain["properties"] = {}  # viewers read the properties of every object
    if "items" in schema:
        plain["items"] = _plain(schema["items"], definitions)
    return plain


def _is_nested(field: dict[str, Any]) -> bool:
    """Return True for an array of arrays."""
    items = field.get("items")
    return isinstance(items, dict) and items.get("type") == "array"
