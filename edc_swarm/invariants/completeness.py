"""G5: nothing published is missing from the record, and what is missing is named."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from edc_swarm.foreign import shown
from edc_swarm.invariants.evidence import Evidence
from edc_swarm.invariants.report import GuaranteeResult, Violation, verdict
from edc_swarm.recording import Gap, Recording, unknown_tails

MAX_GARBAGE_NOTES = 20


def check_no_loss(evidence: Evidence) -> GuaranteeResult:
    """G5. Publishers that never said their last number leave a tail unknown: a note, not a loss.

    What the recorder had to drop is a loss too, unless the numbers prove that it has had all of it again.
    """
    recording = evidence.recording
    found = [_lost(gap) for gap in evidence.gaps]
    found += [Violation("unreadable", problem) for problem in recording.problems]
    notes = list(_unknown_tails(recording))
    dropped = (recording.run_end or {}).get("dropped", "0")
    if dropped != "0" and not (evidence.gaps or notes):
        notes.append(f"the recorder dropped {dropped} messages; all that were said are there all the same")
    elif dropped != "0":
        found.append(Violation("dropped", f"the recorder dropped {dropped} messages"))
    notes += _garbage(recording)
    if recording.duplicates:
        notes.append(f"duplicates: {recording.duplicates} messages are in the file again, bit by bit; each counts once")
    return verdict("G5", "No loss in the record", found, notes)


def _lost(gap: Gap) -> Violation:
    publisher = f"{gap.key} of {gap.instance or 'unnamed'}"
    if gap.duplicate:
        return Violation("duplicate", f"{publisher}: message {gap.first} is recorded more than once")
    return Violation("gap", f"{publisher}: messages {gap.first} to {gap.last} are missing ({gap.count})")


def _unknown_tails(recording: Recording) -> Iterator[str]:
    """One note per publisher that never said its last words."""
    keys: dict[str, list[str]] = {}
    for key, instance in unknown_tails(recording):
        keys.setdefault(instance or "unnamed", []).append(key)
    for instance, silent in keys.items():
        more = f" and {len(silent) - 1} more" if len(silent) > 1 else ""
        yield f"tail unknown: what was last said on {silent[0]}{more} may be missing, no last word of {instance}"


def _garbage(recording: Recording) -> Iterator[str]:
    """One note per topic and reason, however much of it there is."""
    counts: Counter[tuple[str, str]] = Counter()
    for garbage in sorted(recording.garbage, key=lambda garbage: (garbage.topic, garbage.reason)):
        counts[garbage.topic, garbage.reason] += garbage.count
    for (topic, reason), count in counts.most_common(MAX_GARBAGE_NOTES):
        yield f"not a message: {shown(topic)} ({shown(reason)})" + (f", {count} times" if count > 1 else "")
    left_out = (recording.run_end or {}).get("foreign_left_out", "0")
    if left_out != "0":
        yield f"left out: {left_out} messages on keys of nobody in the mission"
    if len(counts) > MAX_GARBAGE_NOTES:
        yield f"not messages: {recording.garbage_count} in all, {len(counts)} kinds of them"
