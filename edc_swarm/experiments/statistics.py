"""Statistics of sweeps: means with 95 % confidence intervals, and power laws."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from scipy.special import stdtrit

CONFIDENCE = 0.95


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


def estimate(values: Sequence[float]) -> Estimate:
    """Return the mean of independent runs with its confidence interval (Student's t distribution)."""
    runs, mean = len(values), float(np.mean(values))
    error = float(np.std(values, ddof=1)) / math.sqrt(runs) if runs > 1 else 0.0
    half = half_width(error, runs - 1)
    return Estimate(runs, mean, None if half is None else mean - half, None if half is None else mean + half)


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
