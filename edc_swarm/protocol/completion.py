"""Completion: the rule that ends a mission, the same for real and simulated missions."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from msgspec import UNSET

from edc_swarm.mission.clusters import cluster_names, cluster_of, of_cluster
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.failsafe import failsafe_of
from edc_swarm.mission.fault_syntax import HEAD, STANDBY
from edc_swarm.mission.faults import Fault, GiveGoal, parse_faults
from edc_swarm.mission.prospect import prospect_of, settled_slot
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.mission.routes import headed
from edc_swarm.protocol.hindrance import Hindrance, Place, Point, hindrances, places_of
from edc_swarm.protocol.messages import Command, Fix, Report

Away = tuple[RosterEntry, Point]
"""A UAV, with its next target, that is at a point away from it."""
STALL_SLOTS = 100
"""Consecutive plans without a move after which no plan will have one.

Guidance has its own rules for UAVs that stand still, the longest of 32 slots.
"""
STILL_SLOTS = 20
"""A UAV whose target is covered waits beside it if it has not moved for this many slots."""
NO_STEP_SHARE = 1e-4
"""Share of the longest step below which a step counts as none: in a jam steps may get shorter without end."""


ANSWER_SLOTS = 2
"""Slots after a goal is given in which its UAV may not have answered yet."""


class ClusterMonitor:
    """Monitor of fixes, commands and reports that decides when the mission of one cluster is over.

    A lifelong mission is never complete, and no mission is before the last goal that its faults give. Any other is
    over when every UAV that still flies is at its target, or kept from it by UAVs that move no more (`content`, see
    `protocol.hindrance`), or when nothing can change any more (`stalled`). With the failsafe a UAV that moves no more
    leaves the airspace, so it keeps no other from its target for good; a stray does, as long as it has a hull. It waits
    for no UAV that a report with a quorum lists as landed.

    Attributes
    ----------
    slot
        Newest slot with a fix, -1 without one.
    report
        Newest report with a quorum, of the highest term; None without one.
    """

    def __init__(self, mission: Mission, faults: Sequence[Fault]) -> None:
        """Take the mission as the cluster flies it (`mission.clusters.of_cluster`), and all faults."""
        self._mission = mission
        self._roster = frozenset(entry.uav for entry in mission.roster)
        self._newest: dict[str, Fix] = {}
        self._moved_slot: dict[str, int] = {}
        self._ended: set[str] = set()
        self._landed: set[str] = set()
        self._settled_slot, self._side = settled_slot(mission, faults), prospect_of(mission, faults).side
        self._failsafe = failsafe_of(mission)
        goal_slots = (math.ceil(fault.at_s / mission.dt_s) for fault in faults if isinstance(fault, GiveGoal))
        self._last_goal_slot = max(goal_slots, default=-ANSWER_SLOTS - 1) + ANSWER_SLOTS
        self._still_m = NO_STEP_SHARE * min(mission.steps_m)
        self._still_plans = 0
        self._planned = (-1, -1)
        self._changed_slot = 0
        self.slot = -1
        self.report: Report | None = None

    def hear_fix(self, fix: Fix) -> None:
        """Process a fix."""
        known = self._newest.get(fix.uav)
        self.slot = max(self.slot, fix.slot)
        if known is None or fix.slot >= known.slot:
            self._newest[fix.uav] = fix
        if self._is_step((fix.from_x_m, fix.from_y_m), (fix.waypoint_x_m, fix.waypoint_y_m)) and fix.executing:
            self._moved_slot[fix.uav] = max(fix.slot, self._moved_slot.get(fix.uav, -1))
            self._change()

    def hear_command(self, command: Command) -> None:
        """Process a command."""
        if self._is_step((command.start_x_m, command.start_y_m), (command.target_x_m, command.target_y_m)):
            self._change()

    def hear_report(self, report: Report) -> None:
        """Process a report; the newest one of the highest term names the head."""
        known = self.report
        if not report.is_backed(self._roster, self._mission.quorum):
            return
        if report.has_quorum and (known is None or (report.term, report.slot) >= (known.term, known.slot)):
            self.report = report
        if report.has_quorum:
            self._landed.update(report.landed)
        if self._failsafe is not None and not set(report.unheard) <= set(report.landed):
            return
        if report.has_quorum and report.slot >= self._settled_slot and (report.term, report.slot) > self._planned:
            self._still_plans = self._still_plans + 1 if report.term == self._planned[0] else 1
            self._planned = (report.term, report.slot)

    def end(self, uav: str) -> None:
        """Stop waiting for a UAV that is gone and will not restart."""
        if uav not in self._ended:
            self._ended.add(uav)
            self._change()

    def revive(self, uav: str) -> None:
        """Wait again for a UAV that has restarted."""
        if uav in self._ended:
            self._ended.discard(uav)
            self._change()

    def fix_of(self, uav: str) -> Fix | None:
        """Return the newest fix of a UAV, None if there is none."""
        return self._newest.get(uav)

    @property
    def grounded(self) -> set[str]:
        """Ids of the UAVs that move no more."""
        return {uav for uav in self._roster if self._grounded(uav)}

    @property
    def head(self) -> str:
        """Id of the head, "" if there is none."""
        return self.report.head if self.report is not None else ""

    @property
    def standbys(self) -> list[str]:
        """Ids of the head's standbys, best first."""
        return self.report.standby if self.report is not None else []

    @property
    def arrived(self) -> int:
        """Number of UAVs at their targets."""
        return sum(fix.arrived for fix in self._newest.values())

    def away(self, slot: int) -> list[Away] | None:
        """Return the flying UAVs that the fixes of `slot` show away from their targets; None if the cluster goes on.

        It does without a fix of `slot` of each flying UAV, and before the last goal.
        """
        if self._mission.goals == "lifelong" or slot <= self._last_goal_slot:
            return None
        flying = [entry for entry in self._mission.roster if not self._grounded(entry.uav)]
        away: list[Away] = []
        for entry in flying:
            fix = self._newest.get(entry.uav)
            if fix is None or fix.slot < slot:
                return None
            if not fix.arrived:
                here_m = (fix.waypoint_x_m, fix.waypoint_y_m)
                away.append((headed(entry, fix.course.left(entry)[0]), here_m))
        return away if flying else None

    def content(self, slot: int, away: Sequence[Away], found: Mapping[str, Hindrance]) -> bool:
        """Return True if each UAV of `away` is unable to get to its target.

        A UAV whose target is covered for good flies to the nearest free place first, and waits there.
        """
        return all(
            entry.uav in found
            and (
                found[entry.uav].kind != "covered"
                or slot - self._moved_slot.get(entry.uav, -STILL_SLOTS) >= STILL_SLOTS
            )
            for entry, _ in away
        )

    def places(self) -> Iterator[Place]:
        """Yield where the UAVs are or can be for good that move no more."""
        for entry in self._mission.roster:
            yield from self._places(entry)

    def stalled(self, slot: int) -> bool:
        """Return True if the fixes, commands and reports until `slot` show that nothing can change any more.

        The mission has stalled if every fault that ends is over and every restart done, and since then

        - a head has made `STALL_SLOTS` consecutive plans of one term without a move, while no UAV moved; or
        - for `STALL_SLOTS` slots too few UAVs were left for a quorum (on one side, if a partition lasts); or
        - in a mission without a head, no UAV has moved for `STALL_SLOTS` slots.

        With the failsafe a plan proves nothing either while a UAV is unheard that has not landed: its hull will go.
        Slots without a plan prove nothing: a planner may be slow, or a network may have no head for long. A plan with
        a move is no standstill, even if its commands come late.
        """
        flying = sum(not self._grounded(uav) for uav in self._side)
        if flying < self._mission.quorum or self._mission.control == "local":
            return slot - max(self._changed_slot, self._settled_slot) >= STALL_SLOTS
        return self._still_plans >= STALL_SLOTS

    def _is_step(self, from_m: tuple[float, float], to_m: tuple[float, float]) -> bool:
        return math.dist(from_m, to_m) > self._still_m

    def _change(self) -> None:
        """Restart the count after a change."""
        self._still_plans = 0
        self._changed_slot = max(self.slot, 0)

    def _grounded(self, uav: str) -> bool:
        """Return True if a UAV moves no more: it is gone, it has landed, or it lost its promise and grants no head.

        A process that is frozen for good cannot say that its UAV has landed; only the reports of its head do.
        """
        fix = self._newest.get(uav)
        return uav in self._ended or uav in self._landed or (fix is not None and not fix.voter)

    def _places(self, other: RosterEntry) -> Iterator[Place]:
        """Yield where a UAV is or can be for good, if it moves no more."""
        fix = self._newest.get(other.uav)
        strays = fix is not None and fix.stray_m is not UNSET
        if not self._grounded(other.uav) or (self._failsafe is not None and not strays):
            return
        centre_m = (other.start_x_m, other.start_y_m) if fix is None else (fix.waypoint_x_m, fix.waypoint_y_m)
        found = places_of(other, centre_m, self.report, step_m=self._mission.step_m(other))
        yield from (place for place in found if not strays or place.what == "hull")


