"""The wind at one UAV: a mean, Dryden turbulence, and gusts that faults ask for.

Source: MIL-F-8785C, "Flying Qualities of Piloted Airplanes", 1980: spectra 3.7.1.2 in Dryden's form, scale lengths at
low altitude 3.7.3, discrete gust 3.7.1.3. Each UAV has turbulence of its own, although two that are closer than the
scale length (50 m) would feel much the same. The air speed in the spectra is the mean wind's or the UAV's largest
speed, whichever is more, and the height is 7 m.

Vectors are complex numbers, x + i y in m/s. Every UAV process imports this module, so it does not import numpy.
"""

from __future__ import annotations

import cmath
import math
import random

from msgspec import Struct

from edc_swarm.mission.wind_model import WindModel

HEIGHT_FT = 23.0
M_PER_FT = 0.3048
SCALE_M = HEIGHT_FT / (0.177 + 0.000823 * HEIGHT_FT) ** 1.2 * M_PER_FT
"""Scale length of horizontal turbulence at that height."""
INTENSITY = 1 / 3
"""Intensity of the turbulence (its standard deviation on each axis) as a share of its largest speed."""
GUST_RISE_S = 1.0
"""Time in which a discrete gust rises and falls, as 1 - cosine."""


class Turbulence(Struct, frozen=True, kw_only=True):
    """State of the two Dryden filters, in units of the intensity: one along the mean wind, two across it."""

    along: float = 0.0
    across: float = 0.0
    across_late: float = 0.0


class Wind:
    """The wind at one UAV, slot by slot; it depends on its arguments alone.

    Parameters
    ----------
    model
        Mean wind and turbulence.
    speed_mps
        Largest speed of the UAV.
    dt_s
        Length of a slot.
    seed
        Text such as `"{mission seed}/{uav}/wind"`.
    """

    def __init__(self, model: WindModel, speed_mps: float, dt_s: float, seed: str) -> None:
        blows_to = math.radians(90.0 - model.direction_deg + 180.0)
        self.mean_mps = cmath.rect(model.mean_mps, blows_to)
        self._direction = cmath.rect(1.0, blows_to)
        self._most_mps = model.gust_mps
        self._seed = seed
        late = dt_s * max(speed_mps, model.mean_mps) / SCALE_M
        self._kept, self._late = math.exp(-late), late * math.exp(-late)
        lost = self._kept**2
        self._noise = math.sqrt(1 - lost)
        shared = 0.5 - (late + 0.5) * lost
        self._noise_shared = shared / self._noise
        self._noise_late = math.sqrt(max(0.0, 0.5 - (late * late + late + 0.5) * lost - self._noise_shared**2))

    def after_slot(self, state: Turbulence, slot: int) -> Turbulence:
        """Return the turbulence at the end of `slot`. Both filters are advanced exactly, with the draws of the slot.

        Across the wind, the filter (1 + sqrt(3) T s) / (1 + T s)^2 is a sum of one and of two lags T in a row.
        """
        if not self._most_mps:
            return state
        draws = random.Random(f"{self._seed}/{slot}")
        first, second, third = draws.gauss(0.0, 1.0), draws.gauss(0.0, 1.0), draws.gauss(0.0, 1.0)
        return Turbulence(
            along=self._kept * state.along + self._noise * first,
            across=self._kept * state.across + self._noise * second,
            across_late=self._kept * state.across_late
            + self._late * state.across
            + self._noise_shared * second
            + self._noise_late * third,
        )

    def of(self, state: Turbulence) -> complex:
        """Return mean wind and turbulence, which is cut off at its largest speed."""
        if not self._most_mps:
            return self.mean_mps
        across = (math.sqrt(3) * state.across + (1 - math.sqrt(3)) * state.across_late) / math.sqrt(2)
        turbulence = INTENSITY * self._most_mps * complex(state.along, across)
        excess = max(1.0, abs(turbulence) / self._most_mps)
        return self.mean_mps + self._direction * turbulence / excess


def gust_share(since_s: float, left_s: float) -> float:
    """Return the share of a discrete gust's speed, `since_s` after it began and `left_s` before it ends."""
    time_s = min(since_s, left_s, GUST_RISE_S)
    return 0.5 * (1 - math.cos(math.pi * time_s / GUST_RISE_S)) if time_s > 0 else 0.0
