"""The flight of UAVs: table `[vehicle]` of a mission, and the named parameter sets."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import msgspec
from msgspec import Meta, Struct

from edc_swarm.mission.field_types import NonNegative, Option

VehicleName = Literal["ideal", "multirotor", "arducopter", "hummingbird", "crazyflie", "m100", "mavlink"]
OwnVehicle = Literal["", VehicleName]
IDEAL = "ideal"
MAVLINK = "mavlink"
OF_AUTOPILOTS = ("autopilot", "altitude_m", "takeoff_s", "free_mps", "at_end")
"""Fields that count for autopilots alone."""
FIGURES = (
    "a_max_mps2",
    "tilt_deg",
    "lag_s",
    "drag_per_s",
    "position_gain_per_s",
    "velocity_gain_per_s",
    "correction_mps",
    "drift_mps",
)
"""Fields that a parameter set fills in."""
GRAVITY_MPS2 = 9.81
AtEnd = Literal["land", "return"]
Tilt = Annotated[float, Meta(ge=0, le=80)]
Rate = Annotated[float, Meta(ge=0, le=50)]


class VehicleModel(Struct, frozen=True, kw_only=True):
    """The vehicle of all UAVs that name none of their own: exact motion, or a multirotor with inertia.

    A figure that is left out has the value of the parameter set that `model` names (docs/vehicles.md). Inside it is 0
    then, so a mission may not state 0 (`validation.refuse_idle`).

    Source: the parameter set.
    """

    model: Annotated[VehicleName, Option("vehicle")] = "ideal"
    """Model of the vehicle: `ideal`, a multirotor by the name of its parameter set, or `mavlink`, an autopilot.

    `ideal` moves exactly along its step at constant speed, as in the paper. A multirotor flies a smooth curve
    between its waypoints with limited acceleration, an actuator that lags, drag, and a controller that steers by the
    measured position. `multirotor` has the figures of `arducopter`.

    Source: the paper, section II, for `ideal`.
    """
    a_max_mps2: Annotated[float, Meta(ge=0, le=100)] = 0.0
    """Largest acceleration of the planned motion.

    Consecutive steps differ by at most this times `dt_s` squared. It is less than what `tilt_deg` allows, since the
    controller and the wind need the rest; if they need more, it is lowered to what they leave.
    """
    tilt_deg: Tilt = 0.0
    """Largest tilt, which limits the horizontal acceleration to g tan(tilt)."""
    lag_s: NonNegative = 0.0
    """Time constant with which the acceleration follows the command: motors and attitude. At most a slot."""
    drag_per_s: NonNegative = 0.0
    """Drag: deceleration in m/s² for each m/s of air speed."""
    position_gain_per_s: Rate = 0.0
    """Gain of the position controller: speed towards the reference for each metre of deviation."""
    velocity_gain_per_s: Rate = 0.0
    """Gain of the velocity controller: acceleration for each m/s of deviation."""
    correction_mps: NonNegative = 0.0
    """Largest speed with which the filter moves the estimated position towards the GPS fix.

    Between fixes the estimate follows the inertial prediction. Source: this project.
    """
    drift_mps: NonNegative = 0.0
    """Largest drift of the estimated position without GPS, in metres for each second of an outage."""
    autopilot: Annotated[str, Meta(max_length=200), Option("autopilot")] = ""
    """Addresses of the autopilots that fly UAVs with `mavlink`: udpin:, udpout: or tcp:HOST:PORT, or a serial device.

    An expression in braces stands for a number; i is the place of the UAV in the roster, from 0 on:
    udpin:127.0.0.1:{14550+10*i} (docs/autopilots.md).

    Default: "", which stands for none.
    """
    altitude_m: Annotated[float, Meta(ge=0, le=1000)] = 0.0
    """Height above its home at which an autopilot flies."""
    takeoff_s: Annotated[float, Meta(ge=0, le=600)] = 0.0
    """Time from the arming of autopilots to slot 0: who is not in the air by then does not fly."""
    free_mps: Annotated[float, Meta(ge=0, le=100)] = 0.0
    """Greatest speed of a vehicle whose autopilot no longer follows: a pilot flies it, or its own failsafe."""
    at_end: AtEnd = "land"
    """What an autopilot does at the end of the mission: `land` where it is, or `return` to its start first.

    With `return` the start is the last point of the route, so the planner keeps returning UAVs apart.

    Source: this project.
    """
    tracking_m: NonNegative = 0.0
    """Tracking bound: largest distance of the vehicle from its reference without a GPS error.

    Default: 0, which stands for the bound computed from the fields above (docs/vehicles.md).
    """

    @property
    def is_ideal(self) -> bool:
        """True if the vehicle moves exactly as commanded."""
        return self.model == IDEAL

    @property
    def is_autopilot(self) -> bool:
        """True if an autopilot flies the vehicle."""
        return self.model == MAVLINK

    @property
    def limit_mps2(self) -> float:
        """Largest horizontal acceleration that the largest tilt allows at constant height, g tan(tilt)."""
        return GRAVITY_MPS2 * math.tan(math.radians(self.tilt_deg))


ARDUCOPTER = VehicleModel(
    model="arducopter",
    a_max_mps2=2.5,
    tilt_deg=30.0,
    lag_s=0.15,
    drag_per_s=0.1,
    position_gain_per_s=1.0,
    velocity_gain_per_s=2.0,
    correction_mps=0.3,
    drift_mps=0.2,
)
"""ArduCopter 4.6 with its defaults.

