"""G4: without a valid command neither the disc nor the UAV moves."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from edc_swarm.analysis.guarantees.evidence import Evidence
from edc_swarm.analysis.guarantees.verdict import GuaranteeResult, Violation, verdict
from edc_swarm.analysis.tracks import TRUTH_TOLERANCE_M


def check_hold_on_silence(evidence: Evidence) -> GuaranteeResult:
    """Return the verdict on G4: a disc must not move at all, a body only by rounding, neither between two slots."""
    tracks = evidence.tracks
    disc_m = _length_m(np.diff(tracks.centre_m, axis=0))
    true_m = _length_m(tracks.true_to_m - tracks.true_from_m)
    jump_m = _length_m(tracks.true_from_m[1:] - tracks.true_to_m[:-1])
    jump_m = np.concatenate([np.zeros((1, jump_m.shape[1])), jump_m])[: tracks.slots]
    held = ~tracks.executed & ~tracks.lost
    found = [
        *_moves(evidence, disc_m, (disc_m > 0) & held, "moved-without-command"),
        *_moves(evidence, true_m, (true_m > TRUTH_TOLERANCE_M) & held, "truth-moved"),
        *_moves(evidence, jump_m, jump_m > TRUTH_TOLERANCE_M, "truth-jumped"),
    ]
    return verdict("G4", "Hold on silence", found, evidence.gap_notes())


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
