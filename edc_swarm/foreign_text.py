"""Foreign text, which anybody may have written, made safe and short for terminals and pages."""

from __future__ import annotations

MAX_SHOWN = 200
"""Characters of one foreign text, such as a key."""
MAX_LINE = 4000
"""Characters of a whole line, which may list a roster."""


def shown(text: str, limit: int = MAX_SHOWN) -> str:
    r"""Return the first `limit` characters of `text`, with unprintable ones escaped, as in `\x1b`."""
    cut = text[:limit]
    if not cut.isprintable():
        cut = "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in cut)
    return cut if len(text) <= limit else f"{cut}... ({len(text)} characters)"


def shown_lines(text: str) -> str:
    """Apply `shown` to each line of `text`, with at most `MAX_LINE` characters a line."""
    return "\n".join(shown(line, MAX_LINE) for line in text.split("\n"))