WPNAV_ACCEL 250 cm/s², ANGLE_MAX 30°, ATC_INPUT_TC 0.15 s, PSC_POSXY_P 1, PSC_VELXY_P 2. Linear drag as in M. Kamel
and others, "Model Predictive Control for Trajectory Tracking of Unmanned Aerial Vehicles Using Robot Operating System",
2017. Filter and drift are this project's: the drift is that of the first seconds without GPS.
"""
HUMMINGBIRD = VehicleModel(
    model="hummingbird",
    a_max_mps2=3.0,
    tilt_deg=45.0,
    lag_s=0.14,
    drag_per_s=0.45,
    position_gain_per_s=1.6,
    velocity_gain_per_s=4.0,
    correction_mps=0.3,
    drift_mps=0.2,
)
"""AscTec Hummingbird as in RotorPy (S. Folk, J. Paulos, V. Kumar, arXiv 2306.04485, 2023).

Mass 0.5 kg; four rotors at 469 rad/s in hover with a rotor drag of 1.19e-4 kg: 0.45 per second. Attitude gains 544 and
46.6 are two poles at 23 per second, with the rotors 0.09 s. The model leaves out that their torque goes by the sine of
the error, and forces along the body's axis in wind: 0.14 s instead. Position gains 6.5 and 4: 1.6 and 4 in cascade.
`a_max_mps2` and tilt are this project's: with 5 m/s² and 60° the controller asks for more than RotorPy's vehicle can
follow in wind (`benchmarks/oracle.py`).
"""
CRAZYFLIE = VehicleModel(
    model="crazyflie",
    a_max_mps2=2.0,
    tilt_deg=30.0,
    lag_s=0.26,
    drag_per_s=0.25,
    position_gain_per_s=0.7,
    velocity_gain_per_s=1.5,
    correction_mps=0.3,
    drift_mps=0.2,
)
"""Bitcraze Crazyflie 2.0 as in RotorPy; drag by J. Förster, "System Identification of the Crazyflie 2.0 Nano
Quadrocopter", ETH Zurich, 2015.

Mass 0.03 kg; four rotors at 1788 rad/s in hover with a rotor drag of 1.03e-6 kg: 0.25 per second. Attitude gains 310
and 57 lag by 57 / 310 = 0.18 s, motors by 0.072 s: 0.26 s. Such a lag does not bear RotorPy's gains of the position, so
gains, `a_max_mps2` and tilt are this project's.
"""
M100 = VehicleModel(
    model="m100",
    a_max_mps2=2.0,
    tilt_deg=28.0,
    lag_s=0.27,
    drag_per_s=0.1,
    position_gain_per_s=0.7,
    velocity_gain_per_s=1.5,
    correction_mps=0.3,
    drift_mps=0.2,
)
"""DJI Matrice 100 as ETH Zurich flew one: attitude lags by 0.253 s (roll) and 0.267 s (pitch), tilt is at most 28°.

I. Sa, M. Kamel and others, arXiv 1701.08623, 2017; the figures are those of `nonlinear_mpc_50hz.yaml` for their DJI
vehicle `raven` (2.9 kg) in the repository ethz-asl/mav_dji_ros_interface. They state a drag of 0.01 per second, which
is next to none: drag is that of `arducopter` instead, which makes wind and its bound larger. They fly a predictive
controller; gains and `a_max_mps2` are this project's, since such a lag does not bear ArduCopter's.
"""
AUTOPILOT = msgspec.structs.replace(ARDUCOPTER, model="mavlink", altitude_m=5.0, takeoff_s=20.0, free_mps=10.0)
"""What a plan assumes of an autopilot: ArduCopter's figures. Its WPNAV_SPEED is 10 m/s, its take-off takes 10 s."""
SETS: dict[str, VehicleModel] = {
    "multirotor": ARDUCOPTER,
    "arducopter": ARDUCOPTER,
    "hummingbird": HUMMINGBIRD,
    "crazyflie": CRAZYFLIE,
    "m100": M100,
    "mavlink": AUTOPILOT,
}
"""Parameter sets by the name that `model` has."""
