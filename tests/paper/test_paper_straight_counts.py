"""Collisions with avoidance disabled (the paper's Fig. 4), counted directly.

Pairs whose discs overlap at least once until all have arrived, everyone flying straight at a constant
5 m/s; means over seeds 0-29 of the random missions, within 1 of an independent measurement.
"""

from __future__ import annotations

import numpy as np
import pytest

from edc_swarm.analysis.separation import encounters
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import random_roster

SEEDS = range(30)

BY_UAVS = {10: 7.9, 20: 31, 30: 70, 40: 130, 50: 203}
BY_AREA_M2 = {10_000: 203, 20_000: 155, 40_000: 112, 60_000: 87, 90_000: 72}
BY_RADIUS_M = {1: 23, 2: 46, 4: 87, 6: 132, 8: 170, 10: 203}


def overlapping_pairs(mission: Mission) -> int:
    """Pairs that overlap in one mission; motion is piecewise linear between arrivals."""
    roster = random_roster(mission)
    start_m = np.array([(e.start_x_m, e.start_y_m) for e in roster])
    way_m = np.array([(e.target_x_m, e.target_y_m) for e in roster]) - start_m
    flight_s = np.hypot(way_m[:, 0], way_m[:, 1]) / mission.v_max_mps
    times_s = np.concatenate([[0.0], np.sort(flight_s)])
    share = np.minimum(times_s[:, None] / flight_s, 1.0)
    at_m = start_m + share[..., None] * way_m
    met = encounters(at_m[:-1], at_m[1:], np.full(len(roster), mission.r_m), -1e-9)
    return len(set(zip(met.first.tolist(), met.second.tolist(), strict=True)))


def mean_count(**fields: float) -> float:
    """Mean over the seeds."""
    return float(np.mean([overlapping_pairs(Mission(seed=seed, **fields)) for seed in SEEDS]))  # type: ignore[arg-type]


@pytest.mark.parametrize(("uavs", "expected"), BY_UAVS.items())
def test_collisions_by_number_of_uavs(uavs: int, expected: float) -> None:
    """Fig. 4a: 10 000 m2, r 5 m."""
    assert mean_count(uavs=uavs) == pytest.approx(expected, abs=1)


@pytest.mark.parametrize(("area_m2", "expected"), BY_AREA_M2.items())
def test_collisions_by_area(area_m2: float, expected: float) -> None:
    """Fig. 4b: 50 UAVs, r 5 m."""
    assert mean_count(uavs=50, area_m2=area_m2) == pytest.approx(expected, abs=1)


@pytest.mark.parametrize(("r_m", "expected"), BY_RADIUS_M.items())
def test_collisions_by_gps_error(r_m: float, expected: float) -> None:
    """Fig. 4c: 50 UAVs, 40 000 m2."""
    assert mean_count(uavs=50, area_m2=40_000, r_m=r_m) == pytest.approx(expected, abs=1)
