"""A receiver's log of what its links did to each sender's messages: how many arrived or were lost, and the delays."""

from __future__ import annotations

from collections.abc import Sequence
from random import Random

from msgspec import Struct

LEVELS_PCT = (0, 1, 5, *range(10, 100, 10), 95, 99, 100)
"""Quantiles that are told of the delays of a link."""
MAX_DELAYS = 20_000
"""Most delays of one sender that are kept: of more messages a uniform sample."""
MAX_SENDERS = 100
"""Most senders that are told of, those with the most messages."""


class LinkDelays(Struct, frozen=True):
    """The delays that a directed link added to messages that arrived, at `LEVELS_PCT`; none if all were lost.

    In processes they are those of the emulated link with the receiver's lateness, without the real transport.
    """

    arrived: int
    lost: int
    delay_ms: list[float]


class DelayLog:
    """The messages of each sender."""

    def __init__(self) -> None:
        self._delays_ns: dict[str, list[int]] = {}
        self._arrived: dict[str, int] = {}
        self._lost: dict[str, int] = {}
        self._random = Random(0)

    def arrive(self, sender: str, delay_ns: int) -> None:
        """Take in a message that arrived after `delay_ns`."""
        kept = self._delays_ns.setdefault(sender, [])
        number = self._arrived[sender] = self._arrived.get(sender, 0) + 1
        if number <= MAX_DELAYS:
            kept.append(delay_ns)
        elif (place := self._random.randrange(number)) < MAX_DELAYS:
            kept[place] = delay_ns

    def lose(self, sender: str) -> None:
        """Take in a message that was lost."""
        self._lost[sender] = self._lost.get(sender, 0) + 1

    def told(self) -> dict[str, LinkDelays]:
        """Return what is known of each sender, by id."""
        counts = {uav: self._arrived.get(uav, 0) + self._lost.get(uav, 0) for uav in {**self._arrived, **self._lost}}
        busiest = sorted(counts, key=lambda uav: (-counts[uav], uav))[:MAX_SENDERS]
        return {uav: self._of(uav) for uav in sorted(busiest)}

    def _of(self, uav: str) -> LinkDelays:
        delays_ms = [round(ns / 1e6, 6) for ns in quantiles(self._delays_ns.get(uav, []))]
        return LinkDelays(self._arrived.get(uav, 0), self._lost.get(uav, 0), delays_ms)


def quantiles(values: Sequence[int]) -> list[int]:
    """Return the values of nearest rank at `LEVELS_PCT`; none of none."""
    ordered = sorted(values)
    return [ordered[round(level / 100 * (len(ordered) - 1))] for level in LEVELS_PCT] if ordered else []
