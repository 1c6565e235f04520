"""Texts made short for terminals and pages, and foreign ones, which anybody may have written, made safe."""

from __future__ import annotations

from collections.abc import Sequence

MAX_SHOWN = 200
"""Characters of one foreign text, such as a key."""
MAX_LINE = 4000
"""Characters of a whole line, which may list a roster."""

MOST_LISTED = 5
"""Names in a list that need not be complete."""


def listed(names: Sequence[str], most: int = MOST_LISTED) -> str:
    """Return the first `most` names, and the number of the others."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def shown(text: str, limit: int = MAX_SHOWN) -> str:
    r"""Return the first `limit` characters of `text`, with unprintable ones escaped, as in `\x1b`."""
    cut = text[:limit]
    if not cut.isprintable():
        cut = "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in cut)
    return cut if len(text) <= limit else f"{cut}... ({len(text)} characters)"


def shown_lines(text: str) -> str:
    """Apply `shown` to each line of `text`, with at most `MAX_LINE` characters a line."""
    return "\n".join(shown(line, MAX_LINE) for line in text.split("\n"))
