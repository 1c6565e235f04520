"""Statistics of sweeps: means with 95 % confidence intervals, and power laws."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
from msgspec import Struct
from scipy.special import chdtri, ndtri, stdtrit

CONFIDENCE = 0.95
Kind = Literal["signed", "amount", "per cent", "share of runs", "count"]
"""Kind of a quantity, which decides its interval.

A number of any sign; one that is never below 0; one from 0 to 100; a value of each run that is 0 or 100; a count.
"""


class Estimate(Struct, frozen=True):
    """A mean over independent runs and its confidence interval (None for a single run)."""

    runs: int
    mean: float
    low: float | None
    high: float | None


class PowerLaw(Struct, frozen=True):
    """y = factor * x ** exponent, fitted to means; `low` and `high` bound the exponent at 95 %."""

    exponent: float
    factor: float
    low: float | None
    high: float | None


def half_width(deviation: float, degrees: int) -> float | None:
    """Return half of the width of Student's t interval for a standard error with `degrees` of freedom."""
    if degrees < 1:
        return None
    return float(stdtrit(degrees, (1 + CONFIDENCE) / 2)) * deviation


def estimate(values: Sequence[float], kind: Kind = "signed") -> Estimate:
    """Return the mean of independent runs with its confidence interval, by the kind of the values.

    - "signed": Student's t.
    - "amount", "per cent": the same, without the part in which no mean can be; that changes no coverage.
    - "share of runs": Wilson's score interval (E. B. Wilson, J. Am. Stat. Assoc. 22(158), 1927), also for one run.
    - "count": the exact interval of a Poisson mean (F. Garwood, Biometrika 28, 1936), or Student's t where it is
      wider, since counts of different missions may vary more than a Poisson count.
    """
    if kind == "share of runs":
        return _wilson(values)
    runs, mean = len(values), float(np.mean(values))
    error = float(np.std(values, ddof=1)) / math.sqrt(runs) if runs > 1 else 0.0
    half = half_width(error, runs - 1)
    low, high = (None, None) if half is None else (mean - half, mean + half)
    if kind == "count":
        least, most = _garwood(values)
        low, high = min(least, mean if low is None else low), max(most, mean if high is None else high)
    if kind != "signed" and low is not None:
        low = max(low, 0.0)
    if kind == "per cent" and high is not None:
        high = min(high, 100.0)
    return Estimate(runs, mean, low, high)


def _wilson(values: Sequence[float]) -> Estimate:
    """Return the share of the values, 0 or 100, that are 100, in per cent."""
    runs, share, z = len(values), float(np.mean(values)) / 100, float(ndtri((1 + CONFIDENCE) / 2))
    middle = (share + z * z / (2 * runs)) / (1 + z * z / runs)
    half = z / (1 + z * z / runs) * math.sqrt(share * (1 - share) / runs + (z / (2 * runs)) ** 2)
    low, high = max(0.0, middle - half), min(1.0, middle + half)
    return Estimate(runs, 100 * share, 0.0 if share == 0 else 100 * low, 100.0 if share == 1 else 100 * high)


def _garwood(values: Sequence[float]) -> tuple[float, float]:
    """Return the exact interval of the mean of Poisson counts."""
    total, runs, tail = float(np.sum(values)), len(values), (1 - CONFIDENCE) / 2
    low = chdtri(2 * total, 1 - tail) / 2 if total else 0.0
    return float(low) / runs, float(chdtri(2 * total + 2, tail)) / 2 / runs


def power_law(x: Sequence[float], y: Sequence[float]) -> PowerLaw | None:
    """Return the least-squares fit in log-log coordinates; None if there are fewer than two positive points."""
    points = [(math.log(a), math.log(b)) for a, b in zip(x, y, strict=True) if a > 0 and b > 0]
    if len({a for a, _ in points}) < 2:
        return None
    log_x, log_y = np.array(points).T
    slope, offset = np.polynomial.polynomial.polyfit(log_x, log_y, 1)[::-1]
    spread = log_x - log_x.mean()
    residual = log_y - offset - slope * log_x
    degrees = len(points) - 2
    error = math.sqrt(float(residual @ residual) / degrees / float(spread @ spread)) if degrees else 0.0
    half = half_width(error, degrees)
    exponent, factor = float(slope), math.exp(float(offset))
    return PowerLaw(
        exponent, factor, None if half is None else exponent - half, None if half is None else exponent + half
    )
