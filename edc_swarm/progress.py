"""When a mission is over: the same judge for real and simulated missions."""

from __future__ import annotations

import math

from edc_swarm.config import Mission, RosterEntry
from edc_swarm.geometry import capsule_distance_m
from edc_swarm.messages import Fix, Report


class MissionMonitor:
    """Follows fixes and reports, and says when every UAV that still flies is at its target.

    A target that lies under a UAV which moves no more is not waited for.
    """

    def __init__(self, mission: Mission) -> None:
        self._mission = mission
        self._roster = frozenset(entry.uav for entry in mission.roster)
        self._newest: dict[str, Fix] = {}
        self._ended: set[str] = set()
        self.report: Report | None = None

    def hear_fix(self, fix: Fix) -> None:
        """Take in a fix."""
        known = self._newest.get(fix.uav)
        if known is None or fix.slot >= known.slot:
            self._newest[fix.uav] = fix

    def hear_report(self, report: Report) -> None:
        """Take in a report; the newest of the highest term tells who leads."""
        known = self.report
        if not report.is_backed(self._roster, self._mission.quorum):
            return
        if report.has_quorum and (known is None or (report.term, report.slot) >= (known.term, known.slot)):
            self.report = report

    def end(self, uav: str) -> None:
        """Stop waiting for a UAV that is gone for good."""
        self._ended.add(uav)

    def revive(self, uav: str) -> None:
        """Wait for a UAV again that was started anew."""
        self._ended.discard(uav)

    @property
    def head(self) -> str:
        """Id of the head, "" while there is none."""
        return self.report.head if self.report is not None else ""

    @property
    def standbys(self) -> list[str]:
        """Ids of the head's standbys, best first."""
        return self.report.standby if self.report is not None else []

    @property
    def slot(self) -> int:
        """Newest slot of which a fix was heard."""
        return max((fix.slot for fix in self._newest.values()), default=-1)

    @property
    def arrived(self) -> int:
        """Number of UAVs at their targets."""
        return sum(fix.arrived for fix in self._newest.values())

    def complete(self, slot: int) -> bool:
        """Whether the fixes of `slot` show every UAV that still flies where it can get."""
        flying = [entry for entry in self._mission.roster if not self._grounded(entry.uav)]
        return bool(flying) and all(self._there(entry, slot) for entry in flying)

    def _grounded(self, uav: str) -> bool:
        """Whether a UAV moves no more: it is gone, or lost its memory and grants nobody."""
        fix = self._newest.get(uav)
        return uav in self._ended or (fix is not None and not fix.voter)

    def _there(self, entry: RosterEntry, slot: int) -> bool:
        fix = self._newest.get(entry.uav)
        return fix is not None and fix.slot >= slot and (fix.arrived or self._covered(entry))

    def _covered(self, entry: RosterEntry) -> bool:
        """Whether a UAV that moves no more covers this one's target, or may: it is kept clear of."""
        target_m = (entry.target_x_m, entry.target_y_m)
        return any(
            self._distance_m(target_m, other) < entry.r_m + other.r_m
            for other in self._mission.roster
            if other is not entry and self._grounded(other.uav)
        )

    def _distance_m(self, point_m: tuple[float, float], other: RosterEntry) -> float:
        """From a point to where a grounded UAV can be: its hull in the newest report, else its waypoint."""
        report, fix = self.report, self._newest.get(other.uav)
        if report is not None and other.uav in report.hull_uav:
            k = report.hull_uav.index(other.uav)
            a_m, b_m = (report.hull_ax_m[k], report.hull_ay_m[k]), (report.hull_bx_m[k], report.hull_by_m[k])
            return float(capsule_distance_m(point_m, a_m, b_m, report.hull_r_m[k]))
        centre_m = (other.start_x_m, other.start_y_m) if fix is None else (fix.waypoint_x_m, fix.waypoint_y_m)
        return math.dist(point_m, centre_m)