class MissionMonitor:
    """Monitor of a whole mission: it is over when it is over for each of its clusters (`ClusterMonitor`).

    A cluster that is complete waits for the others. Where one cluster has stalled, all others have to be complete or
    stalled too, since they may still make way for it. UAVs that move no more are in the way of every cluster.
    """

    def __init__(self, mission: Mission) -> None:
        self._cluster, self._zones = cluster_of(mission), mission.zone
        faults, names = parse_faults(mission), cluster_names(mission.roster)
        self.clusters = {name: ClusterMonitor(of_cluster(mission, name), faults) for name in names}

    def hear_fix(self, fix: Fix) -> None:
        """Process a fix."""
        self._of(fix.uav).hear_fix(fix)

    def hear_command(self, command: Command) -> None:
        """Process a command."""
        self._of(command.uav).hear_command(command)

    def hear_report(self, report: Report) -> None:
        """Process a report."""
        self._of(report.head).hear_report(report)

    def end(self, uav: str) -> None:
        """Stop waiting for a UAV that is gone and will not restart."""
        self._of(uav).end(uav)

    def revive(self, uav: str) -> None:
        """Wait again for a UAV that has restarted."""
        self._of(uav).revive(uav)

    def fix_of(self, uav: str) -> Fix | None:
        """Return the newest fix of a UAV, None if there is none."""
        return self._of(uav).fix_of(uav)

    @property
    def slot(self) -> int:
        """Newest slot with a fix, -1 without one."""
        return max(cluster.slot for cluster in self.clusters.values())

    @property
    def report(self) -> Report | None:
        """Newest report with a quorum of the first cluster's highest term; None without one."""
        return next(iter(self.clusters.values())).report

    @property
    def grounded(self) -> set[str]:
        """Ids of the UAVs that move no more."""
        return set().union(*(cluster.grounded for cluster in self.clusters.values()))

    @property
    def head(self) -> str:
        """Id of the head of the first cluster, "" if there is none."""
        return next(iter(self.clusters.values())).head

    @property
    def standbys(self) -> list[str]:
        """Ids of that head's standbys, best first."""
        return next(iter(self.clusters.values())).standbys

    @property
    def in_office(self) -> dict[str, str]:
        """Ids that `head-NAME` and `standby-NAME` stand for in a fault, by these words; "" for nobody."""
        said: dict[str, str] = {}
        for name, cluster in self.clusters.items():
            said[f"{HEAD}-{name}"], said[f"{STANDBY}-{name}"] = cluster.head, next(iter(cluster.standbys), "")
        return said

    @property
    def arrived(self) -> int:
        """Number of UAVs at their targets."""
        return sum(cluster.arrived for cluster in self.clusters.values())

    def complete(self, slot: int) -> bool:
        """Return True if the mission of every cluster is complete in `slot`."""
        return len(self._complete(slot)) == len(self.clusters)

    def stalled(self, slot: int) -> bool:
        """Return True if a cluster has stalled, and every other one has stalled or is complete."""
        over = {name for name, cluster in self.clusters.items() if cluster.stalled(slot)}
        return bool(over) and over | self._complete(slot) == self.clusters.keys()

    def _complete(self, slot: int) -> set[str]:
        """Return the clusters whose mission is complete in `slot`."""
        away = {name: each for name, cluster in self.clusters.items() if (each := cluster.away(slot)) is not None}
        astray = [pair for pairs in away.values() for pair in pairs]
        places = [place for cluster in self.clusters.values() for place in cluster.places()] if astray else []
        found = hindrances(astray, places, self._zones) if places else {}
        return {name for name, pairs in away.items() if self.clusters[name].content(slot, pairs, found)}

    def _of(self, uav: str) -> ClusterMonitor:
        """Return the monitor of a UAV's cluster; of the first one for a UAV that is not in the roster."""
        clusters = self.clusters
        return clusters.get(self._cluster.get(uav, ""), next(iter(clusters.values())))
