"""When a mission is over: the same judge for real and simulated missions."""

from __future__ import annotations

from edc_swarm.config import Mission
from edc_swarm.messages import Fix, Report


class MissionMonitor:
    """Follows fixes and reports, and says when every UAV that still flies is at its target."""

    def __init__(self, mission: Mission) -> None:
        self._mission = mission
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
        """Whether the fixes of `slot` show every UAV that still flies at its target."""
        flying = [entry.uav for entry in self._mission.roster if entry.uav not in self._ended]
        fixes = (self._newest.get(uav) for uav in flying)
        return bool(flying) and all(fix is not None and fix.slot >= slot and fix.arrived for fix in fixes)
