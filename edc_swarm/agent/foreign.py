"""UAVs of other clusters, as a head knows them: their fixes of the slot, and hulls of those that it did not hear.

- *heard*: a foreign UAV is at the waypoint of its fix only if that is a fix of the very slot from which the head plans;
- *foreign hull*: otherwise its newest fix, a report of its own cluster's head, or its start, grown by the longest
  step for each slot since. No term counts here: whoever moves it, it flies at most one step in a slot;
- *landed*: what a head of its cluster reports as landed has left the airspace;
- *near*: a head and its standbys hear the fixes of foreign UAVs that can come near within the next slots, no others.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from functools import cached_property

from edc_swarm.agent.knowledge import HullRules, Knowledge
from edc_swarm.mission.braking import braking_m, change_of
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.field_types import Point
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.mission.vehicle_budget import grown_r_m, vehicle_of
from edc_swarm.planner.interface import ForeignUav, Hull
from edc_swarm.protocol.backing import Backing
from edc_swarm.protocol.messages import Fix, Report, roster_index

NEAR_SLOTS = 16
"""Slots at full speed, of both UAVs, within which a foreign UAV is near."""
LOOK_SLOTS = 4
"""Slots from one look for near UAVs to the next one."""
MAX_NEAR = 512
"""Most foreign UAVs whose fixes one UAV hears: the nearest ones."""


class Foreign:
    """Knowledge of all UAVs of the mission that are not of one cluster; it is empty in a mission with one cluster."""

    def __init__(self, mission: Mission, cluster: str) -> None:
        self._mission = mission
        self._own = frozenset(entry.uav for entry in mission.roster if entry.cluster == cluster)
        self._next_look = 0
        self._early: dict[str, Report] = {}
        self.near: frozenset[str] = frozenset()

    # Most UAVs never lead. Tables of all others for each UAV of a large mission would cost K^2.

    @cached_property
    def _roster(self) -> dict[str, RosterEntry]:
        return {entry.uav: entry for entry in self._mission.roster if entry.uav not in self._own}

    @cached_property
    def _knowledge(self) -> Knowledge:
        return Knowledge(list(self._roster.values()), roster_index(self._mission.roster))

    @cached_property
    def _backing(self) -> Backing:
        return Backing(self._mission)

    @cached_property
    def _rules(self) -> HullRules:
        mission, others = self._mission, self._roster
        steps_m = {uav: mission.step_m(entry) for uav, entry in others.items()}
        changes_m = {uav: change_of(mission, entry) for uav, entry in others.items()}
        return HullRules(steps_m, mission.lag_slots, changes_m)

    @cached_property
    def _r_m(self) -> dict[str, float]:
        return {uav: grown_r_m(self._mission, entry) for uav, entry in self._roster.items()}

    @cached_property
    def _free_m(self) -> dict[str, float]:
        mission = self._mission
        return {uav: vehicle_of(mission, entry).free_mps * mission.dt_s for uav, entry in self._roster.items()}

    @cached_property
    def _near_m(self) -> float:
        mission = self._mission
        step_m = max(mission.steps_m, default=0.0)
        brake_m = max((braking_m(step_m, change_of(mission, entry)) for entry in mission.roster), default=0.0)
        # More than two UAVs can close in by in a slot: their steps, and the braking paths before and after them.
        return 2 * (max([mission.r_m, *self._r_m.values()]) + NEAR_SLOTS * step_m + 2 * brake_m)

    def __len__(self) -> int:
        """Return the number of UAVs of other clusters."""
        return len(self._mission.roster) - len(self._own)

    def __contains__(self, uav: str) -> bool:
        """Return True for a UAV of another cluster."""
        return uav not in self._own and uav in self._roster

    def hear_fix(self, fix: Fix, slot: int) -> None:
        """Keep a fix of a foreign UAV; `slot` is the receiver's current slot."""
        self._knowledge.hear_fix(fix, slot)

    def hear_report(self, report: Report, slot: int) -> None:
        """Keep the hulls of a foreign head's report, and who has landed by it, if a quorum of its cluster backs it.

        One of a slot after the receiver's `slot` waits for it: its hulls say where UAVs come to, not where they are.
        """
        if not self._backing.is_plan(report):
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

    def hulls(self, slot: int, *, strays: bool, own: Collection[Point] = ()) -> list[Hull]:
        """Return where the others are at the end of `slot`, or in the next slot those that stray, in roster order.

        Hulls that no UAV at one of the places `own` can come near are left out, if there are such places.
        """
        box_m = _box_m(own)
        return [
            self._hull(uav, slot)
            for uav in self._roster
            if not (self._is_heard(uav, slot) or self._is_gone(uav, slot))
            and self._knowledge.strays(uav) == strays
            and not self._is_far(uav, slot, box_m)
        ]

    def look_around(self, slot: int, own: Collection[Point]) -> None:
        """Note in `near` the foreign UAVs that are near one of the places `own`, every `LOOK_SLOTS` slots."""
        if not own or not len(self):
            self.near, self._next_look = frozenset(), 0
        elif slot >= self._next_look:
            self.near, self._next_look = self._find_near(slot, own), slot + LOOK_SLOTS

    def _find_near(self, slot: int, own: Collection[Point]) -> frozenset[str]:
        near, box_m = [], _box_m(own)
        for uav in self._roster:
            if self._is_gone(uav, slot) or self._is_far(uav, slot, box_m):
                continue
            hull = self._hull(uav, slot)
            here_m, end_m = (hull.ax_m, hull.ay_m), (hull.bx_m, hull.by_m)
            away_m = min(math.dist(here_m, place_m) for place_m in own) - math.dist(here_m, end_m) - hull.radius_m
            if away_m <= self._near_m:
                near.append((away_m, uav))
        return frozenset(uav for _, uav in sorted(near)[:MAX_NEAR])

    def _is_far(self, uav: str, slot: int, box_m: tuple[Point, Point] | None) -> bool:
        """Return True if a UAV cannot be near a rectangle, by its newest fix or its start alone, which is soon said."""
        if box_m is None or self._knowledge.strays(uav):
            return False
        fix, entry, step_m = self._knowledge.newest.get(uav), self._roster[uav], self._rules.u_max_m[uav]
        x_m, y_m = (entry.start_x_m, entry.start_y_m) if fix is None else (fix.waypoint_x_m, fix.waypoint_y_m)
        slots = slot - (-1 if fix is None else fix.slot)
        # Its last step leads to the waypoint; no braking path is longer than after a step at full speed.
        span_m = step_m + self._rules.reach_m(uav, max(slots, 1), step_m)
        (left_m, low_m), (right_m, high_m) = box_m
        away_m = max(left_m - x_m, x_m - right_m, low_m - y_m, y_m - high_m)
        return away_m > self._near_m + span_m

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
        return ForeignUav(self._knowledge.index[fix.uav], here_m, (fix.from_x_m, fix.from_y_m), aim_m, rest_m, fix.r_m)


def _box_m(places: Collection[Point]) -> tuple[Point, Point] | None:
    """Return the lower left and upper right corner of the rectangle around places; None if there are none."""
    if not places:
        return None
    xs_m, ys_m = zip(*places, strict=True)
    return (min(xs_m), min(ys_m)), (max(xs_m), max(ys_m))
