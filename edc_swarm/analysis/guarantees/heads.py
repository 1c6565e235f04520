"""G1: one head per term, a quorum behind every plan, terms that only grow."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from edc_swarm.analysis.guarantees.evidence import Evidence
from edc_swarm.analysis.guarantees.verdict import GuaranteeResult, Violation, not_judged, verdict
from edc_swarm.protocol.messages import Report
from edc_swarm.recording.repeats import said_once

Granted = set[tuple[str, int, int, str]]
"""UAV, slot, term and head of every recorded grant."""


def check_one_head(evidence: Evidence) -> GuaranteeResult:
    """Return the verdict on G1. The fixes of UAVs that lost their memory count as no grant."""
    granted = _granted(evidence)
    found = [
        *_rivals(evidence),
        *_unbacked_plans(evidence, granted),
        *_unbacked_commands(evidence, granted),
        *_second_plans(evidence),
        *_broken_promises(evidence),
    ]
    if not found and (absent := absent_grants(evidence)):
        why = f"{absent} grants of plans are in fixes that may be missing from the record"
        return not_judged("G1", "One head per term", why, evidence.gap_notes())
    return verdict("G1", "One head per term", found, evidence.gap_notes())


def absent_grants(evidence: Evidence) -> int:
    """Return how many grants of plans no recorded fix gives although one may have been published."""
    granted = _granted(evidence)
    ungiven = [(uav, report.slot) for report in evidence.plans for uav in _ungiven(report, granted)]
    return sum(evidence.fix_lost(uav, slot) for uav, slot in ungiven)


def _granted(evidence: Evidence) -> Granted:
    """Return the recorded grants, without those of UAVs that lost their memory."""
    return {(f.uav, f.slot, f.term, f.head) for f in evidence.recording.fixes if f.voter}


def _ungiven(report: Report, granted: Granted) -> list[str]:
    """Return the UAVs whose grant stands behind a plan, and in no recorded fix."""
    return [uav for uav in report.grants if (uav, report.slot, report.term, report.head) not in granted]


def _rivals(evidence: Evidence) -> Iterator[Violation]:
    """Yield a violation for each term in which more than one UAV planned or commanded."""
    said = [(r.term, r.head, r.slot) for r in evidence.plans]
    said += [(c.term, c.head, c.slot - 1) for c in evidence.recording.commands]
    first: dict[int, dict[str, int]] = {}
    for term, head, slot in said:
        heads = first.setdefault(term, {})
        heads[head] = min(slot, heads.get(head, slot))
    for term, heads in first.items():
        if len(heads) > 1:
            names = sorted(heads)
            text = f"term {term} has {len(heads)} heads: {', '.join(names)}"
            yield Violation("two-heads", text, max(heads.values()), names)


def _unbacked_plans(evidence: Evidence, granted: Granted) -> Iterator[Violation]:
    for report in evidence.plans:
        grants = set(report.grants) & evidence.index.keys()
        if len(grants) < evidence.mission.quorum:
            counted = f"{len(grants)} grants where {evidence.mission.quorum} are needed"
            yield _of(report, "no-quorum", f"a plan of term {report.term} on {counted}", [report.head])
        missing = [uav for uav in _ungiven(report, granted) if not evidence.fix_lost(uav, report.slot)]
        if missing:
            text = f"grants of term {report.term} that no recorded fix gives: {', '.join(missing)}"
            yield _of(report, "grant-without-fix", text, missing)


def _unbacked_commands(evidence: Evidence, granted: Granted) -> Iterator[Violation]:
    """Yield violations for commands to unheard UAVs, and for commands without a quorum, with or without a report."""
    support = Counter((term, head, slot) for _, slot, term, head in granted)
    unsupported = set()
    for c in evidence.recording.commands:
        plan = (c.term, c.head, c.slot - 1)
        if not evidence.fix_lost(c.uav, c.slot - 1) and (c.uav, c.slot - 1, c.term, c.head) not in granted:
            text = f"{c.head} commands {c.uav}, whose fix of slot {c.slot - 1} does not grant term {c.term}"
            yield Violation("command-to-unheard", text, c.slot, [c.uav])
        unsaid = sum(evidence.fix_lost(uav, c.slot - 1) for uav in evidence.index)
        if support[plan] + unsaid < evidence.mission.quorum:
            unsupported.add(plan)
    for term, head, slot in unsupported:
        text = f"commands of term {term} on {support[term, head, slot]} grants"
        yield Violation("no-quorum", text, slot, [head])


def _second_plans(evidence: Evidence) -> Iterator[Violation]:
    """Yield a violation for each head that planned more than once in a term and slot; a repeat is no second plan."""
    plans = Counter((r.term, r.slot, r.head) for r in evidence.plans)
    for (term, slot, head), count in plans.items():
        if count > 1:
            yield Violation("planned-twice", f"{count} plans of term {term} for one slot", slot, [head])
    for (uav, slot), commands in evidence.commands.items():
        if len(commands) == 1:
            continue
        said = said_once(commands) if evidence.mission.resends else commands
        for term, count in Counter(command.term for command in said).items():
            if count > 1:
                yield Violation("planned-twice", f"{count} commands of term {term} to {uav}", slot, [uav])


def _broken_promises(evidence: Evidence) -> Iterator[Violation]:
    """Yield violations for UAVs whose term decreases, or that grant two heads in one term."""
    for uav, fixes in evidence.fixes.items():
        newest = 0
        heads: dict[int, str] = {}
        for fix in fixes:
            if not fix.voter:
                continue
            if fix.term < newest:
                yield Violation("term-decreased", f"term {newest} became {fix.term}", fix.slot, [uav])
            newest = max(newest, fix.term)
            head = heads.setdefault(fix.term, fix.head)
            if head != fix.head:
                text = f"grants {fix.head or 'no head'} in term {fix.term} after {head or 'no head'}"
                yield Violation("grant-changed", text, fix.slot, [uav])
                heads[fix.term] = fix.head


def _of(report: Report, kind: str, text: str, uavs: list[str]) -> Violation:
    return Violation(kind, f"{report.head}: {text}", report.slot, uavs)
