"""A body with inertia: a point mass in the plane with limited acceleration, a lag, drag, and a controller.

`mission.control_loop` has the equations, `mission.vehicle_budget` the bound on the deviation that follows from them.
Here they fly: 100 times a second or more, the controller sets the acceleration for one exact step of the vehicle
(`slot_flight`).

In each slot the reference is the parabola of the quadratic B-spline of the waypoints (`vehicle_budget.step_change_m`).
The controller never sees the true position. It steers by an estimate, whose error changes in two ways. After a fix, the
filter moves the estimate in the course of the slot by `FILTER_SHARE` of its distance from the fix, at most at
`correction_mps`. Without GPS it drifts at `drift_mps`, in a direction that is random for each outage. In between the
inertial prediction is exact, as is the measured velocity.

Vectors are complex numbers, x + i y. Every UAV process imports this module, so it does not import numpy.
"""

from __future__ import annotations

import cmath
import math
import random

from edc_swarm.emulation.body import BodyState, Flown, Point
from edc_swarm.emulation.energy import flight_power_w
from edc_swarm.emulation.gps import Gps
from edc_swarm.emulation.slot_flight import flight
from edc_swarm.emulation.wind import Wind, gust_share
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.control_loop import loop_step
from edc_swarm.mission.faults import ChangeGps, Gust, VehicleFault, WeakMotor
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.mission.vehicle_budget import vehicle_of

FILTER_SHARE = 0.2
"""Share of the distance to a fix by which the filter moves the estimate within a slot."""
GROWN_LEAST_M = 1e-3
"""What is left of the growth of an outage counts as nothing below this."""
MOST_MISSED_SLOTS = 200
"""Most slots without a step that a body flies in one go: it rests by then."""


