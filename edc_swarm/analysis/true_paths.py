"""The true paths of vehicles with inertia, by their truths, and what they are to be compared with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from msgspec import UNSET
from numpy.typing import NDArray

from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.control_loop import loop_step
from edc_swarm.mission.declared_path import declared
from edc_swarm.mission.vehicle_budget import vehicle_of
from edc_swarm.protocol.messages import Truth, roster_index
from edc_swarm.recording.model import Recording

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class TruePaths:
    """True paths of K UAVs over S slots; rows of UAVs without inertia are empty.

    Attributes
    ----------
    path_m
        (S, K, N + 1, 2): true positions at equal times from the start to the end of each slot; NaN where no truth is.
    radius_m
        (S, K): radius of the tracked disc, which grows while a UAV flies without GPS.
    measured_m
        (S, K, 2): position at the start of the slot by GPS, NaN where there is no fix.
    saturated
        (S, K): True where the controller asked for more acceleration than the vehicle has.
    propulsion_j
        (S, K): energy of propulsion, NaN where no truth is.
    """

    path_m: Floats
    radius_m: Floats
    measured_m: Floats
    saturated: Bools
    propulsion_j: Floats

    def deviation_m(self, centre_m: Floats) -> Floats:
        """Return (S, K, N + 1) distances from the declared path of discs whose centres are (S + 1, K, 2) in metres."""
        before_m = np.concatenate([centre_m[:1], centre_m[:-2]])
        parts = self.path_m.shape[2] - 1
        places_m = [declared(before_m, centre_m[:-1], centre_m[1:], i / parts) for i in range(parts + 1)]
        apart_m = self.path_m - np.stack(places_m, axis=2)
        return np.hypot(apart_m[..., 0], apart_m[..., 1])

    def moves_m(self, from_m: Floats, to_m: Floats) -> tuple[Floats, Floats]:
        """Return (S N, K, 2) starts and ends of all parts of the slots, of straight motions too, (S, K, 2) from-to."""
        slots, count, points, _ = self.path_m.shape
        shares = np.linspace(0.0, 1.0, points)[:, None]
        straight_m = from_m[:, :, None] + shares * (to_m - from_m)[:, :, None]
        hidden = np.isnan(from_m[..., 0]) | np.isnan(to_m[..., 0])
        known = ~np.isnan(self.path_m[..., 0]) & ~hidden[..., None]
        path_m = np.where(known[..., None], self.path_m, straight_m)
        parts_m = np.moveaxis(path_m, 2, 1)
        shape = (slots * (points - 1), count, 2)
        return parts_m[:, :-1].reshape(shape), parts_m[:, 1:].reshape(shape)


def have_inertia(mission: Mission) -> Bools:
    """Return (K,) True for every UAV whose vehicle has inertia."""
    return np.array([not vehicle_of(mission, entry).is_ideal for entry in mission.roster], bool)


def parts_of(mission: Mission) -> int:
    """Return N, the number of parts into which samples divide a slot."""
    return loop_step(1.0, 0.0, mission.dt_s).samples


def tells_path(truth: Truth, parts: int) -> bool:
    """Return True if a truth has all samples of the path of a vehicle with inertia."""
    x_m, y_m = truth.between_x_m, truth.between_y_m
    return x_m is not UNSET and y_m is not UNSET and len(x_m) == len(y_m) == parts - 1


def true_paths(recording: Recording, slots: int) -> TruePaths | None:
    """Return the true paths of the first `slots` slots; None if no vehicle has inertia."""
    mission = recording.mission
    inertia, parts, index = have_inertia(mission), parts_of(mission), roster_index(mission.roster)
    if not inertia.any():
        return None
    path_m = np.full((slots, len(inertia), parts + 1, 2), np.nan)
    saturated, propulsion_j = np.zeros((slots, len(inertia)), bool), np.full((slots, len(inertia)), np.nan)
    for truth in recording.truths:
        k = index.get(truth.uav, -1)
        if k < 0 or not inertia[k] or not 0 <= truth.slot < slots or not tells_path(truth, parts):
            continue
        assert truth.between_x_m is not UNSET
        assert truth.between_y_m is not UNSET
        path_m[truth.slot, k, :, 0] = [truth.from_x_m, *truth.between_x_m, truth.to_x_m]
        path_m[truth.slot, k, :, 1] = [truth.from_y_m, *truth.between_y_m, truth.to_y_m]
        saturated[truth.slot, k] = truth.saturated is True
        propulsion_j[truth.slot, k] = truth.propulsion_j if truth.propulsion_j is not UNSET else np.nan
    return TruePaths(path_m, *_said(recording, index, slots), saturated, propulsion_j)


def _said(recording: Recording, index: dict[str, int], slots: int) -> tuple[Floats, Floats]:
    """Return radii and measured positions by the fixes; in a slot without a fix the radius is that of the mission."""
    radius_m = np.tile([entry.r_m for entry in recording.mission.roster], (slots, 1))
    measured_m = np.full((slots, len(index), 2), np.nan)
    for fix in recording.fixes:
        k = index.get(fix.uav, -1)
        if k >= 0 and 0 <= fix.slot < slots:
            radius_m[fix.slot, k] = fix.r_m
            measured_m[fix.slot, k] = fix.x_m, fix.y_m
    return radius_m, measured_m
