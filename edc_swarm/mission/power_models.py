"""Power of flying, of the radio and of leading: tables `[energy]` and `[head]` of a mission."""

from __future__ import annotations

from msgspec import Struct

from edc_swarm.mission.field_types import NonNegative, Positive


class EnergyModel(Struct, frozen=True, kw_only=True):
    """Rotary-wing propulsion power, radio energy, and the batteries of random missions.

    P(V) = P0 (1 + 3 V^2 / U_tip^2) + Pi sqrt(sqrt(1 + V^4 / (4 v0^4)) - V^2 / (2 v0^2))
    + d0 rho s A V^3 / 2, from Y. Zeng, J. Xu, R. Zhang, "Energy Minimization for Wireless
    Communication With Rotary-Wing UAV", IEEE Trans. Wireless Commun. 18(4), 2019, eq. 12.

    Source: Zeng, Xu, Zhang 2019, eq. 12.
    """

    blade_profile_w: Positive = 79.86
    """Blade profile power in hover, P0."""
    induced_w: Positive = 88.63
    """Induced power in hover, Pi."""
    tip_speed_mps: Positive = 120.0
    """Speed of the rotor blade's tip, U_tip."""
    induced_velocity_mps: Positive = 4.03
    """Mean velocity that the rotor induces in hover, v0."""
    drag_ratio: NonNegative = 0.6
    """Fuselage drag ratio, d0."""
    air_density_kgpm3: Positive = 1.225
    """Density of the air, rho."""
    rotor_solidity: Positive = 0.05
    """Rotor solidity, s."""
    rotor_area_m2: Positive = 0.503
    """Area of the rotor disc, A."""
    radio_j_per_message: NonNegative = 0.005
    """Energy that a UAV spends on each message that it publishes.

    Source: this project.
    """
    initial_min_j: Positive = 50_000.0
    """Least charge of a battery at the start of a random mission.

    Charges are drawn uniformly from `initial_min_j` to `initial_max_j`. At most `initial_max_j`.

    Source: this project.
    """
    initial_max_j: Positive = 100_000.0
    """Greatest charge of a battery at the start of a random mission.

    Source: this project.
    """


class HeadModel(Struct, frozen=True, kw_only=True):
    """Power that leading costs.

    Source: this project.
    """

    p_active_w: NonNegative = 5.0
    """Power that the head draws while its processor plans.

    Its energy is this power times the processor time that planning has taken.
    """
