"""UAVs of other clusters, as a head knows them: their fixes of the slot, and hulls of those that it did not hear.

- *heard*: a foreign UAV is at the waypoint of its fix only if that is a fix of the very slot from which the head plans;
- *foreign hull*: otherwise its newest fix, a report of its own cluster's head, or its start, grown by the longest
  step for each slot since. No term counts here: whoever moves it, it flies at most one step in a slot;
- *landed*: what a head of its cluster reports as landed has left the airspace;
- *near*: a head and its standbys hear the fixes of foreign UAVs that can come near within the next slots, no others.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from edc_swarm.agent.knowledge import HullRules, Knowledge
from edc_swarm.mission.braking import change_of
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.vehicle_budget import grown_r_m, vehicle_of
from edc_swarm.planner.interface import ForeignUav, Hull
from edc_swarm.protocol.backing import Backing
from edc_swarm.protocol.messages import Fix, Report, roster_index

NEAR_SLOTS = 16
"""Slots at full speed, of both UAVs, within which a foreign UAV is near."""
MAX_NEAR = 512
"""Most foreign UAVs whose fixes one UAV hears: the nearest ones."""


class Foreign:
    """Knowledge of all UAVs of the mission that are not of one cluster; it is empty in a mission with one cluster."""

    def __init__(self, mission: Mission, cluster: str) -> None:
        others = [entry for entry in mission.roster if entry.cluster != cluster]
        self._roster = {entry.uav: entry for entry in others}
        self._index = roster_index(mission.roster)
        self._knowledge = Knowledge(others, self._index)
        self._backing = Backing(mission)
        self._mission = mission
        self._rules = HullRules(
            {entry.uav: mission.step_m(entry) for entry in others},
            mission.lag_slots,
            {entry.uav: change_of(mission, entry) for entry in others},
        )
        self._r_m = {entry.uav: grown_r_m(mission, entry) for entry in others}
        self._free_m = {entry.uav: vehicle_of(mission, entry).free_mps * mission.dt_s for entry in others}
        step_m = max(mission.steps_m, default=0.0)
        self._near_m = 2 * (max([mission.r_m, *self._r_m.values()]) + NEAR_SLOTS * step_m)
        self._early: dict[str, Report] = {}
        self.near: frozenset[str] = frozenset()

    def __len__(self) -> int:
        """Return the number of UAVs of other clusters."""
        return len(self._roster)

    def __contains__(self, uav: str) -> bool:
        """Return True for a UAV of another cluster."""
        return uav in self._roster

    def hear_fix(self, fix: Fix, slot: int) -> None:
        """Keep a fix of a foreign UAV; `slot` is the receiver's current slot."""
        self._knowledge.hear_fix(fix, slot)

    def hear_report(self, report: Report, slot: int) -> None:
        """Keep the hulls of a foreign head's report, and who has landed by it, if a quorum of its cluster backs it.

        One of a slot after the receiver's `slot` waits for it: its hulls say where UAVs come to, not where they are.
        """
        if not (report.has_quorum and self._backing.backs(report)):
            return
        if report.slot > slot:
            self._early[report.head] = report
        else:
            self._knowledge.hear_report(report)

    def begin_slot(self, slot: int) -> None:
        """Process the fixes and reports that came too early, now that `slot` has begun."""
        self._knowledge.begin_slot(slot)
        for report in [report for report in self._early.values() if report.slot <= slot]:
            del self._early[report.head]
            self._knowledge.hear_report(report)

    def heard(self, slot: int) -> list[ForeignUav]:
        """Return the near UAVs whose fixes of `slot` have come, in roster order."""
        return [self._seen(fix) for fix in self._knowledge.recent(slot) if self._is_heard(fix.uav, slot)]

    def hulls(self, slot: int, *, strays: bool) -> list[Hull]:
        """Return where the others are at the end of `slot`, or in the next slot those that stray, in roster order."""
        return [
            self._hull(uav, slot)
            for uav in self._roster
            if self._knowledge.strays(uav) == strays and not self._is_heard(uav, slot) and not self._is_gone(uav, slot)
        ]

    def look_around(self, slot: int, own: Iterable[tuple[float, float]]) -> frozenset[str]:
        """Return the ids of the foreign UAVs that are near one of the places `own`, by what is known in `slot`."""
        places = list(own)
        if not places or not self._roster:
            return frozenset()
        away = []
        grid = _Grid(places, self._near_m)
        for uav in self._roster:
            if not self._is_gone(uav, slot):
                hull = self._hull(uav, slot)
                span_m = hull.radius_m + math.dist((hull.ax_m, hull.ay_m), (hull.bx_m, hull.by_m))
                distance_m = grid.distance_m((hull.ax_m, hull.ay_m), self._near_m + span_m)
                if distance_m <= self._near_m + span_m:
                    away.append((distance_m - span_m, uav))
        return frozenset(uav for _, uav in sorted(away)[:MAX_NEAR])

    def _is_heard(self, uav: str, slot: int) -> bool:
        return self._knowledge.last_slot(uav) == slot and not self._knowledge.strays(uav)

    def _is_gone(self, uav: str, slot: int) -> bool:
        return self._knowledge.is_on_ground(uav, slot + 1)

    def _hull(self, uav: str, slot: int) -> Hull:
        if self._knowledge.strays(uav):
            return self._knowledge.stray_hull(uav, slot + 1, self._free_m[uav])
        return self._knowledge.place_after(uav, slot, self._rules, self._r_m[uav])

    def _seen(self, fix: Fix) -> ForeignUav:
        here_m, entry = (fix.waypoint_x_m, fix.waypoint_y_m), self._roster[fix.uav]
        aim_m, rest_m = fix.course.aim(entry, here_m, self._rules.u_max_m[fix.uav], self._mission.dt_s)
        return ForeignUav(self._index[fix.uav], here_m, (fix.from_x_m, fix.from_y_m), aim_m, rest_m, fix.r_m)


class _Grid:
    """Places in square cells, for the distance to the nearest one."""

    def __init__(self, places: Sequence[tuple[float, float]], cell_m: float) -> None:
        self._places = places
        self._cell_m = cell_m
        self._cells: dict[tuple[int, int], list[tuple[float, float]]] = {}
        for place in places:
            self._cells.setdefault(self._cell(place), []).append(place)

    def _cell(self, place: tuple[float, float]) -> tuple[int, int]:
        return math.floor(place[0] / self._cell_m), math.floor(place[1] / self._cell_m)

    def distance_m(self, point: tuple[float, float], within_m: float) -> float:
        """Return the distance to the nearest place; above `within_m` it need not be exact."""
        if within_m > self._cell_m:
            return min(math.dist(point, place) for place in self._places)
        column, row = self._cell(point)
        near = (
            math.dist(point, place)
            for i in (column - 1, column, column + 1)
            for j in (row - 1, row, row + 1)
            for place in self._cells.get((i, j), ())
        )
        return min(near, default=math.inf)
