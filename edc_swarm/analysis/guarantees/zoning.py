"""G8: every UAV keeps to the zones of the mission at every instant."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from edc_swarm.analysis.breaches import breaches
from edc_swarm.analysis.guarantees.evidence import Evidence
from edc_swarm.analysis.guarantees.verdict import GuaranteeResult, Violation, not_applicable, verdict
from edc_swarm.geometry import DISC_TOLERANCE_M
from edc_swarm.mission.zone import Zone

_G8 = ("G8", "Zones")


def check_zones(evidence: Evidence) -> GuaranteeResult:
    """Return the verdict on G8: the tracked discs, or their centres, stay inside or outside of each zone.

    Dead UAVs count too, at their last place. Slots in which a UAV's motion is unknown do not count.
    """
    zones = evidence.mission.zone
    if not zones:
        return not_applicable(*_G8, "the mission has no zone")
    return verdict(*_G8, [found for zone in zones for found in _broken(evidence, zone)], evidence.gap_notes())


def _broken(evidence: Evidence, zone: Zone) -> Iterator[Violation]:
    """Yield a violation for each UAV that breaks the zone, with its first slot and its greatest depth."""
    from_m, to_m = evidence.tracks.seen_m
    radius_m = np.array([entry.r_m for entry in evidence.mission.roster])
    known: NDArray[np.bool_] = np.all(np.isfinite(from_m) & np.isfinite(to_m), axis=2)
    # A UAV that stays where it was in the slot before breaks nothing new there.
    known[1:] &= (from_m[1:] != to_m[1:]).any(axis=2) | (from_m[1:] != to_m[:-1]).any(axis=2) | ~known[:-1]
    slot, uav = np.nonzero(known)
    keep_m = radius_m[uav] * zone.keeps_disc
    breach_m, share = breaches(zone, from_m[slot, uav], to_m[slot, uav], keep_m)
    part = "disc" if zone.keeps_disc else "centre"
    where = "outside" if zone.kind == "inclusion" else "in"
    for k in np.unique(uav[breach_m > DISC_TOLERANCE_M]).tolist():
        rows = np.flatnonzero((uav == k) & (breach_m > DISC_TOLERANCE_M))
        first, deepest = rows[0], rows[np.argmax(breach_m[rows])]
        name, depth_m = evidence.tracks.uavs[k], float(breach_m[deepest])
        text = f"{name}: its {part} is {where} zone {zone.name!r} by up to {depth_m:.3g} m (slot {slot[deepest]})"
        time_s = evidence.time_s(int(slot[first]), float(share[first]))
        yield Violation("zone", text, int(slot[first]), [name], time_s, depth_m)
