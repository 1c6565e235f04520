"""The flight of a vehicle with inertia in one slot, at the samples of its path.

`_stepped` flies it step by step of the controller (`mission.control_loop` has the equations). Without saturation the
flight is linear in what it begins with, so `flight` adds up responses to inputs of size 1, which `_stepped` itself has
flown: that takes a tenth of the time. It flies step by step if the commands could reach the limit.

Vectors are complex numbers, x + i y. Every UAV process imports this module, so it does not import numpy.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

from edc_swarm.mission.control_loop import LoopStep, loop_step
from edc_swarm.mission.vehicle_model import VehicleModel

Vectors = tuple[complex, complex, complex, complex, complex, complex, complex, complex]
Sample = tuple[complex, complex, complex]
"""Estimated position beside the reference, velocity, and acceleration by the motors."""


@dataclass(frozen=True, slots=True)
class _Responses:
    """Answers to each of the eight inputs: of every sample, (3, 8); and the largest one of the command, (8)."""

    samples: list[list[list[float]]]
    command: list[float]


def flight(vehicle: VehicleModel, dt_s: float, given: Vectors, limit_mps2: float) -> tuple[list[Sample], bool]:
    """Return the samples after the start, and True if the command was more than `limit_mps2`.

    `given` has, at the start of the slot, the estimated position less that of the reference, velocity and acceleration;
    the velocity of the reference and its acceleration in the slot; the speed of the estimate's error; and in the first
    step of the controller the wind, with its change from step to step.
    """
    answers = _responses(vehicle, dt_s)
    y, v, a, rv, ra, shift, wind, dwind = given
    dv = v - rv  # A vehicle that follows its reference has little of it.
    cy, cv, ca, crv, cra, cs, cw, cd = answers.command
    most_mps2 = (
        cy * abs(y)
        + cv * abs(dv)
        + ca * abs(a)
        + crv * abs(rv)
        + cra * abs(ra)
        + cs * abs(shift)
        + cw * abs(wind)
        + cd * abs(dwind)
    )
    if most_mps2 >= limit_mps2:
        samples, command_mps2 = _stepped(vehicle, loop_step(vehicle.lag_s, vehicle.drag_per_s, dt_s), given, limit_mps2)
        return samples, max(command_mps2) > limit_mps2
    found = []
    for rows in answers.samples:
        ((ay, av, aa, arv, ara, s, w, d), (by, bv, ba, brv, bra, t, x, e), (gy, gv, ga, grv, gra, u, z, f)) = rows
        found.append(
            (
                ay * y + av * dv + aa * a + arv * rv + ara * ra + s * shift + w * wind + d * dwind,
                by * y + bv * dv + ba * a + brv * rv + bra * ra + t * shift + x * wind + e * dwind,
                gy * y + gv * dv + ga * a + grv * rv + gra * ra + u * shift + z * wind + f * dwind,
            )
        )
    return found, False


@cache
def _responses(vehicle: VehicleModel, dt_s: float) -> _Responses:
    step, each, command = loop_step(vehicle.lag_s, vehicle.drag_per_s, dt_s), [], []
    for index in range(8):
        y, dv, a, rv, ra, shift, wind, dwind = (complex(index == place) for place in range(8))
        samples, commands = _stepped(vehicle, step, (y, rv + dv, a, rv, ra, shift, wind, dwind), math.inf)
        each.append(samples)
        command.append(max(commands))
    rows = [
        [[each[index][sample][row].real for index in range(8)] for row in range(3)] for sample in range(step.samples)
    ]
    return _Responses(rows, command)


def _stepped(
    vehicle: VehicleModel, step: LoopStep, given: Vectors, limit_mps2: float
) -> tuple[list[Sample], list[float]]:
    """Return the samples after the start, and the size of each command before it was cut to the limit."""
    xv, xa, xc, xw, vv, va, vc, vw = step.xv, step.xa, step.xc, step.xw, step.vv, step.va, step.vc, step.vw
    aa, ac, h = step.aa, 1.0 - step.aa, step.step_s
    kp, kv, drag = vehicle.position_gain_per_s, vehicle.velocity_gain_per_s, vehicle.drag_per_s
    y, v, a, ref_v, ref_a, shift, wind, dwind = given
    samples, sizes = list[Sample](), list[float]()
    for _ in range(step.samples):
        for _ in range(step.steps // step.samples):
            command = ref_a + kv * (ref_v - v - kp * y) + drag * (v - wind)
            size = abs(command)
            sizes.append(size)
            if size > limit_mps2:
                command *= limit_mps2 / size
            y += xv * v + xa * a + xc * command + xw * wind + (shift - ref_v - 0.5 * h * ref_a) * h
            v = vv * v + va * a + vc * command + vw * wind
            a = aa * a + ac * command
            ref_v += h * ref_a
            wind += dwind
        samples.append((y, v, a))
    return samples, sizes
