"""Backlog of the recorder: by how much it is behind, and when that is worth an event."""

from __future__ import annotations

BEHIND_S = 1.0
"""Age of the next message from which on the recorder is behind: it then requests no lost messages."""


class Backlog:
    """Age of the messages that the recorder writes. It tells of 1, 2, 4, 8 ... seconds, each once."""

    def __init__(self) -> None:
        self.age_s = 0.0
        self._told_s = BEHIND_S / 2

    @property
    def is_behind(self) -> bool:
        """True if completeness must wait: what is asked for now would come on top of the backlog."""
        return self.age_s >= BEHIND_S

    def note(self, age_s: float, waiting: int) -> str | None:
        """Take in the age of the next message and the number behind it; return the detail of an event, or None."""
        self.age_s = age_s
        if age_s < 2 * self._told_s:
            return None
        while self._told_s * 2 <= age_s:
            self._told_s *= 2
        return f"{age_s:.1f} s and {waiting} messages behind"
