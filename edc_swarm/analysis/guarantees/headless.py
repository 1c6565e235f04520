"""Verdicts on a mission without a head (`control = "local"`): which guarantees promise nothing there, and why.

What breaks a guarantee whoever controls the swarm stays a violation: a body that jumps, a UAV that flies after its
landing, a goal that is forgotten. G3 and G8 are judged as ever, and say that they were measured.
"""

from __future__ import annotations

from msgspec.structs import replace

from edc_swarm.analysis.guarantees.verdict import GuaranteeResult, not_applicable

NOT_PROMISED = {
    "G1": "control is local: no UAV leads",
    "G2": "control is local: no UAV commands another",
    "G4": "control is local: a UAV that hears nobody flies on",
    "G7": "control is local: what the UAVs reach is measured, not promised",
}
"""Guarantees about heads, and why they do not apply."""
ALWAYS = frozenset(
    {
        "after-landing",
        "without-memory",
        "truth-differs",
        "truth-jumped",
        "truth-moved",
        "moved-without-command",
        "changes-too-fast",
        "course-forgotten",
    }
)
"""Kinds of violations that no control excuses."""
MEASURED = "measured, not promised: control is local"


def without_head(result: GuaranteeResult) -> GuaranteeResult:
    """Return the verdict on a guarantee in a mission without a head."""
    if result.guarantee not in NOT_PROMISED:
        return replace(result, notes=[*result.notes, MEASURED]) if result.guarantee == "G3" else result
    found = [violation for violation in result.violations if violation.kind in ALWAYS]
    if found:
        return replace(result, violations=found)
    return not_applicable(result.guarantee, result.title, NOT_PROMISED[result.guarantee])
