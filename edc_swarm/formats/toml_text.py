"""An imported mission as the text of a mission file, with its sources and what it does not express as comments."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import msgspec

from edc_swarm.foreign_text import shown
from edc_swarm.formats.assemble import Imported
from edc_swarm.formats.content import ranges


def mission_text(imported: Imported, files: Sequence[str]) -> str:
    """Return the TOML of an imported mission."""
    lines = [f"# Imported from {', '.join(shown(file) for file in files)}."]
    lines += ["# What a mission does not express, or expresses in another form:"] * any(imported.notes.values())
    lines += [f"# {line}" for line in note_lines(imported)]
    plain = {key: value for key, value in imported.mission.items() if key not in {"zone", "roster"}}
    lines += ["", *(f"{key} = {_toml(value)}" for key, value in plain.items())]
    for key in ("zone", "roster"):
        for index, table in enumerate(imported.mission[key]):
            lines += ["", f"# {shown(imported.places[key, index])}", f"[[{key}]]"]
            lines += [f"{name} = {_toml(value)}" for name, value in table.items()]
    return "\n".join(lines) + "\n"


def note_lines(imported: Imported) -> Iterator[str]:
    """Yield a line for each kind of thing that the mission does not express, and for each remark."""
    for file, notes in imported.notes.items():
        for what, items in notes.items():
            places = f"{len(items)} place{'s' * (len(items) != 1)}"
            yield shown(f"{file}: {what}: in {places}: {ranges(items)}", 1000)
    for remark in imported.remarks:
        yield shown(remark, 1000)


def _toml(value: Any) -> str:
    """Return a value as TOML; a printable JSON text is one."""
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, tuple):
        return _toml(list(value))
    return msgspec.json.encode(value).decode() if isinstance(value, str) else repr(value)
