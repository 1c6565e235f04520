"""G5: the recording contains every published message, or the verdict names the missing ones."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

from msgspec.structs import replace

from edc_swarm.analysis.guarantees.evidence import Evidence
from edc_swarm.analysis.guarantees.fencing import absent_commands
from edc_swarm.analysis.guarantees.heads import absent_grants
from edc_swarm.analysis.guarantees.verdict import GuaranteeResult, Violation, not_judged, verdict
from edc_swarm.foreign_text import shown
from edc_swarm.mission.roles import OPERATOR
from edc_swarm.protocol.codec import MISPLACED
from edc_swarm.protocol.events import EventKind
from edc_swarm.recording.ends import Ends
from edc_swarm.recording.model import MAX_DIGITS, Recording
from edc_swarm.recording.sequences import Gap, sequence_numbers, unknown_tails

_G5 = ("G5", "No loss in the record")
MAX_GARBAGE_NOTES = 20
MESSAGES = "messages"
"""Fact of `run_end`: how many messages were written."""
VIEWERS = "/viz/"
MAX_CUT = 6
"""Most publishers without a last word that the verdict names; a note names each."""
MAX_TOPICS = 5
MAX_TOPIC = 60
"""Most characters of a topic that a note quotes."""


def check_no_loss(evidence: Evidence) -> GuaranteeResult:
    """Return the verdict on G5.

    ==============================================  =======================================================
    Finding                                         Verdict
    ==============================================  =======================================================
    Sequence gap, or a number recorded twice        broken
    Recorder counted more messages than it wrote    broken
    A part of the file is unreadable                broken
    Recorder dropped messages                       broken, unless the numbers prove that it fetched them all
    No `closed` event, a fault ended the publisher  held, up to its last recorded message
    No message of a UAV killed after its start      not judged
    Others name what a killed UAV may have said     not judged
    A killed UAV's streams end apart                not judged
    A killed head said nothing of taking office     not judged
    No `closed` event, for any other reason         not judged
    ==============================================  =======================================================
    """
    recording = evidence.recording
    found = [_lost(gap) for gap in evidence.gaps]
    found += _uncounted(recording)
    found += [Violation("unreadable", problem) for problem in recording.problems]
    notes = list(_unknown_tails(recording))
    dropped = (recording.run_end or {}).get("dropped", "0")
    if dropped != "0" and not (evidence.gaps or notes):
        notes.append(f"the recorder dropped {dropped} messages, and fetched all of them later")
    elif dropped != "0":
        found.append(Violation("dropped", f"the recorder dropped {dropped} messages"))
    notes += [*_unfinished(evidence), *_misplaced(recording), *_garbage(recording), *_unknown_topics(recording)]
    if recording.duplicates:
        notes.append(f"duplicates: {recording.duplicates} messages are in the file again, bit by bit; each counts once")
    if not found and (why := unproved(evidence)):
        return not_judged(*_G5, why, notes)
    if found or not evidence.ends.without_last_word:
        return verdict(*_G5, found, notes)
    return replace(verdict(*_G5, [], notes), scope=f"up to the last recorded message {shown(_cut(evidence.ends))}")


def _cut(ends: Ends) -> str:
    """Name the publishers without a last word; of one that started again, each process that was killed lacks it."""
    once, again = sorted(ends.without_last_word - ends.replaced), sorted(ends.without_last_word & ends.replaced)
    parts = [f"of {_listed(once)}"] if once else []
    parts += [f"of each killed process of {_listed(again)}"] if again else []
    return " and ".join(parts)


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:MAX_CUT]) + (f" and {len(names) - MAX_CUT} more" if len(names) > MAX_CUT else "")


def _uncounted(recording: Recording) -> Iterator[Violation]:
    """Yield a violation if the file holds fewer messages than the recorder counted."""
    counted = (recording.run_end or {}).get(MESSAGES, "")
    there = recording.message_count + recording.garbage_count + sum(recording.unknown.values()) + recording.duplicates
    if counted.isdecimal() and len(counted) <= MAX_DIGITS and int(counted) > there:
        yield Violation("count", f"{counted} messages were recorded, {there} are in the file")


def unproved(evidence: Evidence) -> str:
    """Return why the numbers prove nothing, "" where they do."""
    recording = evidence.recording
    if not sequence_numbers(recording):
        return "no message carries a number"
    closed = {(event.source, event.instance) for event in recording.events if event.kind == EventKind.CLOSED}
    if not closed:
        return "no publisher sent a `closed` event"
    told = any(event.source == OPERATOR for event in recording.events)
    speaking = sorted(evidence.ends.unended | (set() if told else {OPERATOR}))
    if speaking:
        more = f" and {len(speaking) - 1} more" if len(speaking) > 1 else ""
        if speaking[0] in evidence.ends.unheard:
            return f"no message of a process of {speaking[0]}{more} that lived for so long that it has spoken"
        return f"no `closed` event of {speaking[0]}{more}, and no recorded fault that ended it"
    reasons = []
    if untold := sorted(frozenset[str]().union(*evidence.untold.values())):
        reasons.append(f"by its other messages a killed process of {shown(_listed(untold))} has said more")
    if mute := _mute_heads(evidence):
        reasons.append(f"a killed process of {shown(_listed(mute))} led, and no event says that it took office")
    commands, grants = absent_commands(evidence), absent_grants(evidence)
    if commands or grants:
        reasons.append(f"fixes name {commands} commands and reports name {grants} grants that are not recorded")
    return "; ".join(reasons)


def _mute_heads(evidence: Evidence) -> list[str]:
    """Return the UAVs of which a killed process has led without any recorded event: it has published one before."""
    recording = evidence.recording
    led = {(plan.head, plan.instance) for plan in evidence.plans}
    led |= {(command.head, command.instance) for command in recording.commands}
    told = {(event.source, event.instance) for event in recording.events}
    return sorted({uav for uav, _ in (led & evidence.ends.cut) - told})


def _unfinished(evidence: Evidence) -> Iterator[str]:
    """Yield the last recorded slot if the recording lacks the end of its mission."""
    recording = evidence.recording
    said = {event.kind for event in recording.events if event.source == OPERATOR}
    if not said & {EventKind.END, EventKind.CLOSED}:
        slot = max((fix.slot for fix in recording.fixes), default=-1)
        yield f"the record ends at slot {slot}, without the end of the mission" if slot >= 0 else "no slot is recorded"


def _unknown_topics(recording: Recording) -> Iterator[str]:
    """Yield a note on the topics that the protocol does not define; the topics of viewers count as defined."""
    strange = Counter({t: n for t, n in recording.unknown.items() if not t.startswith(VIEWERS)})
    if strange:
        named = ", ".join(f"{topic[:MAX_TOPIC]!r} ({count})" for topic, count in strange.most_common(MAX_TOPICS))
        more = ", ..." if len(strange) > MAX_TOPICS else ""
        yield f"unknown topics: {len(strange)} with {strange.total()} messages: {named}{more}"


def _lost(gap: Gap) -> Violation:
    publisher = f"{gap.key} of {gap.instance or 'unnamed'}"
    if gap.duplicate:
        return Violation("duplicate", f"{publisher}: message {gap.first} is recorded more than once")
    return Violation("gap", f"{publisher}: messages {gap.first} to {gap.last} are missing ({gap.count})")


def _unknown_tails(recording: Recording) -> Iterator[str]:
    """Yield one note per publisher without a `closed` event."""
    keys: dict[str, list[str]] = {}
    for key, instance in unknown_tails(recording):
        keys.setdefault(instance or "unnamed", []).append(key)
    for instance, silent in keys.items():
        more = f" and {len(silent) - 1} more" if len(silent) > 1 else ""
        yield f"end unknown: the last messages on {silent[0]}{more} may be missing, no `closed` event of {instance}"


def _misplaced(recording: Recording) -> Iterator[str]:
    """Say how many messages stand under a key that their content does not name."""
    found = [garbage for garbage in recording.garbage if garbage.reason == MISPLACED]
    if found:
        first = min(found, key=lambda garbage: (garbage.log_time_ns, garbage.topic))
        count = sum(garbage.count for garbage in found)
        yield f"recorded under the key of another: {count} messages, the first under {shown(first.topic)}"


def _garbage(recording: Recording) -> Iterator[str]:
    """Yield one note per topic and reason of garbage."""
    counts: Counter[tuple[str, str]] = Counter()
    for garbage in sorted(recording.garbage, key=lambda garbage: (garbage.topic, garbage.reason)):
        if garbage.reason != MISPLACED:
            counts[garbage.topic, garbage.reason] += garbage.count
    for (topic, reason), count in counts.most_common(MAX_GARBAGE_NOTES):
        yield f"not a message: {shown(topic)} ({shown(reason)})" + (f", {count} times" if count > 1 else "")
    left_out = (recording.run_end or {}).get("foreign_left_out", "0")
    if left_out != "0":
        yield f"left out: {left_out} messages on foreign keys"
    if len(counts) > MAX_GARBAGE_NOTES:
        yield f"not messages: {recording.garbage_count} in all, {len(counts)} kinds of them"
