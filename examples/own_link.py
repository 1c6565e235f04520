"""An example of a user's link model: a base station that hands over every 15 s and is away for 150 ms then.

cd examples
edc-swarm sim own_link.toml
"""

from __future__ import annotations

from random import Random

from edc_swarm.emulation.links import Passage
from edc_swarm.mission.link import Link

EVERY_MS, AWAY_MS = 15_000.0, 150.0


class Handovers:
    """What is sent in a handover waits for its end, longer on slow links; each link has handovers at other times."""

    def __init__(self, link: Link, random: Random) -> None:
        self._away_ms = AWAY_MS + link.delay_ms
        self._first_ms = random.uniform(0.0, EVERY_MS)

    def delay_ms(self, message: Passage) -> float | None:
        return max(0.0, self._away_ms - (message.wall_ms + self._first_ms) % EVERY_MS)
