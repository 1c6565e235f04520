"""Energy of flight and computation: propulsion power, processor time of a head.

Reference: Y. Zeng, J. Xu, R. Zhang, "Energy Minimization for Wireless Communication With
Rotary-Wing UAV", IEEE Trans. Wireless Commun. 18(4), 2019, eq. 12. Hovering costs more than slow
cruising, so a hold is not free.

Every UAV process imports this module, so it does not import numpy.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from edc_swarm.errors import MissionError
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.power_models import EnergyModel, HeadModel
from edc_swarm.mission.roster_entry import ARRIVED_M, RosterEntry
from edc_swarm.mission.routes import hover_time_s
from edc_swarm.mission.vehicle_model import GRAVITY_MPS2

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


def propulsion_power_w(speed_mps: float, model: EnergyModel) -> float:
    """Return the power, in watts, of level flight at a constant speed (0 = hover)."""
    power_w: float = _power_w(speed_mps, model)
    return power_w


def flight_power_w(air_speed_mps: float, acceleration_mps2: float, model: EnergyModel) -> float:
    """Return the power, in watts, of level flight while the motors accelerate the vehicle horizontally.

    They then lift and push with kappa = sqrt(1 + (a / g)^2) times the weight, and the induced power grows to
    P_i kappa sqrt(sqrt(kappa^2 + a_v^2) - a_v), with a_v = V^2 / (2 v0^2) (Zeng, Xu, Zhang 2019; eq. 12 is its case
    kappa = 1). V is the air speed. The model leaves out climbing, and what the tilt changes in the inflow.
    """
    a = air_speed_mps * air_speed_mps / (2 * model.induced_velocity_mps**2)
    kappa2 = 1.0 + (acceleration_mps2 / GRAVITY_MPS2) ** 2
    plain_w = model.induced_w / math.sqrt(math.sqrt(1 + a * a) + a)
    induced_w = model.induced_w * kappa2 / math.sqrt(math.sqrt(kappa2 + a * a) + a)
    return propulsion_power_w(air_speed_mps, model) - plain_w + induced_w


def propulsion_powers_w(speed_mps: NDArray[np.float64], model: EnergyModel) -> NDArray[np.float64]:
    """Return `propulsion_power_w` of an array of speeds, of any shape."""
    power_w: NDArray[np.float64] = _power_w(speed_mps, model)
    return power_w


def compute_energy_j(cpu_s: float, model: HeadModel) -> float:
    """Return the energy, in joules, that a head spends on `cpu_s` seconds of processor time."""
    return cpu_s * model.p_active_w


def check_batteries(mission: Mission) -> None:
    """Raise `MissionError` if a UAV's battery does not cover one step at full speed: it would never move."""
    for index, entry in enumerate(mission.roster):
        if entry.straight_m <= ARRIVED_M:
            continue
        length_m = min(mission.step_m(entry), entry.straight_m)
        least_j = step_energy_j(mission, length_m)
        if entry.energy_j < least_j:
            speed_mps = length_m / (mission.dt_s - 2 * mission.guard_s)
            raise MissionError(
                f"roster[{index}].energy_j",
                entry.energy_j,
                f"at least {least_j:.4g} J, which the first step of {entry.uav} takes "
                f"({propulsion_power_w(speed_mps, mission.energy):.4g} W at {speed_mps:g} m/s for a slot of "
                f"{mission.dt_s:g} s): it could never move",
            )


def stranded(mission: Mission) -> dict[str, float]:
    """Return the energy, in joules, of the straight flight at full speed, for each UAV whose battery has less."""
    needed_j = {entry.uav: full_speed_energy_j(mission, entry, ARRIVED_M) for entry in mission.roster}
    return {entry.uav: needed_j[entry.uav] for entry in mission.roster if entry.energy_j < needed_j[entry.uav]}


def full_speed_energy_j(mission: Mission, entry: RosterEntry, short_m: float = 0.0) -> float:
    """Return the energy, in joules, of a UAV's straight flight at its full speed, to `short_m` before the target.

    It hovers on its way where its route says so.
    """
    speed_mps = mission.speed_mps(entry)
    hover_j = propulsion_power_w(0.0, mission.energy) * hover_time_s(entry)
    return propulsion_power_w(speed_mps, mission.energy) * max(0.0, entry.straight_m - short_m) / speed_mps + hover_j


def step_energy_j(mission: Mission, length_m: float) -> float:
    """Return the propulsion energy, in joules, of one slot: `length_m` at constant speed between the slot's guards."""
    flown_s = mission.dt_s - 2 * mission.guard_s
    flying_j = propulsion_power_w(length_m / flown_s, mission.energy) * flown_s
    return flying_j + propulsion_power_w(0.0, mission.energy) * (mission.dt_s - flown_s)


def _power_w(speed_mps: Any, model: EnergyModel) -> Any:
    """Return P(V) of a number or an array.

    With a = V^2 / (2 v0^2), the induced term sqrt(sqrt(1 + a^2) - a) is written as its equal
    1 / sqrt(sqrt(1 + a^2) + a), which loses no digits at high speed.
    """
    squared = speed_mps * speed_mps
    a = squared / (2 * model.induced_velocity_mps**2)
    blade_w = model.blade_profile_w * (1 + 3 * squared / model.tip_speed_mps**2)
    induced_w = model.induced_w / ((1 + a * a) ** 0.5 + a) ** 0.5
    parasite = 0.5 * model.drag_ratio * model.air_density_kgpm3 * model.rotor_solidity * model.rotor_area_m2
    return blade_w + induced_w + parasite * squared * speed_mps
