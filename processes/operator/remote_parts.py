"""The parts of a mission that others run, as the operator sees them: present, away for a while, or given up."""

from __future__ import annotations

from collections.abc import Iterable, Set

PART_LOST_S = 10.0
"""Time after which the operator gives up a part that is off the bus; the part may come back later."""


class Remote:
    """Presence of `parts`, by their liveliness tokens."""

    def __init__(self, parts: Iterable[str]) -> None:
        self.parts = frozenset(parts)
        self._away_since_s: dict[str, float] = {}
        self._given_up: set[str] = set()

    @property
    def expected(self) -> set[str]:
        """The parts that are present or may come back."""
        return set(self.parts - self._given_up)

    def is_settled(self, alive: Set[str]) -> bool:
        """Return True if no part is away that may come back, not even since the last look."""
        return self.parts - alive <= self._given_up

    def left(self, alive: Set[str]) -> list[str]:
        """Return the parts that have left the bus since the last look."""
        return sorted(self.parts - alive - self._away_since_s.keys())

    def look(self, alive: Set[str], dead: Set[str], now_s: float) -> tuple[list[str], list[str]]:
        """Return the parts that it gives up from now on, and those that have come back; the `dead` never come back."""
        for part in self.parts & alive:
            self._away_since_s.pop(part, None)
        for part in self.parts - alive:
            self._away_since_s.setdefault(part, now_s)
        lost = {part for part, since_s in self._away_since_s.items() if part in dead or now_s - since_s >= PART_LOST_S}
        gone, back = sorted(lost - self._given_up), sorted(self._given_up & alive)
        self._given_up = lost
        return gone, back
