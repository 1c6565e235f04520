"""Text that strangers may have written, made safe and short enough for people's terminals and pages."""

from __future__ import annotations

MAX_SHOWN = 200
"""Characters of one foreign text, such as a key."""
MAX_LINE = 4000
"""Characters of a whole line, which may list a roster."""


def shown(text: str, limit: int = MAX_SHOWN) -> str:
    r"""Return `text` cut after `limit` characters, each that is not printable escaped, as in `\x1b`."""
    cut = text[:limit]
    if not cut.isprintable():
        cut = "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in cut)
    return cut if len(text) <= limit else f"{cut}... ({len(text)} characters)"


def shown_lines(text: str) -> str:
    """Return `text` line by line as `shown` does, each up to `MAX_LINE` characters."""
    return "\n".join(shown(line, MAX_LINE) for line in text.split("\n"))
