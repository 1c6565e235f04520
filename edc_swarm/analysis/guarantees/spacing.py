"""G3: tracked discs stay disjoint at every instant, bodies never touch."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from edc_swarm.analysis.guarantees.evidence import Evidence
from edc_swarm.analysis.guarantees.inside import strayed
from edc_swarm.analysis.guarantees.verdict import GuaranteeResult, Violation, verdict
from edc_swarm.analysis.separation import Encounters, closest_moment, encounters, swept_encounters
from edc_swarm.analysis.true_paths import have_inertia, parts_of
from edc_swarm.geometry import BODY_TOLERANCE_M, DISC_TOLERANCE_M, length_m
from edc_swarm.mission.braking import changes_m
from edc_swarm.solver.stopping import braking_m

Floats = NDArray[np.float64]

UNEVEN_PLANNER = "edc"
"""The planner that keeps discs apart for any uneven execution of the steps."""


def check_separation(evidence: Evidence) -> GuaranteeResult:
    """Return the verdict on G3. Dead UAVs count too, at their last place, until the failsafe has made them land."""
    overlaps = overlapping(evidence)
    found = [*overlaps, *touching(evidence), *_outside(evidence), *strayed(evidence)]
    if evidence.mission.planner == UNEVEN_PLANNER:
        known = {tuple(violation.uavs) for violation in overlaps}
        found += [v for v in _uneven(evidence) if tuple(v.uavs) not in known]
    return verdict("G3", "Separation", found, evidence.gap_notes())


def overlapping(evidence: Evidence) -> list[Violation]:
    """Return the pairs whose discs overlap while all move simultaneously (the paper's eq. 16, at every instant)."""
    ends_m = evidence.tracks.seen_m
    met = encounters(*ends_m, _radius_m(evidence), -DISC_TOLERANCE_M)
    return [_timed(evidence, "overlap", "discs overlap by", met, pair, ends_m) for pair in _by_pair(met)]


def touching(evidence: Evidence) -> list[Violation]:
    """Return the pairs whose bodies touch."""
    ends_m, parts = evidence.tracks.bodies_m, 1
    if evidence.paths is not None:
        ends_m, parts = evidence.paths.moves_m(*ends_m), parts_of(evidence.mission)
    body_m = np.array([entry.body_m for entry in evidence.mission.roster])
    met = encounters(*ends_m, body_m, -BODY_TOLERANCE_M)
    return [_timed(evidence, "true-collision", "bodies meet by", met, pair, ends_m, parts) for pair in _by_pair(met)]


def _uneven(evidence: Evidence) -> Iterator[Violation]:
    """Yield the pairs that would overlap if one lagged within the slot (with `lag_slots`: by one slot), or braked.

    A UAV that cannot stop at once may brake after any step, so its way goes on to where it would rest.
    """
    from_m, to_m = evidence.tracks.seen_m
    to_m = _stops_m(evidence, from_m, to_m)
    radius_m, count = _radius_m(evidence), len(evidence.index)
    if evidence.mission.lag_slots:
        from_m, to_m = (
            np.concatenate([now, _one_slot_late(now, evidence.tracks.grounded)], axis=1) for now in (from_m, to_m)
        )
        radius_m = np.concatenate([radius_m, radius_m])
    met = swept_encounters(from_m, to_m, radius_m, -DISC_TOLERANCE_M)
    other = (met.first % count != met.second % count) & (met.first < count)
    met = Encounters(met.slot[other], met.first[other], met.second[other] % count, met.gap_m[other])
    for rows in _by_pair(met):
        yield _violation(evidence, "uneven", "swept ways come too close by", met, rows, None)


def _stops_m(evidence: Evidence, from_m: Floats, to_m: Floats) -> Floats:
    """Return (S, K, 2) points at which the UAVs rest that brake after the steps."""
    changes = changes_m(evidence.mission)
    if changes is None:
        return to_m
    step_m = to_m - from_m
    length = length_m(step_m)
    share = braking_m(length, np.broadcast_to(changes, length.shape)) / np.where(length > 0, length, 1.0)
    return np.asarray(to_m + share[..., None] * step_m)


def _one_slot_late(points_m: Floats, grounded: NDArray[np.bool_]) -> Floats:
    """Return the rows shifted by one slot: row t is the old row t - 1, and row 0 stays.

    A UAV that is out of the airspace in slot t is nowhere: the slot from which it is out allows for the lag.
    """
    return np.where(grounded[..., None], np.nan, np.concatenate([points_m[:1], points_m[:-1]]))


def _outside(evidence: Evidence) -> Iterator[Violation]:
    """Yield a violation for each UAV without inertia whose body is not wholly inside its tracked disc."""
    tracks, moves_exactly = evidence.tracks, ~have_inertia(evidence.mission)
    offset_m = np.hypot(*np.moveaxis(tracks.true_to_m - tracks.centre_m[1:], 2, 0))
    body_m = np.array([entry.body_m for entry in evidence.mission.roster])
    excess_m = np.where(~tracks.lost & moves_exactly, offset_m, np.nan) - (_radius_m(evidence) - body_m)
    for k in np.flatnonzero((excess_m > BODY_TOLERANCE_M).any(axis=0)).tolist():
        slot = int(np.argmax(excess_m[:, k] > BODY_TOLERANCE_M))
        uav, off_m = tracks.uavs[k], float(np.nanmax(excess_m[:, k]))
        yield Violation("outside-disc", f"{uav} is outside its disc by {off_m:.3g} m", slot, [uav], None, off_m)


def _radius_m(evidence: Evidence) -> Floats:
    return np.array([entry.r_m for entry in evidence.mission.roster])


def _by_pair(met: Encounters) -> list[NDArray[np.int64]]:
    """Return the rows of each pair, in the order of slots."""
    rows: dict[tuple[int, int], list[int]] = {}
    for row, pair in enumerate(zip(met.first.tolist(), met.second.tolist(), strict=True)):
        rows.setdefault((min(pair), max(pair)), []).append(row)
    return [np.array(found) for found in rows.values()]


def _timed(
    evidence: Evidence,
    kind: str,
    words: str,
    met: Encounters,
    rows: NDArray[np.int64],
    ends_m: tuple[Floats, Floats],
    parts: int = 1,
) -> Violation:
    """Return a violation of a pair, at its closest approach in its first slot, of whose `parts` `met` has one each."""
    row = rows[0]
    part = int(met.slot[row])
    share = closest_moment(*ends_m, part, int(met.first[row]), int(met.second[row]))
    met = replace(met, slot=met.slot // parts)
    return _violation(evidence, kind, words, met, rows, evidence.time_s(0, (part + share) / parts))


def _violation(
    evidence: Evidence, kind: str, words: str, met: Encounters, rows: NDArray[np.int64], time_s: float | None
) -> Violation:
    first, deepest = rows[0], rows[np.argmin(met.gap_m[rows])]
    pair = sorted((int(met.first[first]), int(met.second[first])))
    names = [evidence.tracks.uavs[k] for k in pair]
    depth_m, slots = -float(met.gap_m[deepest]), len(set(met.slot[rows].tolist()))
    of = "1 slot" if slots == 1 else f"{slots} slots"
    text = f"{' and '.join(names)}: {words} up to {depth_m:.3g} m (slot {met.slot[deepest]}; {of} in all)"
    return Violation(kind, text, int(met.slot[first]), names, time_s, depth_m)
