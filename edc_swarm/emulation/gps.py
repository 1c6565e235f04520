"""GPS error models: the difference of a UAV's reported and true positions.

The roster start is the first reported position, hence the centre of the tracked disc; the true
start lies anywhere in the disc (uniformly, as in the paper's section II). The error of every fix
stays within the GPS error bound `gps_m`, so the disc always contains the whole vehicle.

Every UAV process imports this module, so it does not import numpy.
"""

from __future__ import annotations

import math
import random
from typing import assert_never

from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.faults import OUTAGE, ChangeGps
from edc_swarm.mission.field_types import GpsModel
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.mission.vehicle_budget import gps_bound_m

CORRELATION_S = 30.0
"""Time constant of the `gauss-markov` model."""


class Gps:
    """The GPS of one UAV, slot by slot: the mission's error model, or that of a fault while it lasts."""

    def __init__(self, mission: Mission, entry: RosterEntry) -> None:
        self._mission = mission
        self._entry = entry
        self._receiver = self._new_receiver(mission.gps_model, "gps")
        self._fault: ChangeGps | None = None

    @property
    def true_offset_m(self) -> tuple[float, float]:
        """True start minus roster start; defined only before the first fix."""
        return self._receiver.true_offset_m

    @property
    def error_m(self) -> tuple[float, float]:
        """Reported minus true position of the newest fix."""
        return self._receiver.error_m

    @property
    def outage_since_s(self) -> float:
        """Mission time at which the outage began that lasts now."""
        assert self._fault is not None
        return self._fault.at_s

    def change(self, fault: ChangeGps) -> None:
        """Err as `fault` says from the next fix on; of faults that overlap the last one counts."""
        self._fault = fault
        if fault.model != OUTAGE:
            self._receiver = self._new_receiver(fault.model, f"gps-{fault.model}")

    def next_error_m(self, slot: int) -> tuple[float, float] | None:
        """Return reported minus true position of the fix of `slot`; None in an outage."""
        if self._fault is not None and slot * self._mission.dt_s >= self._fault.end_s - 1e-9:
            self._fault = None
            self._receiver = self._new_receiver(self._mission.gps_model, f"gps-{self._mission.gps_model}")
        return None if self._fault is not None and self._fault.model == OUTAGE else self._receiver.next_error_m()

    def _new_receiver(self, model: GpsModel, stream: str) -> GpsReceiver:
        seed = f"{self._mission.seed}/{self._entry.uav}/{stream}"
        return GpsReceiver(model, gps_bound_m(self._mission, self._entry), self._mission.dt_s, seed)


class GpsReceiver:
    """GPS receiver of one UAV, a state machine that depends on its arguments alone.

    Parameters
    ----------
    model
        `bias` (one constant error), `white` (each fix independent and uniform in the disc, as in the paper),
        `gauss-markov` (correlated over `CORRELATION_S`, clipped to the disc), or `none`.
    reach_m
        Largest error, `gps_m`.
    dt_s
        Mission time between two fixes.
    seed
        Text such as `"{mission seed}/{uav}/gps"`. A restarted receiver draws the same offset.
    """

    def __init__(self, model: GpsModel, reach_m: float, dt_s: float, seed: str) -> None:
        self._model = model
        self._reach_m = reach_m
        self._kept = math.exp(-dt_s / CORRELATION_S)
        self._random = random.Random(seed)
        self._fresh = True
        self._error_m = (0.0, 0.0) if model == "none" else self._in_disc()

    @property
    def true_offset_m(self) -> tuple[float, float]:
        """True start minus roster start; defined only before the first fix."""
        assert self._fresh, "the offset belongs to the start"
        x_m, y_m = self._error_m
        return -x_m, -y_m

    @property
    def error_m(self) -> tuple[float, float]:
        """Reported minus true position of the newest fix."""
        return self._error_m

    def next_error_m(self) -> tuple[float, float]:
        """Return reported minus true position of the next fix; the first one cancels the true offset."""
        if not self._fresh:
            self._error_m = self._advanced()
        self._fresh = False
        return self._error_m

    def _advanced(self) -> tuple[float, float]:
        match self._model:
            case "none" | "bias":
                return self._error_m
            case "white":
                return self._in_disc()
            case "gauss-markov":
                return self._correlated()
            case _:
                assert_never(self._model)

    def _in_disc(self) -> tuple[float, float]:
        angle = self._random.uniform(0.0, math.tau)
        radius_m = self._reach_m * math.sqrt(self._random.random())
        return radius_m * math.cos(angle), radius_m * math.sin(angle)

    def _correlated(self) -> tuple[float, float]:
        """Return a first-order Gauss-Markov step; each axis has the spread, reach / 2, of a uniform disc."""
        noise_m = 0.5 * self._reach_m * math.sqrt(1 - self._kept**2)
        x_m, y_m = (self._kept * e + noise_m * self._random.gauss(0.0, 1.0) for e in self._error_m)
        excess = max(1.0, math.hypot(x_m, y_m) / self._reach_m) if self._reach_m else 1.0
        return x_m / excess, y_m / excess
