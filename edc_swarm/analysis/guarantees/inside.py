"""Part of G3: the true position of a vehicle with inertia is inside its tracked set at all times.

The vehicle's declared path is inside the hull of its last and its present step (`mission.declared_path`), so a body
that keeps within `r_m` less its own radius of that path is inside the tracked set. The samples of a truth are compared
with the path at their times.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from edc_swarm.analysis.autopilots import strayed_by
from edc_swarm.analysis.guarantees.evidence import Evidence
from edc_swarm.analysis.guarantees.verdict import Violation
from edc_swarm.analysis.true_paths import Floats, TruePaths
from edc_swarm.geometry import BODY_TOLERANCE_M, length_m
from edc_swarm.mission.braking import BRAKE_SLACK, change_of
from edc_swarm.mission.vehicle_budget import budget_of

MEMORY_SLOTS = 8
"""Slots before a deviation in which its cause is looked for: a controller has settled by then."""


def deviations_m(evidence: Evidence, paths: TruePaths) -> Floats:
    """Return (S, K, N + 1) distances of bodies from their declared paths, NaN where unknown, stray or on the ground."""
    tracks = evidence.tracks
    unknown = tracks.lost | tracks.grounded | tracks.astray
    unknown[1:] |= tracks.lost[:-1]
    return np.where(unknown[..., None], np.nan, paths.deviation_m(tracks.centre_m))


def largest_deviation_m(evidence: Evidence) -> float | None:
    """Return the largest distance of a body with inertia from its declared path, None if no truth tells of any."""
    if evidence.paths is None:
        return None
    found_m = float(np.fmax.reduce(deviations_m(evidence, evidence.paths), axis=None, initial=-1.0))
    return found_m if found_m >= 0 else None


def strayed(evidence: Evidence) -> Iterator[Violation]:
    """Yield a violation for each UAV with inertia whose body leaves its tracked set, with the bound that was too small.

    It tells the first such time, and the largest deviation of the flight.
    """
    tracks, paths = evidence.tracks, evidence.paths
    if paths is None:
        return
    body_m = np.array([entry.body_m for entry in evidence.mission.roster])
    deviation_m = deviations_m(evidence, paths)
    excess_m = deviation_m - (paths.radius_m - body_m)[..., None]
    for k in np.flatnonzero((excess_m > BODY_TOLERANCE_M).any(axis=(0, 2))).tolist():
        slot, sample = np.argwhere(excess_m[:, k] > BODY_TOLERANCE_M)[0].tolist()
        uav, off_m = tracks.uavs[k], float(deviation_m[slot, k, sample])
        most_m, budget = float(np.nanmax(deviation_m[:, k])), budget_of(evidence.mission, evidence.mission.roster[k])
        text = (
            f"{uav} is {off_m:.2f} m from its declared path (at most {most_m:.2f} m later), outside its disc"
            f" ({budget}): {_cause(evidence, paths, slot, k)}"
        )
        time_s = evidence.time_s(slot, sample / (deviation_m.shape[2] - 1))
        yield Violation("outside-disc", text, slot, [uav], time_s, float(np.nanmax(excess_m[:, k])))


def _cause(evidence: Evidence, paths: TruePaths, slot: int, k: int) -> str:
    """Return which bound was too small, by what the record tells of the slots before."""
    mission, tracks = evidence.mission, evidence.tracks
    if why := strayed_by(evidence.recording, tracks.uavs[k], slot):
        return f"its vehicle no longer followed: {why}"
    entry, span = mission.roster[k], slice(max(0, slot - MEMORY_SLOTS), slot + 1)
    budget = budget_of(mission, entry)
    error_m = float(np.nanmax(length_m(paths.measured_m[span, k] - paths.path_m[span, k, 0]), initial=0.0))
    grown_m = float(paths.radius_m[span, k].max()) - entry.r_m
    step_m = np.diff(tracks.centre_m[max(0, slot - MEMORY_SLOTS - 1) : slot + 2, k], axis=0)
    turn_m = float(length_m(np.diff(step_m, axis=0)).max(initial=0.0))
    change_m = change_of(mission, entry)
    if turn_m > change_m * (1 + 2 * BRAKE_SLACK) + 2 * BRAKE_SLACK:
        return f"a_max_mps2 was too small, its step changed by {turn_m:.2f} m, more than {change_m:.2f} m"
    if error_m > budget.gps_m + grown_m + BODY_TOLERANCE_M:
        return f"gps_m was too small, its measured position was off by {error_m:.2f} m"
    if paths.saturated[span, k].any():
        return "its acceleration was too small, the controller asked for more than the vehicle had"
    return f"tracking_m was too small ({budget.tracking_m:.2f} m)"
