"""Messages of killed processes that are certainly missing from a recording, by what others and they themselves said.

A killed process has no last word, so no sequence number tells how many messages followed the last recorded one.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import zip_longest

from edc_swarm.mission.autopilots import autopilots
from edc_swarm.protocol.messages import Fix, Report
from edc_swarm.recording.ends import Ends
from edc_swarm.recording.model import Recording


def unspoken_spans(fixes: Mapping[str, Sequence[Fix]], ends: Ends) -> dict[str, list[tuple[int, float]]]:
    """Return, by UAV, the slots of the last fix of each process that was cut off, and of the first of its successor."""
    spans: dict[str, list[tuple[int, float]]] = {
        uav: [(-1, math.inf)] for uav in ends.without_last_word if not fixes.get(uav)
    }
    for uav in ends.without_last_word & fixes.keys():
        for fix, following in zip_longest(fixes[uav], fixes[uav][1:]):
            if (uav, fix.instance) in ends.cut and (following is None or following.instance != fix.instance):
                spans.setdefault(uav, []).append((fix.slot, following.slot if following else math.inf))
    return spans


def untold_of(
    recording: Recording, ends: Ends, plans: Sequence[Report], spans: Mapping[str, Sequence[tuple[int, float]]]
) -> dict[str, set[str]]:
    """Return, by kind, the UAVs of which the last messages of a process without a last word are missing.

    In each slot a process publishes its truth and its fix, in a crowd the truth last; a head the commands for the next
    slot to all that it has heard, then its report. In one slot, its last, it may die in between, or land with a truth
    alone. Autopilots report later. `spans` are those of `unspoken_spans`.
    """
    if not ends.cut:
        return {}
    truths = _slots_of(ends, (((truth.uav, truth.instance), truth.slot) for truth in recording.truths))
    fixes = _slots_of(ends, (((fix.uav, fix.instance), fix.slot) for fix in recording.fixes))
    orders = [((c.head, c.instance), c.uav, c.slot - 1) for c in recording.commands]
    planned = _slots_of(ends, ((who, slot) for who, _, slot in orders))
    reports = _slots_of(ends, (((report.head, report.instance), report.slot) for report in recording.reports))
    ordered = _slots_of(ends, (((*who, uav), slot) for who, uav, slot in orders))
    reported = _slots_of(ends, (((r.head, r.instance, uav), r.slot) for r in plans for uav in r.heard))
    later = autopilots(recording.mission).keys()
    return {
        "truth": {who[0] for who, slots in fixes.items() if _more(slots, truths.get(who)) > 1} - later,
        "fix": ({who[0] for who, slots in truths.items() if _more(slots, fixes.get(who)) > 1} - later)
        | _granting(plans, spans),
        "command": {who[0] for who, slots in reported.items() if _more(slots, ordered.get(who))},
        "report": {who[0] for who, slots in planned.items() if _more(slots, reports.get(who)) > 1},
    }


def _granting(plans: Sequence[Report], spans: Mapping[str, Sequence[tuple[int, float]]]) -> set[str]:
    """Return the UAVs whose grants stand behind plans of more than one slot after their last fix."""
    silent = {uav: before for uav, found in spans.items() for before, after in found if after == math.inf}
    granted: dict[str, set[int]] = {}
    for report in plans if silent else ():
        for uav in silent.keys() & set(report.grants):
            if report.slot > silent[uav]:
                granted.setdefault(uav, set()).add(report.slot)
    return {uav for uav, slots in granted.items() if len(slots) > 1}


def _slots_of(ends: Ends, said: Iterable[tuple[tuple[str, ...], int]]) -> dict[tuple[str, ...], set[int]]:
    """Return the slots in which each process without a last word said something (to a UAV: id, instance, UAV)."""
    slots: dict[tuple[str, ...], set[int]] = {}
    for who, slot in said:
        if who[:2] in ends.cut:
            slots.setdefault(who, set()).add(slot)
    return slots


def _more(slots: set[int], others: set[int] | None) -> int:
    """Return how many of `slots` come after the last of `others`."""
    last = max(others or (), default=-1)
    return sum(slot > last for slot in slots)
