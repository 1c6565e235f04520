"""An example of a user's GPS model: an error that circles, as by a reflection that moves with the satellites.

cd examples
edc-swarm sim --gps-model own_gps:Circling
"""

from __future__ import annotations

import math
from random import Random

PERIOD_S = 60.0


class Circling:
    """An error of 80 % of the largest, which goes round once a minute; it begins anywhere."""

    def __init__(self, reach_m: float, dt_s: float, random: Random) -> None:
        self._radius_m = 0.8 * reach_m
        self._angle = random.uniform(0.0, math.tau)
        self._turn = math.tau * dt_s / PERIOD_S

    def next_error_m(self) -> tuple[float, float]:
        self._angle += self._turn
        return self._radius_m * math.cos(self._angle), self._radius_m * math.sin(self._angle)
