"""G4: without a valid command the disc brakes along its declared path, or stays if it rests or stops at once.

The declared path is a function of the last step (`mission.braking`), so the record alone says where the disc must be.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from edc_swarm.analysis.guarantees.evidence import Evidence
from edc_swarm.analysis.guarantees.verdict import GuaranteeResult, Violation, verdict
from edc_swarm.analysis.tracks import TRUTH_TOLERANCE_M
from edc_swarm.analysis.true_paths import have_inertia
from edc_swarm.mission.braking import AT_REST_M, BRAKE_SLACK, change_of


def check_hold_on_silence(evidence: Evidence) -> GuaranteeResult:
    """Return the verdict on G4: a disc must do exactly so, a body up to rounding, neither jumps between two slots.

    How far the body of a vehicle with inertia is from its declared path is a matter of G3 (`inside`). No step differs
    from the last one by more than the vehicle's step change, since no such command is valid.
    """
    tracks = evidence.tracks
    braking_m = _braking_m(evidence)
    disc_m = _length_m(np.diff(tracks.centre_m, axis=0) - braking_m)
    true_m = _length_m(tracks.true_to_m - tracks.true_from_m - braking_m)
    jump_m = _length_m(tracks.true_from_m[1:] - tracks.true_to_m[:-1])
    jump_m = np.concatenate([np.zeros((1, jump_m.shape[1])), jump_m])[: tracks.slots]
    held, exact = ~tracks.executed & ~tracks.lost, ~have_inertia(evidence.mission)
    held[1:] &= exact | ~tracks.lost[:-1]  # Where a vehicle brakes to depends on its step before.
    found = [
        *_moves(evidence, disc_m, (disc_m > _rounding_m(braking_m)) & held, "moved-without-command"),
        *_moves(evidence, *_changes(evidence), "changes-too-fast"),
        *_moves(evidence, true_m, (true_m > TRUTH_TOLERANCE_M) & held & exact, "truth-moved"),
        *_moves(evidence, jump_m, jump_m > TRUTH_TOLERANCE_M, "truth-jumped"),
    ]
    return verdict("G4", "Hold on silence", found, evidence.gap_notes())


def _changes(evidence: Evidence) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the changes (S, K) between consecutive steps, and a mask of those that no vehicle can fly."""
    tracks = evidence.tracks
    limit_m = np.array([change_of(evidence.mission, entry) for entry in evidence.mission.roster])
    step_m = np.diff(tracks.centre_m, axis=0, prepend=tracks.centre_m[:1])
    change_m = _length_m(np.diff(step_m, axis=0))
    known = ~tracks.lost
    known[1:] &= ~tracks.lost[:-1]
    return change_m, known & (change_m > limit_m * (1 + 2 * BRAKE_SLACK) + 2 * BRAKE_SLACK)


def _braking_m(evidence: Evidence) -> NDArray[np.float64]:
    """Return the steps (S, K, 2) that the discs fly in each slot if they brake."""
    change_m = np.array([change_of(evidence.mission, entry) for entry in evidence.mission.roster])
    step_m = np.diff(evidence.tracks.centre_m, axis=0)
    last_m = np.concatenate([np.zeros((1, *step_m.shape[1:])), step_m])[: len(step_m)]
    length_m = _length_m(last_m)
    left_m = np.maximum(length_m - change_m, 0.0)
    left_m[left_m <= AT_REST_M] = 0.0
    share = left_m / np.where(length_m > 0, length_m, 1.0)
    return np.asarray(share[..., None] * last_m)


def _rounding_m(braking_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rounding (S, K) of a place that a braking step leads to; a disc at rest moves by exactly nothing."""
    return np.where((braking_m != 0).any(axis=-1), TRUTH_TOLERANCE_M, 0.0)


def _moves(
    evidence: Evidence, length_m: NDArray[np.float64], wrong: NDArray[np.bool_], kind: str
) -> Iterator[Violation]:
    for slot, k in np.argwhere(wrong).tolist():
        uav, off_m = evidence.tracks.uavs[k], float(length_m[slot, k])
        text = f"{uav}: {off_m:.3g} m ({kind.replace('-', ' ')})"
        yield Violation(kind, text, slot, [uav], evidence.time_s(slot), off_m)


def _length_m(vectors_m: NDArray[np.float64]) -> NDArray[np.float64]:
    lengths_m: NDArray[np.float64] = np.hypot(vectors_m[..., 0], vectors_m[..., 1])
    return lengths_m
