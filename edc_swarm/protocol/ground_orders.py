"""Commands from a ground station as the operator carries them out: by faults `goal` and `land` that begin now.

The bridge publishes a `GroundOrder` as an event, so the recording has it; the operator, and nobody else, acts on it, if
the user allowed that. It announces a fault, `goal` or `land`, as any other: heads, judges and readers know no order.
"""

from __future__ import annotations

from typing import Literal

import msgspec
from msgspec import Struct

from edc_swarm.mission.braking import change_of, rest_point
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.faults import Fault, GiveGoal, OrderLanding
from edc_swarm.mission.field_types import Metres, Point, UavId
from edc_swarm.protocol.messages import Event, Fix

Wish = Literal["pause", "go on", "goal", "land"]


class GroundOrder(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A command from the ground for one UAV; `x_m y_m` is the new goal."""

    uav: UavId
    wish: Wish
    x_m: Metres | None = None
    y_m: Metres | None = None


def order_in(event: Event) -> GroundOrder | None:
    """Return the order that an event of the bridge tells; None if its detail is none."""
    try:
        return msgspec.json.decode(event.detail, type=GroundOrder)
    except msgspec.DecodeError:
        return None


class GroundOrders:
    """Translation of commands from the ground into faults, by the newest fix of each UAV.

    A UAV that pauses has a goal where it comes to rest; the points that it still had to fly to are kept until it is to
    go on. So a restart, a new head or a lost message changes nothing: its course is part of its promise.
    """

    def __init__(self, mission: Mission) -> None:
        self._mission = mission
        self._roster = {entry.uav: entry for entry in mission.roster}
        self._newest: dict[str, Fix] = {}
        self._left: dict[str, list[Point]] = {}

    @property
    def pauses(self) -> bool:
        """True while any UAV pauses: the mission waits for it."""
        return bool(self._left)

    def hear_fix(self, fix: Fix) -> None:
        """Keep the newest fix of a UAV."""
        known = self._newest.get(fix.uav)
        if known is None or fix.slot >= known.slot:
            self._newest[fix.uav] = fix

    def forget(self, uav: str) -> None:
        """Stop waiting for a UAV that no longer flies."""
        self._left.pop(uav, None)

    def carried_out_by(self, order: GroundOrder, at_s: float) -> Fault | str:
        """Return the fault that carries out an order at mission time `at_s`, or why there is none."""
        fix = self._newest.get(order.uav)
        if fix is None:
            return f"{order.uav} has not been heard"
        match order.wish:
            case "pause":
                return self._pause(fix, at_s)
            case "go on":
                left = self._left.pop(order.uav, None)
                return f"{order.uav} does not pause" if left is None else _goal(order.uav, left, at_s)
            case "goal":
                return self._goal(order, at_s)
            case "land":
                self._left.pop(order.uav, None)
                return OrderLanding(order.uav, at_s=at_s)

    def _goal(self, order: GroundOrder, at_s: float) -> Fault | str:
        if order.x_m is None or order.y_m is None:
            return f"no place for {order.uav}"
        if self._mission.goals == "lifelong":
            return "a lifelong mission draws its goals itself"
        self._left.pop(order.uav, None)
        return _goal(order.uav, [(order.x_m, order.y_m)], at_s)

    def _pause(self, fix: Fix, at_s: float) -> Fault | str:
        if fix.uav in self._left:
            return f"{fix.uav} pauses already"
        if self._mission.goals == "lifelong":
            return "a lifelong mission draws its goals itself"
        entry = self._roster[fix.uav]
        from_m, to_m = (fix.from_x_m, fix.from_y_m), (fix.waypoint_x_m, fix.waypoint_y_m)
        self._left[fix.uav] = fix.course.left(entry)
        return _goal(fix.uav, [rest_point(from_m, to_m, change_of(self._mission, entry))], at_s)


def _goal(uav: str, route: list[Point], at_s: float) -> Fault:
    return GiveGoal(uav, tuple(route), at_s=at_s)
