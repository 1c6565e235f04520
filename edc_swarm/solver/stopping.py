"""Stopping points: where each UAV rests if it flies one step and brakes after it.

A vehicle with inertia cannot hold at once. Its state is its position p and its last step s, and consecutive steps
differ by at most `change_m` = a_max dt^2. With u = |u| e let B(|u|) be the length of the braking path
(`mission.braking`). A UAV that flies the step u and then brakes stays on the segment from p to its *stopping point*

    p + D(|u|) e,   D(L) = L + B(L) = sum over i >= 0 of max(L - i change, 0),

and a UAV that brakes at once stays on the segment from p to its *rest* q = p + B(|s|) s / |s|. D is continuous and
grows, so steps and stopping points determine each other. The slot QP plans stopping points, since its rows are linear
in them: its variable z is the way from q to the new stopping point, and z = 0 is to brake.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edc_swarm.geometry import Floats, length_m

STEP_HALVINGS = 24
"""Bisections of a way to a stopping point that the UAV cannot choose in this slot."""
STOP_SLACK = 5e-10
"""Rounding of the change of a step that the certificate allows: half of what a UAV allows (`mission.braking`)."""

ROOM_M = 1e-9
"""Distance by which preferred steps stay below the longest one, for rounding."""


def braking_m(step_m: Floats, change_m: Floats) -> Floats:
    """Return B (n,) for steps of these lengths (n,)."""
    finite = np.isfinite(change_m)
    change_m = np.where(finite, change_m, 1.0)
    steps = np.where(finite, np.floor(step_m / change_m), 0.0)
    return np.asarray(steps * step_m - change_m * steps * (steps + 1) / 2)


def step_of(stopping_m: Floats, change_m: Floats) -> Floats:
    """Return the lengths (n,) of the steps after which UAVs rest at these distances (n,): the inverse of D."""
    finite = np.isfinite(change_m)
    change_m = np.where(finite, change_m, 1.0)
    steps = np.where(finite, np.floor((np.sqrt(1 + 8 * stopping_m / change_m) - 1) / 2), 0.0)
    return np.asarray((stopping_m + change_m * steps * (steps + 1) / 2) / (steps + 1))


@dataclass(frozen=True, slots=True)
class Momentum:
    """Motion of the UAVs at the start of a slot.

    `position_m` (n, 2) are the disc centres, `last_m` (n, 2) the steps of the slot before, `change_m` (n,) the largest
    changes of a step (infinite: a vehicle that stops at once), `u_max_m` (n,) the longest steps.
    """

    position_m: Floats
    last_m: Floats
    change_m: Floats
    u_max_m: Floats

    @property
    def rest_m(self) -> Floats:
        """Points q (n, 2) at which the UAVs rest that brake at once."""
        length = length_m(self.last_m)
        # A vehicle that stops at once rests where it is.
        moves = (length > self.change_m) & np.isfinite(self.change_m)
        share = np.where(moves, braking_m(length, self.change_m) / np.where(length > 0, length, 1.0), 0.0)
        return np.asarray(self.position_m + share[:, None] * self.last_m)

    @property
    def braked_m(self) -> Floats:
        """Waypoints (n, 2) of the UAVs that brake in this slot."""
        length = length_m(self.last_m)
        left_m = np.maximum(length - self.change_m, 0.0)
        share = left_m / np.where(length > 0, length, 1.0)
        return np.asarray(self.position_m + share[:, None] * self.last_m)

    @property
    def reach_m(self) -> Floats:
        """Bounds (n,) on the distance between rest and stopping point: no step of this slot moves it farther."""
        length = length_m(self.last_m)
        fastest_m = np.minimum(self.u_max_m, length + self.change_m)
        path_m = fastest_m + braking_m(fastest_m, self.change_m)
        return np.asarray(path_m + length_m(self.rest_m - self.position_m))

    @property
    def gain(self) -> float:
        """Greatest growth of a rounding error from waypoint to stopping point: the greatest slope of D."""
        finite = np.isfinite(self.change_m)
        steps = np.floor(self.u_max_m[finite] / self.change_m[finite])
        return 1.0 + float(steps.max(initial=0.0))

    def stops_m(self, waypoint_m: Floats) -> Floats:
        """Return the stopping points (n, 2) of UAVs that fly to these waypoints (n, 2) and brake after it."""
        step_m = waypoint_m - self.position_m
        length = length_m(step_m)
        share = (length + braking_m(length, self.change_m)) / np.where(length > 0, length, 1.0)
        return np.asarray(self.position_m + share[:, None] * step_m)

    def waypoints_m(self, stop_m: Floats) -> Floats:
        """Return the waypoints (n, 2) of the steps with these stopping points (n, 2)."""
        way_m = stop_m - self.position_m
        length = length_m(way_m)
        share = step_of(length, self.change_m) / np.where(length > 0, length, 1.0)
        return np.asarray(self.position_m + share[:, None] * way_m)

    def allows(self, waypoint_m: Floats, slack: float = 0.0) -> NDArray[np.bool_]:
        """Return a mask (n,) of the waypoints that the UAVs can fly to in this slot."""
        step_m = waypoint_m - self.position_m
        change = length_m(step_m - self.last_m) <= self.change_m * (1 + slack) + slack
        return np.asarray(change & (length_m(step_m) <= self.u_max_m))

    def towards_m(self, wish_m: Floats) -> Floats:
        """Return the waypoints (n, 2) that the UAVs can fly to, each the nearest to a preferred one (n, 2)."""
        step_m = wish_m - self.position_m
        length = length_m(step_m)
        most_m = np.maximum(self.u_max_m - ROOM_M, 0.0)
        step_m = step_m * (np.minimum(most_m, length) / np.where(length > 0, length, 1.0))[:, None]
        change_m = step_m - self.last_m
        length = length_m(change_m)
        share = np.minimum(self.change_m, length) / np.where(length > 0, length, 1.0)
        return np.asarray(self.position_m + self.last_m + share[:, None] * change_m)

    def nearest_m(self, rest_m: Floats, way_m: Floats) -> Floats:
        """Return the waypoints (n, 2) of the farthest stopping points on the ways (n, 2) from `rest_m` (n, 2).

        A stopping point on the way to one that keeps its rows keeps them too. A UAV for which none but
        its rest is found brakes.
        """
        waypoint_m = self.waypoints_m(rest_m + way_m)
        beyond = ~self.allows(waypoint_m, STOP_SLACK / 2)
        if not beyond.any():
            return waypoint_m
        low, high = np.zeros(len(way_m)), np.ones(len(way_m))
        best_m = np.where(beyond[:, None], self.braked_m, waypoint_m)
        for _ in range(STEP_HALVINGS):
            middle = 0.5 * (low + high)
            trial_m = self.waypoints_m(rest_m + middle[:, None] * way_m)
            good = self.allows(trial_m, STOP_SLACK / 2)
            low, high = np.where(good, middle, low), np.where(good, high, middle)
            best_m = np.where((beyond & good)[:, None], trial_m, best_m)
        return best_m