class Multirotor:
    """A body with inertia, from `state` on, or from rest at a waypoint."""

    def __init__(self, mission: Mission, entry: RosterEntry, at_m: Point, state: BodyState | None) -> None:
        self._dt_s = mission.dt_s
        self._energy = mission.energy
        self._vehicle = vehicle_of(mission, entry)
        self._step = loop_step(self._vehicle.lag_s, self._vehicle.drag_per_s, mission.dt_s)
        self._gps = Gps(mission, entry)
        self._seed = f"{mission.seed}/{entry.uav}"
        self._wind = Wind(mission.wind, mission.speed_mps(entry), mission.dt_s, f"{self._seed}/wind")
        self._gust: Gust | None = None
        self._weak: WeakMotor | None = None
        self.state = state if state is not None else self._first_state(at_m)
        position_m, error_m = _vector(self.state.position_m), _vector(self.state.error_m)
        self.standing = Flown(self.state.position_m, self.state.position_m, [], _point(position_m + error_m), 0.0)

    def _first_state(self, at_m: Point) -> BodyState:
        """Return the state at rest, trimmed for the mean wind; the estimate is at the waypoint, as the first fix is."""
        offset_m = self._gps.true_offset_m
        return BodyState(
            before_m=at_m,
            at_m=at_m,
            position_m=(at_m[0] + offset_m[0], at_m[1] + offset_m[1]),
            acceleration_mps2=_point(-self._vehicle.drag_per_s * self._wind.mean_mps),
            error_m=(-offset_m[0], -offset_m[1]),
        )

    def disturb(self, fault: VehicleFault) -> None:
        """Let a fault act from the next slot on."""
        match fault:
            case ChangeGps():
                self._gps.change(fault)
            case Gust():
                self._gust = fault
            case WeakMotor():
                self._weak = fault

    @property
    def next_measured_m(self) -> Point:
        """Position of the next fix if the error stays."""
        return _point(_vector(self.state.position_m) + _vector(self._gps.error_m))

    def brake(self, slot: int, from_m: Point, to_m: Point) -> None:
        """Fly the step of a `slot` for which the process did not run."""
        self._fly(slot, from_m, to_m)

    def fly(self, slot: int, from_m: Point, to_m: Point) -> Flown:
        """Fly the step of `slot`; in slots that were missed it held at `from_m`."""
        for missed in range(max(self.state.slot + 1, slot - MOST_MISSED_SLOTS), slot):
            self._fly(missed, from_m, from_m)
        return self._fly(slot, from_m, to_m)

    def _fly(self, slot: int, from_m: Point, to_m: Point) -> Flown:
        state, dt_s = self.state, self._dt_s
        before, here, there = _vector(state.before_m), _vector(from_m), _vector(to_m)
        if state.at_m != from_m:  # The UAV lost its memory or its step: the reference starts anew at its waypoint.
            before = here
        shift, grown_m, measured_m = self._measured(slot)
        turbulence = self._wind.after_slot(state.turbulence, slot)
        winds = (
            self._wind.of(state.turbulence) + self._gust_at(slot * dt_s),
            self._wind.of(turbulence) + self._gust_at((slot + 1) * dt_s),
        )
        reference = ((before + here) / 2, (here - before) / dt_s, (there - 2 * here + before) / dt_s**2)
        samples, saturated = self._flight(reference, shift / dt_s, winds, self._limit_mps2(slot))
        x, v, a, _ = samples[-1]
        self.state = BodyState(
            slot=slot,
            before_m=from_m,
            at_m=to_m,
            position_m=_point(x),
            velocity_mps=_point(v),
            acceleration_mps2=_point(a),
            error_m=_point(_vector(state.error_m) + shift),
            turbulence=turbulence,
            grown_m=grown_m,
        )
        return Flown(
            state.position_m,
            _point(x),
            [_point(sample[0]) for sample in samples[1:-1]],
            measured_m,
            self._propulsion_j(samples),
            max(state.grown_m, grown_m),
            saturated,
        )

    def _measured(self, slot: int) -> tuple[complex, float, Point]:
        """Return the motion of the estimate's error in the slot, the growth at its end, and the position of its fix."""
        state, vehicle = self.state, self._vehicle
        position, error = _vector(state.position_m), _vector(state.error_m)
        measured = self._gps.next_error_m(slot)
        if measured is None:
            drift_m = vehicle.drift_mps * self._dt_s
            return cmath.rect(drift_m, self._drift_rad()), state.grown_m + drift_m, _point(position + error)
        apart = _vector(measured) - error
        length_m = min(FILTER_SHARE * abs(apart), vehicle.correction_mps * self._dt_s)
        share = length_m / abs(apart) if apart else 1.0
        grown_m = state.grown_m * (1 - share)
        return share * apart, grown_m if grown_m > GROWN_LEAST_M else 0.0, _point(position + _vector(measured))

    def _drift_rad(self) -> float:
        """Return the direction of the drift, which is drawn for each outage."""
        return random.Random(f"{self._seed}/drift/{self._gps.outage_since_s}").uniform(0.0, math.tau)

    def _gust_at(self, time_s: float) -> complex:
        """Return the wind of the fault's gust; its direction is drawn for each gust."""
        gust = self._gust
        if gust is None or not gust.speed_mps:
            return 0j
        share = gust_share(time_s - gust.at_s, gust.end_s - time_s)
        angle_rad = random.Random(f"{self._seed}/gust/{gust.at_s}").uniform(0.0, math.tau)
        return cmath.rect(share * gust.speed_mps, angle_rad)

    def _limit_mps2(self, slot: int) -> float:
        weak = self._weak
        if weak is None or slot * self._dt_s >= weak.end_s - 1e-9:
            return self._vehicle.limit_mps2
        return self._vehicle.limit_mps2 * weak.share

    def _flight(
        self,
        reference: tuple[complex, complex, complex],
        shift_mps: complex,
        winds: tuple[complex, complex],
        limit: float,
    ) -> tuple[list[tuple[complex, complex, complex, complex]], bool]:
        """Return position, velocity, acceleration by the motors and air velocity at the samples, from the start on.

        The second value is True if the command was more than `limit`.
        """
        state, step = self.state, self._step
        x, v, a, error = map(_vector, (state.position_m, state.velocity_mps, state.acceleration_mps2, state.error_m))
        ref_x, ref_v, ref_a = reference
        wind, dwind = winds[0], (winds[1] - winds[0]) / step.steps
        given = (x + error - ref_x, v, a, ref_v, ref_a, shift_mps, wind + 0.5 * dwind, dwind)
        found, saturated = flight(self._vehicle, self._dt_s, given, limit)
        samples = [(x, v, a, v - wind)]
        for number, (y, v, a) in enumerate(found, 1):
            share = number / step.samples
            time_s = share * self._dt_s
            x = y - error - shift_mps * time_s + ref_x + ref_v * time_s + 0.5 * ref_a * time_s**2
            samples.append((x, v, a, v - wind - share * (winds[1] - wind)))
        return samples, saturated

    def _propulsion_j(self, samples: list[tuple[complex, complex, complex, complex]]) -> float:
        """Return the energy of the slot by the trapezoidal rule."""
        powers_w = [flight_power_w(abs(air), abs(a), self._energy) for _, _, a, air in samples]
        mean_w = (sum(powers_w) - 0.5 * (powers_w[0] + powers_w[-1])) / (len(powers_w) - 1)
        return mean_w * self._dt_s


def _vector(point: Point) -> complex:
    return complex(*point)


def _point(vector: complex) -> Point:
    return vector.real, vector.imag
