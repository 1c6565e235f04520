"""The goals that each UAV had, and the point of each that it flew to, over the slots."""

from __future__ import annotations

from msgspec import Struct

from edc_swarm.mission.field_types import Point
from edc_swarm.protocol.messages import Fix, roster_index
from edc_swarm.recording.model import Recording

MAX_TURNS = 50_000
"""Most changes of course that the page holds, of all UAVs together; it leaves out the later ones."""


class Itinerary(Struct, frozen=True):
    """One UAV's routes in the order in which it flew them, the one of the roster first.

    A turn (slot, route, leg) says that from `slot` on the UAV flew to point `leg` of `routes[route]`; before its first
    turn it flew to the first point of the roster's route. `goals` has the number of each route's goal, 0 for the
    roster's.
    """

    routes: list[list[Point]]
    goals: list[int]
    turns: list[tuple[int, int, int]]


def itineraries(recording: Recording) -> list[Itinerary]:
    """Return the itineraries in roster order, as the fixes tell them."""
    roster = recording.mission.roster
    index, made = roster_index(roster), [Itinerary([list(entry.points)], [0], []) for entry in roster]
    newest: list[tuple[int, int]] = [(0, 0)] * len(roster)
    count = 0
    for fix in sorted((fix for fix in recording.fixes if _tells(fix, index)), key=lambda fix: fix.slot):
        k, course = index[fix.uav], fix.course
        if (course.goal, course.leg) <= newest[k] or not course.fits(roster[k]) or count >= MAX_TURNS:
            continue
        own, leg = made[k], course.leg
        if course.goal > newest[k][0]:
            own.routes.append(list(course.route))
            own.goals.append(course.goal)
            leg = 0
        elif course.goal:
            leg = len(own.routes[-1]) - len(course.route)
        newest[k] = (course.goal, course.leg)
        own.turns.append((fix.slot, len(own.routes) - 1, max(0, leg)))
        count += 1
    return made


def _tells(fix: Fix, index: dict[str, int]) -> bool:
    return bool(fix.course.goal or fix.course.leg) and fix.voter and fix.uav in index and fix.slot >= 0
