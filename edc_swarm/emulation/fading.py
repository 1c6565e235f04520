"""Fading: the loss of messages that are received with too little power.

Log-normal shadowing and its outage: T. S. Rappaport, "Wireless Communications", 2nd ed., 2002, sections 4.9.1-4.9.3.
Rayleigh fading: ibid., sections 5.6 and 5.7. The gain of its channel is a complex Gauss-Markov process here, whose
correlation falls exponentially with time; the Bessel function of Clarke's model needs the whole past.
"""

from __future__ import annotations

import math
from random import Random

from edc_swarm.mission.link import Link


def fading_loss(distance_m: float, rule: Link) -> float:
    """Return the probability that a message is lost to distance.

    The received power falls with distance to the power `path_loss_exponent`. Without Rayleigh fading it varies from
    message to message, normally in decibels, with deviation `shadowing_db`; with it, it is exponentially distributed.
    At `range_m` its median is just enough:

        margin = 10 path_loss_exponent log10(range / distance)            [dB]
        loss   = erfc(margin / (sqrt(2) shadowing_db)) / 2                shadowing
        loss   = 1 - 2 ** -((distance / range) ** path_loss_exponent)     Rayleigh
    """
    if distance_m <= 0.0 or not rule.range_m:
        return 0.0
    margin_db = 10.0 * rule.path_loss_exponent * math.log10(rule.range_m / distance_m)
    if rule.fading == "rayleigh":
        return 1.0 - math.exp(-math.log(2.0) * 10.0 ** min(-margin_db / 10.0, 3.0))
    if not rule.shadowing_db:
        return float(margin_db < 0.0)
    return 0.5 * math.erfc(margin_db / (math.sqrt(2.0) * rule.shadowing_db))


class RayleighGain:
    """The gain of one directed channel: a complex Gaussian of mean power 1 that forgets with the coherence time."""

    def __init__(self, random: Random) -> None:
        self._random = random
        self._parts: tuple[float, float] | None = None
        self._last_ms = 0.0

    def power(self, now_ms: float, coherence_ms: float) -> float:
        """Return the power |h|^2 at a wall time that never goes back, in units of its mean."""
        kept = 0.0
        if self._parts is not None and coherence_ms:
            kept = math.exp(-max(now_ms - self._last_ms, 0.0) / coherence_ms)
        old, spread = self._parts or (0.0, 0.0), math.sqrt(0.5 * (1.0 - kept * kept))
        real, imaginary = (kept * part + spread * self._random.gauss(0.0, 1.0) for part in old)
        self._parts, self._last_ms = (real, imaginary), now_ms
        return real * real + imaginary * imaginary


def is_faded(power: float, loss: float) -> bool:
    """Return True if a power, in units of its mean, is too low where a share `loss` of all powers is."""
    return loss >= 1.0 or power < -math.log1p(-loss)
