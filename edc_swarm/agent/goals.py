"""New goals in flight: what a UAV does with a goal that it receives."""

from __future__ import annotations

from edc_swarm.emulation.energy import propulsion_power_w
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.field_types import Point
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.mission.routes import Course, way_m
from edc_swarm.protocol.messages import Goal


def course_of(goal: Goal) -> Course:
    """Return the course that a UAV flies from the moment in which it accepts `goal`."""
    return Course(goal=goal.number, route=goal.route)


def is_new(goal: Goal, course: Course) -> bool:
    """Return True if the goal is newer than the one that the UAV flies: older numbers, and its own, are ignored."""
    return goal.number > course.goal


def unflyable(mission: Mission, entry: RosterEntry, here_m: Point, energy_j: float, route: list[Point]) -> str:
    """Return why a UAV at `here_m` with this charge cannot fly `route`; "" if nothing is known that prevents it."""
    speed_mps, length_m = mission.speed_mps(entry), way_m([here_m, *route])
    needed_j = propulsion_power_w(speed_mps, mission.energy) * length_m / speed_mps
    if needed_j > energy_j:
        return f"{length_m:.0f} m at full speed take {needed_j:.4g} J, and the battery holds {energy_j:.4g} J"
    if not mission.zone:
        return ""
    from edc_swarm.mission.airspace import zones_refusal  # noqa: PLC0415  (imports numpy: only a goal with zones needs it)

    # The UAV has flown from its start to where it is, so there is a way between the two.
    return zones_refusal(mission.zone, entry.r_m, [(entry.start_x_m, entry.start_y_m), *route])
