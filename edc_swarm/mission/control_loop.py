"""The closed loop of a multirotor and its controller, as exact difference equations, and what bounds follow from it.

The vehicle is a point mass in the plane with x' = v, v' = a - k (v - w), a' = (c - a) / T: drag k, wind w, and an
acceleration a that follows the command c with the lag T. The controller works at 100 Hz or faster; between two of its
steps c and w are constant, so the step of the vehicle is exact. It is a cascade: a speed towards the reference for
each metre of deviation, an acceleration for each m/s of deviation, plus the acceleration of the reference, less the
acceleration a' - a that the inertial unit feels and the motors did not cause (the incremental form of E. Smeur, Q. Chu,
G. de Croon, "Adaptive Incremental Nonlinear Dynamic Inversion", J. Guidance, Control, and Dynamics 39(3), 2016).

The axes do not couple and all coefficients are real, so one axis is enough here, and the flight itself
(`emulation.multirotor`) takes complex numbers x + i y. This module does not import numpy, since UAV processes use it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, partial
from itertools import accumulate

from edc_swarm.mission.vehicle_model import VehicleModel

STEP_S = 0.01
"""Longest step of the controller, which is 100 Hz or faster."""
SAMPLE_S = 0.1
"""Longest time between two samples of the true path."""
SETTLED = 1e-9
"""A response is over when what is left of it is smaller than this."""
MOST_SETTLING_S = 60.0
"""Longest time in which a controller must settle."""
_SQUARINGS = 8
_TERMS = 12


@dataclass(frozen=True, slots=True)
class LoopStep:
    """One step of the vehicle with constant command c and wind w: coefficients of its state (x, v, a).

    x becomes x + `xv` v + `xa` a + `xc` c + `xw` w, v becomes `vv` v + `va` a + `vc` c + `vw` w, and a becomes
    `aa` a + (1 - `aa`) c. `steps` of them, each of `step_s`, make a slot, which has `samples` samples of the path.
    """

    samples: int
    steps: int
    step_s: float
    xv: float
    xa: float
    xc: float
    xw: float
    vv: float
    va: float
    vc: float
    vw: float
    aa: float


@dataclass(frozen=True, slots=True)
class Response:
    """Largest effect of an input of size 1, of any course, on the deviation (m), its speed and the command."""

    deviation: float
    speed: float
    command: float


@dataclass(frozen=True, slots=True)
class LoopBounds:
    """Responses of the closed loop, each to one of its inputs.

    Attributes
    ----------
    acceleration
        To the acceleration of the reference, which is constant in each slot. The command is without the drag at the
        speed of the reference.
    gust
        To the wind beside its mean.
    correction
        To the speed of the error of the estimated position, constant in each slot. The deviation is that from the
        reference less this error.
    overshoot
        Largest deviation by an error of the estimated position of size 1, of any course, less 1.
    """

    acceleration: Response
    gust: Response
    correction: Response
    overshoot: float


@cache
def loop_step(lag_s: float, drag_per_s: float, dt_s: float) -> LoopStep:
    """Return the exact step of a vehicle in slots of `dt_s`."""
    samples = math.ceil(dt_s / SAMPLE_S - 1e-9)
    steps = samples * math.ceil(dt_s / samples / STEP_S - 1e-9)
    step_s = dt_s / steps
    rates = [[0.0] * 5 for _ in range(5)]  # Of x, v, a, c, w: the last two are constant.
    rates[0][1] = 1.0
    rates[1][1:] = [-drag_per_s, 1.0, 0.0, drag_per_s]
    rates[2][2:4] = [-1.0 / lag_s, 1.0 / lag_s]
    moved, faster, lagged, *_ = _exponential(rates, step_s)
    _, xv, xa, xc, xw = moved
    _, vv, va, vc, vw = faster
    return LoopStep(samples, steps, step_s, xv, xa, xc, xw, vv, va, vc, vw, lagged[2])


@cache
def loop_bounds(vehicle: VehicleModel, dt_s: float) -> LoopBounds | None:
    """Return the responses of a vehicle's closed loop; None if it does not settle within a minute.

    A linear loop answers an input u with the sum of h_j u_(n-j) over its impulse response h. So of all inputs of size 1
    the one with the signs of h has the largest answer, the sum of |h_j| (the peak gain, e.g. S. Boyd, C. Barratt,
    "Linear Controller Design", 1991, section 5.2.3). For an input that is constant in each slot the sums of h over
    slots take the place of h_j. In the plane the same holds for vectors of size 1, by the triangle inequality.
    Responses hold at the controller's steps; `speed` bounds what happens between them.
    """
    step = loop_step(vehicle.lag_s, vehicle.drag_per_s, dt_s)
    acceleration = _impulse(vehicle, step, acceleration=1.0)
    gust = _impulse(vehicle, step, gust=1.0)
    correction = _impulse(vehicle, step, correction=1.0)
    error = _impulse(vehicle, step, error=1.0)
    if acceleration is None or gust is None or correction is None or error is None:
        return None
    per_slot = partial(_peak_per_slot, steps=step.steps)
    return LoopBounds(
        Response(*map(per_slot, acceleration)),
        Response(*map(_peak, gust)),
        Response(*map(per_slot, correction)),
        max(0.0, _peak(error[0]) - 1.0),
    )


def worst_turns(vehicle: VehicleModel, dt_s: float) -> list[int]:
    """Return the signs of the accelerations of consecutive slots, largest in size, that make the deviation largest.

    The deviation is largest at the end of the last slot. The list is empty if the loop does not settle.
    """
    step = loop_step(vehicle.lag_s, vehicle.drag_per_s, dt_s)
    responses = _impulse(vehicle, step, acceleration=1.0)
    if responses is None:
        return []
    slots = [math.fsum(responses[0][begin : begin + step.steps]) for begin in range(0, len(responses[0]), step.steps)]
    return [1 if each > 0 else -1 for each in reversed(slots)]


def worst_gusts(vehicle: VehicleModel, dt_s: float) -> list[int]:
    """Return the signs of the gusts in consecutive steps of the controller that make the deviation largest.

    The deviation is largest at the end of the last step. The list is empty if the loop does not settle.
    """
    responses = _impulse(vehicle, loop_step(vehicle.lag_s, vehicle.drag_per_s, dt_s), gust=1.0)
    return [] if responses is None else [1 if each > 0 else -1 for each in reversed(responses[0])]


def _impulse(
    vehicle: VehicleModel,
    step: LoopStep,
    acceleration: float = 0.0,
    gust: float = 0.0,
    correction: float = 0.0,
    error: float = 0.0,
) -> tuple[list[float], list[float], list[float]] | None:
    """Return deviation, its speed and the command after each step, for inputs in the first step; None without end.

    The reference is at 0 with speed 0 before. Each input lasts for one step: the `acceleration` of the reference, the
    wind, the speed of the estimate's error (`correction`), or that error itself. A steady speed of the reference or a
    steady error remains, so the responses are those of what is beside it.
    """
    kp, kv, k = vehicle.position_gain_per_s, vehicle.velocity_gain_per_s, vehicle.drag_per_s
    h, x, v, a, ref_x, ref_v, offset = step.step_s, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    deviations, speeds, commands = list[float](), list[float](), list[float]()
    for count in range(round(MOST_SETTLING_S / h)):
        ref_a, w, e = (acceleration, gust, error) if count == 0 else (0.0, 0.0, 0.0)
        command = ref_a + kv * (ref_v - v + kp * (ref_x - x - offset - e)) + k * (v - w)
        commands.append(command - k * ref_v)
        x += step.xv * v + step.xa * a + step.xc * command + step.xw * w
        v = step.vv * v + step.va * a + step.vc * command + step.vw * w
        a = step.aa * a + (1.0 - step.aa) * command
        ref_x += ref_v * h + 0.5 * ref_a * h * h
        ref_v += ref_a * h
        offset += correction * h if count == 0 else 0.0
        deviations.append(x + offset - ref_x)
        speeds.append(v - ref_v)
        if count and max(map(abs, (deviations[-1], speeds[-1], a - k * ref_v))) < SETTLED * h:
            return deviations, speeds, commands
    return None


def _peak(response: list[float]) -> float:
    return sum(map(abs, response))


def _peak_per_slot(response: list[float], steps: int) -> float:
    """Return the largest answer to an input that is constant in each slot, at the worst time within a slot."""
    sums = [0.0, *accumulate(response)]
    sums += [sums[-1]] * steps
    return max(
        abs(sums[phase]) + sum(abs(sums[end + steps] - sums[end]) for end in range(phase, len(response), steps))
        for phase in range(1, steps + 1)
    )


def _exponential(rates: list[list[float]], time_s: float) -> list[list[float]]:
    """Return the matrix exponential of `rates` times `time_s`, by Taylor's series and repeated squaring."""
    size = range(len(rates))
    small = [[rate * time_s / 2**_SQUARINGS for rate in row] for row in rates]
    total = [[float(i == j) for j in size] for i in size]
    for term in range(_TERMS, 0, -1):
        product = _product(small, total)
        total = [[float(i == j) + product[i][j] / term for j in size] for i in size]
    for _ in range(_SQUARINGS):
        total = _product(total, total)
    return total


def _product(left: list[list[float]], right: list[list[float]]) -> list[list[float]]:
    columns = list(zip(*right, strict=True))
    return [[math.fsum(a * b for a, b in zip(row, column, strict=True)) for column in columns] for row in left]
