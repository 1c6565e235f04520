"""Guarantees of several clusters: G1 and G7 are promises of each cluster, all others of the airspace as a whole.

G7 promises nothing to a cluster in two cases besides its own: a partition between clusters never heals, so each of
them keeps clear of wherever UAVs of the other can be; or another cluster has no quorum left, so nobody says
where its UAVs are. In both cases a cluster that completes all the same has held it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from edc_swarm.analysis.guarantees.evidence import Evidence, gather
from edc_swarm.analysis.guarantees.progress import PROGRESS, away_of, places_without, points_of
from edc_swarm.analysis.guarantees.verdict import GuaranteeResult, Violation, not_applicable, not_judged, verdict
from edc_swarm.analysis.living import living_at_end
from edc_swarm.analysis.voyages import voyages_of
from edc_swarm.mission.clusters import cluster_of
from edc_swarm.mission.fault_targets import resolve
from edc_swarm.mission.faults import Heal, Partition, parse_faults
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.protocol.hindrance import Point
from edc_swarm.recording.by_cluster import by_cluster

T = TypeVar("T")
Checker = Callable[[Evidence], GuaranteeResult]


def parts_of(evidence: Evidence) -> dict[str, Evidence]:
    """Return the evidence of each cluster by name, which knows the faults and the obstacles of the whole mission."""
    recordings = by_cluster(evidence.recording)
    parts = {name: replace(gather(part), whole=evidence.mission) for name, part in recordings.items()}
    if len(parts) == 1:
        return parts
    living = {name: living_at_end(part.recording, part.tracks) for name, part in parts.items()}
    places = {name: [*places_without(part, living[name])] for name, part in parts.items()}
    away = {name: _astray(part, living[name]) for name, part in parts.items()}
    return {
        name: replace(part, foreign=_of_others(name, places), foreign_away=_of_others(name, away))
        for name, part in parts.items()
    }


def _astray(evidence: Evidence, living: NDArray[np.bool_]) -> list[tuple[RosterEntry, Point]]:
    voyages = voyages_of(evidence.recording, evidence.tracks)
    return points_of(evidence, voyages, away_of(evidence, voyages, living))


def _of_others(name: str, each: Mapping[str, Sequence[T]]) -> list[T]:
    return [found for other, listed in each.items() if other != name for found in listed]


def of_each(parts: Mapping[str, Evidence], checker: Checker) -> GuaranteeResult:
    """Return the verdict of a checker on every cluster, as one."""
    results = {name: checker(part) for name, part in parts.items()}
    return _joined({name: _excused(result, name, parts) for name, result in results.items()})


def _excused(result: GuaranteeResult, name: str, parts: Mapping[str, Evidence]) -> GuaranteeResult:
    """Return the verdict on one cluster, "not applicable" where another one can keep it away for good."""
    if result.guarantee != PROGRESS or not result.broken or any(v.kind != "not-arrived" for v in result.violations):
        return result
    if why := _cut_off(parts[name]):
        return not_applicable(result.guarantee, result.title, why)
    for other, part in parts.items():
        living = living_at_end(part.recording, part.tracks)
        if other != name and living.sum() < part.mission.quorum:
            return not_applicable(result.guarantee, result.title, f"cluster {other} has no quorum left")
    return result


def _cut_off(evidence: Evidence) -> str:
    """Name a partition between clusters that never heals, if there is one."""
    mission, faults = evidence.whole, parse_faults(evidence.whole)
    clusters, roster = cluster_of(mission), [entry.uav for entry in mission.roster]
    for fault in faults:
        if not isinstance(fault, Partition) or math.isfinite(fault.end_s):
            continue
        if any(isinstance(other, Heal) and other.at_s >= fault.at_s for other in faults):
            continue
        cut = resolve(fault, "", [], roster)
        sides = (*cut.left, *cut.right) if isinstance(cut, Partition) else roster
        if len({clusters[uav] for uav in sides}) > 1:
            return f"'{fault}' never heals, and cuts clusters off from each other"
    return ""


def _joined(results: Mapping[str, GuaranteeResult]) -> GuaranteeResult:
    first = next(iter(results.values()))
    notes = [f"cluster {name}: {note}" for name, result in results.items() for note in result.notes]
    found = [_named(name, violation) for name, result in results.items() for violation in result.violations]
    if found:
        return verdict(first.guarantee, first.title, found, notes)
    unjudged = [name for name, result in results.items() if not result.judged]
    if unjudged:
        return not_judged(first.guarantee, first.title, f"not judged of {', '.join(unjudged)}", notes)
    if all(result.status == "not-applicable" for result in results.values()):
        return not_applicable(first.guarantee, first.title, "; ".join(notes))
    return verdict(first.guarantee, first.title, [], notes)


def _named(name: str, violation: Violation) -> Violation:
    return Violation(
        violation.kind,
        f"cluster {name}: {violation.text}",
        violation.slot,
        violation.uavs,
        violation.time_s,
        violation.value_m,
    )
