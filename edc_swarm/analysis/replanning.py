"""Replanning: a head's recorded plan requests, rebuilt and given to a planner again.

A report names the UAVs that the head heard and the hulls of the others. Report and fixes of a slot together are the
whole input of a planner. A planner keeps state between slots (tracks, duals for a warm start), so one planner
repeats all plans of a process in their order.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from msgspec import Struct

from edc_swarm.mission.braking import changes_m
from edc_swarm.planner.interface import Hull, Planner, PlanRequest
from edc_swarm.protocol.messages import Command, Fix, Report, roster_index
from edc_swarm.recording.model import Recording
from edc_swarm.recording.repeats import plans_of

SAME_PLAN_M = 1e-6
"""Greatest difference between commands of one plan on two processors, which may round differently."""


class Difference(Struct, frozen=True):
    """A recorded command that differs from the replanned one."""

    slot: int
    uav: str
    term: int
    head: str
    off_m: float


class Replanned(Struct, frozen=True):
    """The result of replanning a recording.

    `identical` commands are equal to the last bit, `greatest_off_m` is the greatest distance between
    a recorded target and the one planned now. `skipped` plans lack fixes or commands in the record.
    """

    plans: int
    commands: int
    identical: int
    greatest_off_m: float
    skipped: int
    differences: list[Difference]


@dataclass(frozen=True, slots=True)
class _Plan:
    """A recorded plan: its commands, and the request that it answered."""

    report: Report
    request: PlanRequest
    commands: list[Command]


def replan(recording: Recording, make_planner: Callable[[], Planner]) -> Replanned:
    """Replan every recorded slot and compare command by command."""
    planners: dict[tuple[str, str], Planner] = {}
    offs: list[tuple[Command, float]] = []
    reports = plans_of(recording)
    plans = list(_plans(recording, reports))
    for plan in plans:
        process = (plan.report.head, plan.report.instance)
        if process not in planners:
            planners[process] = make_planner()
        waypoint_m = planners[process].plan(plan.request).waypoint_m
        for command, to_m in zip(plan.commands, waypoint_m, strict=True):
            offs.append((command, math.dist((command.target_x_m, command.target_y_m), to_m)))
    return Replanned(
        plans=len(plans),
        commands=len(offs),
        identical=sum(off_m == 0.0 for _, off_m in offs),
        greatest_off_m=max((off_m for _, off_m in offs), default=0.0),
        skipped=len(reports) - len(plans),
        differences=[Difference(c.slot, c.uav, c.term, c.head, off_m) for c, off_m in offs if not off_m <= SAME_PLAN_M],
    )


def _plans(recording: Recording, reports: list[Report]) -> Iterator[_Plan]:
    """Yield every plan whose fixes and commands are all recorded, in the order of the recording."""
    index = roster_index(recording.mission.roster)
    fixes = {(f.uav, f.slot, f.term, f.head): f for f in recording.fixes}
    commands = {(c.uav, c.slot, c.term, c.head): c for c in recording.commands}
    for report in reports:
        order = sorted((uav for uav in report.heard if uav in index), key=index.__getitem__)
        granted = (report.term, report.head)
        heard = [fixes[key] for uav in order if (key := (uav, report.slot, *granted)) in fixes]
        sent = [commands[key] for uav in order if (key := (uav, report.slot + 1, *granted)) in commands]
        if len(heard) == len(sent) == len(report.heard):
            yield _Plan(report, _request(recording, report, heard, index), sent)


def _request(recording: Recording, report: Report, fixes: list[Fix], index: dict[str, int]) -> PlanRequest:
    mission = recording.mission
    with_previous = mission.lag_slots > 0 or changes_m(mission) is not None
    entries = [mission.roster[index[fix.uav]] for fix in fixes]
    aims = [
        fix.course.aim(entry, (fix.waypoint_x_m, fix.waypoint_y_m), mission.step_m(entry), mission.dt_s)
        for fix, entry in zip(fixes, entries, strict=True)
    ]
    return PlanRequest(
        slot=report.slot + 1,
        uav=[index[fix.uav] for fix in fixes],
        position_m=[(fix.waypoint_x_m, fix.waypoint_y_m) for fix in fixes],
        target_m=[aim_m for aim_m, _ in aims],
        rest_m=[rest_m for _, rest_m in aims],
        r_m=[entry.r_m for entry in entries],
        hulls=list(_hulls(recording, report, index)),
        previous_m=[(fix.from_x_m, fix.from_y_m) for fix in fixes] if with_previous else None,
    )


def _hulls(recording: Recording, report: Report, index: dict[str, int]) -> Iterator[Hull]:
    for uav, ax_m, ay_m, bx_m, by_m, radius_m in zip(report.hull_uav, *report.hull_columns, strict=False):
        if uav in index and uav != report.head:
            yield Hull(index[uav], ax_m, ay_m, bx_m, by_m, radius_m, recording.mission.roster[index[uav]].r_m)
