"""Detours: UAVs that stand still away from their targets turn right for a while (right-hand rule).

Two of the baselines, `bvc` and `cbf`, leave UAVs face to face for ever without such a rule, and their papers name one:
to the right. A UAV that comes no nearer to its target by a detour turns further to the right in the next one, which
the papers leave open.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from edc_swarm.geometry import Floats, length_m
from edc_swarm.planner.discs import Discs

STUCK_SHARE = 0.02
"""A UAV stands still if its step is shorter than this share of its longest one, and its wish is longer."""
TURN_AFTER_SLOTS = 2
"""Consecutive slots after which a UAV that stands still turns."""
DETOUR_SLOTS = 8
"""Slots for which it turns."""
TURN_RAD = math.pi / 4
"""By how much each detour in vain turns further; the first one turns by this."""
MOST_TURNS = 6
"""Turns after which the next one is the first one again: the UAV has tried all sides but the left."""


@dataclass(slots=True)
class _Detour:
    """One UAV's slots at rest, slots of the detour that are left, detours so far, and least distance at their start."""

    still: int = 0
    left: int = 0
    turns: int = 0
    nearest_m: float = math.inf


class Detours:
    """The detours of the UAVs, by roster index."""

    def __init__(self) -> None:
        self._of: dict[int, _Detour] = {}

    def turned(self, discs: Discs, way_m: Floats) -> Floats:
        """Return the ways (n, 2), turned to the right for the UAVs that make a detour in this slot."""
        least_m = STUCK_SHARE * discs.u_max_m
        away_m = length_m(discs.target_m - discs.position_m)
        stands = (away_m > least_m) & (length_m(discs.step_m) <= least_m)
        turns = [
            self._turns(self._of.setdefault(k, _Detour()), here, far_m)
            for k, here, far_m in zip(discs.uav.tolist(), stands.tolist(), away_m.tolist(), strict=True)
        ]
        cos = np.array([math.cos(TURN_RAD * turn) for turn in turns])
        sin = np.array([math.sin(TURN_RAD * turn) for turn in turns])
        x_m, y_m = way_m[:, 0], way_m[:, 1]
        return np.stack([cos * x_m + sin * y_m, cos * y_m - sin * x_m], axis=-1)

    def _turns(self, detour: _Detour, stands: bool, away_m: float) -> int:
        """Return by how many turns the UAV's way is turned in this slot."""
        detour.still = detour.still + 1 if stands else 0
        if detour.left:
            detour.left -= 1
        elif detour.still > TURN_AFTER_SLOTS:
            nearer = away_m < detour.nearest_m - 1e-9
            detour.turns = 1 if nearer else detour.turns % MOST_TURNS + 1
            detour.nearest_m = min(away_m, detour.nearest_m)
            detour.left, detour.still = DETOUR_SLOTS, 0
        return detour.turns if detour.left else 0
