"""UAVs of other clusters, as a head knows them: their fixes of the slot, and hulls of those that it did not hear.

- *heard*: a foreign UAV is at the waypoint of its fix only if that is a fix of the very slot from which the head plans;
- *foreign hull*: otherwise its newest fix, a report of its own cluster's head, or its start, grown by the longest
  step for each slot since. No term counts here: whoever moves it, it flies at most one step in a slot;
- *landed*: what a head of its cluster reports as landed has left the airspace;
- *near*: a head and its standbys hear the fixes of foreign UAVs that can come near within the next slots, no others;
- *awaited*: a head waits for near UAVs that it has heard lately as it waits for its own, and no longer.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Set
from functools import cached_property
from typing import TYPE_CHECKING, Any

from edc_swarm.agent.knowledge import ABSENT_SLOTS, Knowledge
from edc_swarm.agent.mission_tables import MissionTables
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.field_types import Point
from edc_swarm.planner.interface import ForeignUav, Hull
from edc_swarm.protocol.messages import Fix, Message, Report

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

NEAR_SLOTS = 16
"""Slots at full speed, of both UAVs, within which a foreign UAV is near."""
LOOK_SLOTS = 4
"""Slots from one look for near UAVs to the next one."""
SLACK_M = 1e-3
"""More than rounding changes of a distance."""
MAX_NEAR = 512
"""Most foreign UAVs whose fixes one UAV hears: the nearest ones."""


class Foreign:
    """Knowledge of all UAVs of the mission that are not of one cluster; it is empty in a mission with one cluster.

    Attributes
    ----------
    tables
        Tables of the whole mission.
    near
        UAVs whose fixes this one needs as head, or soon may need.
    awaited
        Near UAVs that were heard lately, and are not heard in this slot yet.
    """

    def __init__(self, mission: Mission, cluster: str, tables: MissionTables[Any] | None = None) -> None:
        self._mission = mission
        self.tables = tables if tables is not None else MissionTables(mission)
        self._own = self.tables.members(cluster).keys()
        self._next_look = 0
        self._early: dict[str, Report] = {}
        self.near: frozenset[str] = frozenset()
        self.awaited: set[str] = set()

    # Most UAVs never lead. Tables of all others for each UAV of a large mission would cost K^2.

    @cached_property
    def _knowledge(self) -> Knowledge:
        return Knowledge(self.tables.entries, self.tables.index)

    @cached_property
    def _newest(self) -> NDArray[np.float64]:
        """Place and slot of the newest fix of every UAV, a column each; without one the start, and -1."""
        import numpy as np  # noqa: PLC0415 - a UAV that is not in office starts without it

        starts_m = self.tables.starts_m
        return np.vstack([starts_m, np.full(starts_m.shape[1], -1.0)])

    @cached_property
    def _near_m(self) -> float:
        step_m, brake_m = self.tables.longest_m
        widest_m = max((r_m for uav, r_m in self.tables.r_m.items() if uav not in self._own), default=0.0)
        # More than two UAVs can close in by in a slot: their steps, and the braking paths before and after them.
        return 2 * (max(self._mission.r_m, widest_m) + NEAR_SLOTS * step_m + 2 * brake_m)

    def __len__(self) -> int:
        """Return the number of UAVs of other clusters."""
        return len(self._mission.roster) - len(self._own)

    def __contains__(self, uav: str) -> bool:
        """Return True for a UAV of another cluster."""
        return uav not in self._own and uav in self.tables.entries

    def hear(self, message: Message, slot: int) -> bool:
        """Keep what a UAV of another cluster says; return False for any other message."""
        match message:
            case Fix() if message.uav in self:
                self.hear_fix(message, slot)
            case Report() if message.head in self:
                self.hear_report(message, slot)
            case _:
                return False
        return True

    def hear_fix(self, fix: Fix, slot: int) -> None:
        """Keep a fix of a foreign UAV; `slot` is the receiver's current slot."""
        self._knowledge.hear_fix(fix, slot)
        self._note(fix.uav)
        if self._knowledge.last_slot(fix.uav) >= slot:
            self.awaited.discard(fix.uav)

    def _note(self, uav: str) -> None:
        fix = self._knowledge.newest.get(uav)
        if fix is not None:
            self._newest[:, self.tables.index[uav]] = fix.waypoint_x_m, fix.waypoint_y_m, fix.slot

    def hear_report(self, report: Report, slot: int) -> None:
        """Keep the hulls of a foreign head's report, and who has landed by it, if a quorum of its cluster backs it.

        One of a slot after the receiver's `slot` waits for it: its hulls say where UAVs come to, not where they are.
        """
        if not self.tables.backing.is_plan(report):
            return
        if report.slot > slot:
            self._early[report.head] = report
        else:
            self._knowledge.hear_report(report)

    def begin_slot(self, slot: int) -> None:
        """Process the fixes and reports that came too early, now that `slot` has begun."""
        for uav in self._knowledge.begin_slot(slot):
            self._note(uav)
        for report in [report for report in self._early.values() if report.slot <= slot]:
            del self._early[report.head]
            self._knowledge.hear_report(report)

    def heard(self, slot: int) -> list[ForeignUav]:
        """Return the near UAVs whose fixes of `slot` have come, in roster order."""
        found = [fix for fix in self._knowledge.newest.values() if fix.slot >= slot and self._is_heard(fix.uav, slot)]
        return [self._seen(fix) for fix in sorted(found, key=lambda fix: self.tables.index[fix.uav])]

    def hulls(self, slot: int, *, strays: bool, own: Collection[Point] = ()) -> list[Hull]:
        """Return where the others are at the end of `slot`, or in the next slot those that stray, in roster order.

        Hulls that no UAV at one of the places `own` can come near are left out, if there are such places.
        """
        box_m = _box_m(own)
        return [
            self._hull(uav, slot)
            for uav in (self._in_order(self._knowledge.straying) if strays else self._candidates(slot, box_m))
            if not (self._is_heard(uav, slot) or self._knowledge.is_on_ground(uav, slot + 1))
            and self._knowledge.strays(uav) == strays
            and not self._is_far(uav, slot, box_m)
        ]

    def look_around(self, slot: int, own: Collection[Point]) -> None:
        """Note in `near` who is near one of the places `own`, every `LOOK_SLOTS` slots, and await them in this slot."""
        if not own or not len(self):
            self.near, self._next_look = frozenset(), 0
        elif slot >= self._next_look:
            self.near, self._next_look = self._find_near(slot, own), slot + LOOK_SLOTS
        self.awaited = {uav for uav in self.near if 0 < slot - self._knowledge.last_slot(uav) <= ABSENT_SLOTS}

    def _find_near(self, slot: int, own: Collection[Point]) -> frozenset[str]:
        import numpy as np  # noqa: PLC0415 - a UAV that is not in office starts without it

        near, places, box_m = list[tuple[float, str]](), list(own), _box_m(own)
        hulls = {
            uav: self._hull(uav, slot)
            for uav in self._candidates(slot, box_m)
            if not (self._knowledge.is_on_ground(uav, slot + 1) or self._is_far(uav, slot, box_m))
        }
        if not hulls:
            return frozenset()
        x_m, y_m = np.array(places, dtype=np.float64).T
        ax_m, ay_m = np.array([(hull.ax_m, hull.ay_m) for hull in hulls.values()]).T
        nearest = np.argmin((x_m - ax_m[:, None]) ** 2 + (y_m - ay_m[:, None]) ** 2, axis=1)
        for (uav, hull), index in zip(hulls.items(), nearest.tolist(), strict=True):
            here_m, end_m = (hull.ax_m, hull.ay_m), (hull.bx_m, hull.by_m)
            away_m = math.dist(here_m, places[index]) - math.dist(here_m, end_m) - hull.radius_m
            if away_m <= self._near_m:
                near.append((away_m, uav))
        return frozenset(uav for _, uav in sorted(near)[:MAX_NEAR])

    def _in_order(self, uavs: Set[str]) -> list[str]:
        """Return the foreign ones of these UAVs, in roster order."""
        return sorted(uavs - self._own, key=self.tables.index.__getitem__)

    def _candidates(self, slot: int, box_m: tuple[Point, Point] | None) -> list[str]:
        """Return the foreign UAVs in roster order, without most of those that are far from a rectangle (`_is_far`).

        One look at all of them at once: to ask for each would take a head of a mission with thousands longer than its
        plan.
        """
        tables = self.tables
        if box_m is None:
            return [uav for uav in tables.entries if uav not in self._own]
        import numpy as np  # noqa: PLC0415 - a UAV that is not in office starts without it

        (left_m, low_m), (right_m, high_m) = box_m
        x_m, y_m, newest_slot = self._newest
        step_m, brake_m = tables.reaches_m
        away_m = np.maximum(np.maximum(left_m - x_m, x_m - right_m), np.maximum(low_m - y_m, y_m - high_m))
        span_m = step_m * (1.0 + np.maximum(slot - newest_slot, 1.0)) + brake_m
        close = {self._mission.roster[index].uav for index in np.flatnonzero(away_m <= self._near_m + span_m + SLACK_M)}
        return self._in_order(close | self._knowledge.straying)

    def _is_far(self, uav: str, slot: int, box_m: tuple[Point, Point] | None) -> bool:
        """Return True if a UAV cannot be near a rectangle, by its newest fix or its start alone: a cheap test."""
        if box_m is None or self._knowledge.strays(uav):
            return False
        fix, entry, step_m = self._knowledge.newest.get(uav), self.tables.entries[uav], self.tables.rules.u_max_m[uav]
        x_m, y_m = (entry.start_x_m, entry.start_y_m) if fix is None else (fix.waypoint_x_m, fix.waypoint_y_m)
        slots = slot - (-1 if fix is None else fix.slot)
        # Its last step leads to the waypoint; no braking path is longer than after a step at full speed.
        span_m = step_m + self.tables.rules.reach_m(uav, max(slots, 1), step_m)
        (left_m, low_m), (right_m, high_m) = box_m
        away_m = max(left_m - x_m, x_m - right_m, low_m - y_m, y_m - high_m)
        return away_m > self._near_m + span_m

    def _is_heard(self, uav: str, slot: int) -> bool:
        return self._knowledge.last_slot(uav) == slot and not self._knowledge.strays(uav)

    def _hull(self, uav: str, slot: int) -> Hull:
        if self._knowledge.strays(uav):
            return self._knowledge.stray_hull(uav, slot + 1, self.tables.free_m[uav])
        return self._knowledge.place_after(uav, slot, self.tables.rules, self.tables.r_m[uav])

    def _seen(self, fix: Fix) -> ForeignUav:
        here_m, entry = (fix.waypoint_x_m, fix.waypoint_y_m), self.tables.entries[fix.uav]
        aim_m, rest_m = fix.course.aim(entry, here_m, self.tables.rules.u_max_m[fix.uav], self._mission.dt_s)
        return ForeignUav(self._knowledge.index[fix.uav], here_m, (fix.from_x_m, fix.from_y_m), aim_m, rest_m, fix.r_m)


def places_m(cluster: Mission, knowledge: Knowledge) -> list[Point]:
    """Return where the UAVs of a cluster are by their newest fixes; where they start, without one."""
    places = {entry.uav: (entry.start_x_m, entry.start_y_m) for entry in cluster.roster}
    places |= {fix.uav: (fix.waypoint_x_m, fix.waypoint_y_m) for fix in knowledge.newest.values()}
    return list(places.values())


def _box_m(places: Collection[Point]) -> tuple[Point, Point] | None:
    """Return the lower left and upper right corner of the rectangle around places; None if there are none."""
    if not places:
        return None
    xs_m, ys_m = zip(*places, strict=True)
    return (min(xs_m), min(ys_m)), (max(xs_m), max(ys_m))
