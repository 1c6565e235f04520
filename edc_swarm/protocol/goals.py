"""The operator's pending goals: it numbers them, repeats them until their UAVs answer, and tells what became of them.

A UAV acknowledges a goal by its fixes, which carry its course, and rejects one by an event. Both may be lost, and the
goal too: so the operator repeats a goal once a slot until it hears either, and gives up after `PATIENCE_SLOTS`. A goal
is answered by the number and the last point of the route, as others may give the UAV a goal of the same number: then
the operator gives its own again with the next one.
"""

from __future__ import annotations

from dataclasses import dataclass

import msgspec
from msgspec import Struct

from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.field_types import Point
from edc_swarm.mission.roles import OPERATOR
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.messages import Event, Fix, Goal

PATIENCE_SLOTS = 100
"""Slots without an answer after which the operator gives up a goal."""


class GoalAnswer(Struct, frozen=True):
    """Detail of the events `goal-refused` (of a UAV) and `goal-unanswered` (of the operator)."""

    uav: str
    number: int
    reason: str


@dataclass(slots=True)
class _Pending:
    goal: Goal
    since_slot: int
    said_slot: int = -1


class PendingGoals:
    """Goals that wait for the answers of their UAVs; a newer goal of a UAV replaces the older one."""

    def __init__(self, mission: Mission) -> None:
        self._lifelong = mission.goals == "lifelong"
        self._newest: dict[str, int] = {}
        self._pending: dict[str, _Pending] = {}

    def give(self, uav: str, route: list[Point], slot: int) -> None:
        """Take a goal in, to be sent from `slot` on."""
        waiting = self._pending.get(uav)
        number = max(self._newest.get(uav, 0), waiting.goal.number if waiting is not None else 0) + 1
        self._newest[uav] = number
        self._pending[uav] = _Pending(Goal(source=OPERATOR, uav=uav, number=number, route=route), slot)

    def resume(self, goal: Goal, slot: int) -> None:
        """Take in a goal of an earlier operator, to be sent from `slot` on; the newest goal of a UAV counts."""
        waiting = self._pending.get(goal.uav)
        if waiting is None or waiting.goal.number < goal.number:
            self._newest[goal.uav] = max(goal.number, self._newest.get(goal.uav, 0))
            self._pending[goal.uav] = _Pending(goal, slot)

    def hear_fix(self, fix: Fix) -> None:
        """Follow the course of a UAV: it has accepted its goal, or another one of this number or a higher one."""
        course, waiting = fix.course, self._pending.get(fix.uav)
        self._newest[fix.uav] = max(course.goal, self._newest.get(fix.uav, 0))
        if waiting is None or course.goal < waiting.goal.number:
            return
        is_it = course.goal == waiting.goal.number and course.route[-1] == waiting.goal.route[-1]
        if is_it or (course.goal > waiting.goal.number and not self._lifelong):
            del self._pending[fix.uav]
        else:
            waiting.goal = msgspec.structs.replace(waiting.goal, number=self._newest[fix.uav] + 1)

    def hear_event(self, event: Event) -> None:
        """Drop the goal that a UAV refuses, or that an earlier operator gave up."""
        if event.kind not in {EventKind.GOAL_REFUSED, EventKind.GOAL_UNANSWERED}:
            return
        answer = answer_in(event)
        uav = answer.uav if answer is not None and event.source == OPERATOR else event.source
        waiting = self._pending.get(uav)
        if answer is not None and waiting is not None and answer.number == waiting.goal.number:
            del self._pending[uav]

    @property
    def waits(self) -> bool:
        """True if a goal waits for an answer."""
        return bool(self._pending)

    @property
    def unanswered(self) -> list[Goal]:
        """The goals that wait for an answer."""
        return [waiting.goal for waiting in self._pending.values()]

    def due(self, slot: int) -> list[Goal]:
        """Return the goals to be sent in `slot`, each once."""
        due = [waiting for waiting in self._pending.values() if slot > waiting.said_slot]
        for waiting in due:
            waiting.said_slot = slot
        return [waiting.goal for waiting in due]

    def given_up(self, slot: int) -> list[GoalAnswer]:
        """Drop and return the goals that have waited too long."""
        late = [uav for uav, waiting in self._pending.items() if slot - waiting.since_slot >= PATIENCE_SLOTS]
        dropped = [self._pending.pop(uav).goal for uav in late]
        return [GoalAnswer(goal.uav, goal.number, f"no answer in {PATIENCE_SLOTS} slots") for goal in dropped]


def answer_in(event: Event) -> GoalAnswer | None:
    """Return the detail of an event about a goal, None if it is none."""
    try:
        return msgspec.json.decode(event.detail, type=GoalAnswer)
    except msgspec.DecodeError:
        return None
