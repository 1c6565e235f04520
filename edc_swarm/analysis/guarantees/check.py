"""Check of the guarantees on a recording of a real or simulated mission.

G1 one head per term, G2 only valid commands, G3 separation, G4 hold on silence, G5 no loss in the record,
G7 progress, G8 zones. (G6, same seed same bytes, takes a second simulation: `edc_swarm.experiments.resimulation`.) A
table in `evidence` lists the evidence that each guarantee needs. Missing evidence never makes a guarantee hold; a
violation that is certain stays one.
"""

from __future__ import annotations

from edc_swarm.analysis.guarantees.clusters import of_each, parts_of
from edc_swarm.analysis.guarantees.completeness import check_no_loss
from edc_swarm.analysis.guarantees.evidence import Evidence, gather
from edc_swarm.analysis.guarantees.fencing import check_fencing
from edc_swarm.analysis.guarantees.headless import without_head
from edc_swarm.analysis.guarantees.heads import check_one_head
from edc_swarm.analysis.guarantees.holding import check_hold_on_silence
from edc_swarm.analysis.guarantees.progress import check_progress
from edc_swarm.analysis.guarantees.spacing import check_separation
from edc_swarm.analysis.guarantees.verdict import GuaranteeResult, Violation, headline, not_judged
from edc_swarm.analysis.guarantees.zoning import check_zones
from edc_swarm.recording.model import Recording

CHECKERS = (
    check_one_head,
    check_fencing,
    check_separation,
    check_hold_on_silence,
    check_no_loss,
    check_progress,
    check_zones,
)

OF_CLUSTERS = (check_one_head, check_progress)
"""Checkers of what each cluster promises for itself."""


def check(recording: Recording) -> list[GuaranteeResult]:
    """Return the verdict on every guarantee, in order."""
    evidence = gather(recording)
    parts = parts_of(evidence) if evidence.mission.clusters > 1 else {}
    results = [
        _on_evidence(evidence, of_each(parts, checker) if parts and checker in OF_CLUSTERS else checker(evidence))
        for checker in CHECKERS
    ]
    return results if evidence.mission.control == "head" else [without_head(result) for result in results]


def _on_evidence(evidence: Evidence, result: GuaranteeResult) -> GuaranteeResult:
    """Return `result`, or "not judged" if it is "held" and evidence for that is missing."""
    lacking = evidence.lacking(result.guarantee)
    if result.broken or not lacking:
        return result
    notes = [] if result.status == "not-applicable" else result.notes
    return not_judged(result.guarantee, result.title, "; ".join(lacking), notes)


__all__ = ["GuaranteeResult", "Violation", "check", "headline"]
