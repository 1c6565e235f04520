"""RotorPy's vehicle, flown as `benchmarks/oracle.py` flies it, keeps to the bound of `hummingbird`."""

from __future__ import annotations

import importlib
from pathlib import Path
from random import Random
from types import ModuleType

import numpy as np
import pytest
from msgspec.structs import replace

from edc_swarm.mission.vehicle_model import SETS

pytest.importorskip("rotorpy", reason="needs RotorPy: pip install 'edc-swarm[oracle]'", exc_type=ImportError)
SLOTS = 8


@pytest.fixture
def oracle(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The benchmark as a module, for short flights."""
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    module = importlib.import_module("oracle")
    monkeypatch.setattr(module, "SLOTS", SLOTS)
    monkeypatch.setattr(module, "SETTLING_S", 0.0)
    return module


def test_another_vehicle_keeps_to_the_bound(oracle: ModuleType) -> None:
    """The worst steps in calm air: inside, but beyond the bound of a vehicle that lags half as much."""
    case = "calm, exact GPS"
    mission = oracle.mission_of(case)
    worst = oracle.flight_of(case, "worst", 0, next(oracle.KINDS["worst"](mission, Random(0))))
    most_m = float(np.max(oracle.deviations_m([worst], oracle.One(1))))
    assert 0.5 * worst.own_m <= most_m <= oracle.bound_m(mission)
    faster = replace(mission, vehicle=replace(mission.vehicle, lag_s=SETS["hummingbird"].lag_s / 2))
    assert most_m > oracle.bound_m(faster)
