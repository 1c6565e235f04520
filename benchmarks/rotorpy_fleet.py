"""Vehicles of RotorPy (S. Folk, J. Paulos, V. Kumar, arXiv 2306.04485), flown side by side for `benchmarks/oracle.py`.

Each is RotorPy's Hummingbird: a rigid body in space with four rotors that lag, drag of rotors and frame, and RotorPy's
own attitude controller. Commands are accelerations.
"""

from __future__ import annotations

import math
import sys
import types
import warnings
from importlib.util import find_spec
from typing import Protocol
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

HAS_TORCH = all(map(find_spec, ("torch", "torchdiffeq", "roma")))
with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # Of PyTorch, and of escapes that Python deprecates.
    from rotorpy.vehicles.hummingbird_params import quad_params
    from rotorpy.vehicles.multirotor import BatchedMultirotor, BatchedMultirotorParams
    from rotorpy.vehicles.multirotor import Multirotor as RotorPy

    with patch.dict(sys.modules, {} if HAS_TORCH else {"torch": types.ModuleType("torch")}):
        from rotorpy.wind.dryden_utils import DrydenWind  # It imports PyTorch, and uses it for other winds only.

Floats = NDArray[np.float64]
GRAVITY_MPS2 = np.array([0.0, 0.0, 9.81])
ATTITUDE_STEPS = 2
"""Steps of RotorPy's attitude controller in one step of the position controller: 200 a second."""


class Fleet(Protocol):
    """Vehicles of RotorPy, flown side by side. All vectors are (N, 3) in metres and seconds."""

    @property
    def position_m(self) -> Floats:
        """The positions."""

    def sense(self, wind_mps: Floats) -> tuple[Floats, Floats]:
        """Return velocities, and the accelerations that the inertial units feel and the rotors do not cause."""

    def fly(self, command_mps2: Floats, wind_mps: Floats, time_s: float) -> None:
        """Fly with a constant command of the acceleration, gravity included."""


def _hovering(count: int) -> dict[str, Floats]:
    rotor_speed = math.sqrt(quad_params["mass"] * 9.81 / (4 * quad_params["k_eta"]))
    one = {"x": [0.0] * 3, "v": [0.0] * 3, "q": [0.0, 0.0, 0.0, 1.0], "w": [0.0] * 3, "wind": [0.0] * 3}
    return {key: np.tile(value, (count, 1)) for key, value in {**one, "rotor_speeds": [rotor_speed] * 4}.items()}


def _thrust_mps2(q: Floats, rotor_speeds: Floats) -> Floats:
    """Return the acceleration that the rotors cause, along the body's axis."""
    i, j, k, w = q.T
    axis: Floats = np.stack([2 * (i * k + j * w), 2 * (j * k - i * w), 1 - 2 * (i * i + j * j)], axis=-1)
    size: Floats = quad_params["k_eta"] / quad_params["mass"] * (rotor_speeds**2).sum(axis=-1)
    return axis * size[:, None]


class One:
    """Vehicles one after another (`rotorpy.vehicles.multirotor.Multirotor`)."""

    def __init__(self, count: int) -> None:
        hovering = _hovering(count)
        self._states = [{key: value[n].copy() for key, value in hovering.items()} for n in range(count)]
        self._vehicle = RotorPy(quad_params, self._states[0], control_abstraction="cmd_acc")

    @property
    def position_m(self) -> Floats:
        return np.array([state["x"] for state in self._states])

    def sense(self, wind_mps: Floats) -> tuple[Floats, Floats]:
        v, q, rotors = (np.array([s[key] for s in self._states]) for key in ("v", "q", "rotor_speeds"))
        steady = {"cmd_acc": GRAVITY_MPS2}
        felt = [
            self._vehicle.statedot({**s, "wind": wind}, steady, 0.0)["vdot"] + GRAVITY_MPS2
            for s, wind in zip(self._states, wind_mps, strict=True)
        ]
        return v, np.array(felt) - _thrust_mps2(q, rotors)

    def fly(self, command_mps2: Floats, wind_mps: Floats, time_s: float) -> None:
        for _ in range(ATTITUDE_STEPS):
            self._states = [
                self._vehicle.step({**state, "wind": wind}, {"cmd_acc": command}, time_s / ATTITUDE_STEPS)
                for state, command, wind in zip(self._states, command_mps2, wind_mps, strict=True)
            ]


class Batch:
    """Vehicles all at once, in PyTorch (`rotorpy.vehicles.multirotor.BatchedMultirotor`)."""

    def __init__(self, count: int) -> None:
        import torch  # noqa: PLC0415

        torch.set_default_dtype(torch.float64)
        torch.set_num_threads(1)
        self._tensor, device = torch.tensor, torch.device("cpu")
        self._state = {key: torch.tensor(value) for key, value in _hovering(count).items()}
        parts = BatchedMultirotorParams([quad_params] * count, count, device)
        self._vehicles = BatchedMultirotor(parts, count, self._state, device, "cmd_acc", integrator="rk4")
        self._all = torch.arange(count)  # RotorPy indexes with it; a list is slower.

    @property
    def position_m(self) -> Floats:
        found: Floats = self._state["x"].numpy()
        return found

    def sense(self, wind_mps: Floats) -> tuple[Floats, Floats]:
        self._state["wind"] = self._tensor(wind_mps)
        v, q, rotors = (self._state[key].numpy() for key in ("v", "q", "rotor_speeds"))
        steady = {"cmd_acc": self._tensor(np.tile(GRAVITY_MPS2, (len(v), 1)))}
        felt = self._vehicles.statedot(self._state, steady, 0.0, self._all)["vdot"].numpy() + GRAVITY_MPS2
        return v, felt - _thrust_mps2(q, rotors)

    def fly(self, command_mps2: Floats, wind_mps: Floats, time_s: float) -> None:
        command = {"cmd_acc": self._tensor(command_mps2)}
        for _ in range(ATTITUDE_STEPS):  # Its Runge-Kutta method takes one step a call.
            self._state["wind"] = self._tensor(wind_mps)
            self._state = self._vehicles.step(self._state, command, time_s / ATTITUDE_STEPS, self._all)


def turbulence(intensity_mps: float, count: int, step_s: float, seed: int) -> Floats:
    """Return the (count, 3) speeds of RotorPy's Dryden turbulence in so many steps."""
    np.random.seed(seed)  # noqa: NPY002 - RotorPy draws from it.
    wind = DrydenWind(0.0, 0.0, 0.0, intensity_mps, intensity_mps, intensity_mps)
    return np.array([wind.getWind(step_s) for _ in range(count)])
