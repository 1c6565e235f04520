"""What flying and thinking cost: propulsion power, head computation.

Reference: Y. Zeng, J. Xu, R. Zhang, "Energy Minimization for Wireless Communication With
Rotary-Wing UAV", IEEE Trans. Wireless Commun. 18(4), 2019, eq. 12. Hovering costs more than slow
cruising, so waiting is not free.

Every UAV process imports this module, so it does not import numpy.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from edc_swarm.config import EnergyModel, HeadModel

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


def propulsion_power_w(speed_mps: float, model: EnergyModel) -> float:
    """Power, in watts, of level flight at a constant speed (0 = hover)."""
    power_w: float = _power_w(speed_mps, model)
    return power_w


def propulsion_powers_w(speed_mps: NDArray[np.float64], model: EnergyModel) -> NDArray[np.float64]:
    """`propulsion_power_w` of an array of speeds, of any shape."""
    power_w: NDArray[np.float64] = _power_w(speed_mps, model)
    return power_w


def compute_energy_j(cpu_s: float, model: HeadModel) -> float:
    """Energy, in joules, that a head spends on `cpu_s` seconds of processor time."""
    return cpu_s * model.p_active_w


def _power_w(speed_mps: Any, model: EnergyModel) -> Any:
    """P(V) of a number or an array.

    With a = V^2 / (2 v0^2), the induced term sqrt(sqrt(1 + a^2) - a) is written as its equal
    1 / sqrt(sqrt(1 + a^2) + a), which loses no digits at high speed.
    """
    squared = speed_mps * speed_mps
    a = squared / (2 * model.induced_velocity_mps**2)
    blade_w = model.blade_profile_w * (1 + 3 * squared / model.tip_speed_mps**2)
    induced_w = model.induced_w / ((1 + a * a) ** 0.5 + a) ** 0.5
    parasite = 0.5 * model.drag_ratio * model.air_density_kgpm3 * model.rotor_solidity * model.rotor_area_m2
    return blade_w + induced_w + parasite * squared * speed_mps
