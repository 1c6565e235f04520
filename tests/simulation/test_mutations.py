"""Every safety rule, removed once, and progress that ends: the fuzzer must notice, or it proves nothing.

Each defect is planted in the production code and the fuzzer is run over the stated seeds until it
finds a broken guarantee. One rule is missing here: that a command must start at the UAV's own waypoint. A head
plans from the fix that the UAV has just sent, so no crash or bad network makes it start elsewhere; the check
guards against a head that is wrong, and `tests/unit/test_vehicle.py` holds it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from edc_swarm.agent import slot_clock, vehicle
from edc_swarm.agent.announcer import Announcer
from edc_swarm.agent.election import Election
from edc_swarm.agent.head import Head, Office
from edc_swarm.agent.knowledge import Knowledge
from edc_swarm.agent.leadership import Leadership
from edc_swarm.agent.node import Effect, Persist, UavNode
from edc_swarm.emulation.multirotor import Multirotor
from edc_swarm.experiments import fuzzing
from edc_swarm.experiments.fuzz_scenarios import RECKLESS
from edc_swarm.geometry import Barriers, Floats, point_segment_distance_m
from edc_swarm.mission import vehicle_budget
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.control_loop import LoopBounds
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.routes import Course
from edc_swarm.mission.validation import mission_from_dict
from edc_swarm.planner.edc import Edc
from edc_swarm.planner.guidance import Guidance, Scene
from edc_swarm.planner.request import Arrays
from edc_swarm.protocol.messages import Command, Fix, Report
from edc_swarm.simulation import computers
from edc_swarm.solver import certificate, slot_qp, solution
from edc_swarm.solver.barrier_rows import Airspace, barrier_rows
from edc_swarm.solver.normals import DELTA_M

Patch = pytest.MonkeyPatch
Defect = Callable[[Patch], None]


def quorum_of_half(patch: Patch) -> None:
    """Half of the roster is enough."""
    patch.setattr(Mission, "quorum", property(lambda mission: max(1, len(mission.roster) // 2)))


def second_grant_in_one_term(patch: Patch) -> None:
    """A UAV may change the head within its term."""
    adopt = Election._adopt

    def mutant(self: Election, grant: tuple[int, str]) -> None:
        if grant[0] == self.term and grant[1] != self.head:
            self.term -= 1
        adopt(self, grant)

    patch.setattr(Election, "_adopt", mutant)
    hear = Election.hear_report

    def eager(self: Election, report: Any) -> None:
        if report.term >= self.term and report.head != self.head:
            self._adopt((report.term, report.head))
        hear(self, report)

    patch.setattr(Election, "hear_report", eager)


def term_goes_back(patch: Patch) -> None:
    """A report of an older term is believed."""
    hear = Election.hear_report

    def mutant(self: Election, report: Any) -> None:
        if report.has_quorum and report.term < self.term:
            self.term = report.term - 1
        hear(self, report)

    patch.setattr(Election, "hear_report", mutant)


def _at_start(patch: Patch, change: Callable[[Any, Any], Any]) -> None:
    init = UavNode.__init__

    def mutant(self: UavNode, mission: Any, uav: str, instance: str, promise: Any, airframe: Any, **rest: Any) -> None:
        entry = next(e for e in mission.roster if e.uav == uav)
        init(self, mission, uav, instance, change(promise, entry), airframe, **rest)

    patch.setattr(UavNode, "__init__", mutant)


def grant_forgotten_over_a_restart(patch: Patch) -> None:
    """The promise on disk loses its term and head."""
    _at_start(patch, lambda p, _: p and msgspec.structs.replace(p, term=0, head=""))


def waypoint_forgotten_over_a_restart(patch: Patch) -> None:
    """The promise on disk loses its waypoint."""
    _at_start(patch, lambda p, e: p and msgspec.structs.replace(p, waypoint_x_m=e.start_x_m, waypoint_y_m=e.start_y_m))


def course_forgotten_over_a_restart(patch: Patch) -> None:
    """The promise on disk loses the goal and the place in the route."""
    _at_start(patch, lambda p, _: p and msgspec.structs.replace(p, course=Course()))


def goal_acknowledged_before_it_is_persisted(patch: Patch) -> None:
    """The fix that acknowledges a new goal is out, and the goal is on the disk only with the next slot."""
    take = UavNode._take_goal

    def mutant(self: UavNode, goal: Any, now_ns: int) -> None:
        take(self, goal, now_ns)
        effects = self._announcer.take_effects()
        self._announcer._effects = [effect for effect in effects if not isinstance(effect, Persist)]

    patch.setattr(UavNode, "_take_goal", mutant)


def promise_written_after_the_step_began(patch: Patch) -> None:
    """Truth and fix are out before the promise is on disk."""
    step = UavNode.step

    def mutant(self: UavNode, event: Any, now_ns: int) -> list[Effect]:
        return sorted(step(self, event, now_ns), key=lambda effect: isinstance(effect, Persist))

    patch.setattr(UavNode, "step", mutant)


def lost_memory_that_grants(patch: Patch) -> None:
    """A UAV without its promise starts over as if new."""
    _at_start(patch, lambda p, e: p or vehicle.first_promise(e))


def late_command_accepted(patch: Patch) -> None:
    """A command that comes after its slot began is flown at once."""
    take = UavNode._take_command

    def mutant(self: UavNode, command: Command) -> None:
        take(self, command)
        ours = command.uav == self.uav and (command.term, command.head) == self.grant
        if ours and command.slot == self.slot and self._flight.flown is None and self._announcer.has_begun:
            self._flight.flown = command
            self._vehicle.from_m = self._vehicle.waypoint_m
            self._vehicle.waypoint_m = (command.target_x_m, command.target_y_m)
            self._announcer._said = None

    patch.setattr(UavNode, "_take_command", mutant)
    say = Announcer.say_change

    def said(self: Announcer, slot: int, now_ns: int) -> None:
        if not self.has_begun and self._flight.flown is not None and slot >= 0:
            self.say(slot, now_ns, with_truth=True)
        say(self, slot, now_ns)

    patch.setattr(Announcer, "say_change", said)


def frozen_uav_executes_late(patch: Patch) -> None:
    """A tick at 0.9 of the slot still flies."""
    patch.setattr(slot_clock, "LATE_FRACTION", 0.95)


def ungranted_uav_commanded(patch: Patch) -> None:
    """A head counts and commands every UAV that has sent a fix of the slot."""

    def mutant(self: Knowledge, slot: int, grant: Any) -> list[str]:
        del grant
        return [uav for uav in self._roster if self.last_slot(uav) == slot]

    patch.setattr(Knowledge, "heard", mutant)
    patch.setattr(vehicle, "refusal", lambda *_: None)


def quorum_remembered(patch: Patch) -> None:
    """A head that once had a quorum in its term goes on without."""
    has = Head.has_quorum

    def mutant(self: Head, slot: int) -> bool:
        return has(self, slot) or (self.office.t0 >= 0 and self._uav in self.heard(slot))

    patch.setattr(Head, "has_quorum", mutant)


def planning_twice_in_a_slot(patch: Patch) -> None:
    """A fix that comes after the plan makes the head plan again."""
    receive = UavNode._receive

    def mutant(self: UavNode, message: Any, now_ns: int) -> None:
        known = isinstance(message, Fix) and self._knowledge.last_slot(message.uav)
        receive(self, message, now_ns)
        if isinstance(message, Fix) and known != self.slot and message.slot == self.slot and self.slot >= 0:
            assert isinstance(self._leadership, Leadership)
            office = self._leadership.head.office
            office.planned_slot = min(office.planned_slot, self.slot - 1)

    patch.setattr(UavNode, "_receive", mutant)


def restarted_head_plans_in_its_term(patch: Patch) -> None:
    """Nothing bars the term on disk."""
    init = Head.__init__

    def mutant(self: Head, mission: Any, uav: str, barred_term: int, *knowledge: Any) -> None:
        init(self, mission, uav, -1, *knowledge)
        if barred_term:
            self.office = Office((barred_term, uav))

    patch.setattr(Head, "__init__", mutant)


def memory_of_an_older_term_used(patch: Patch) -> None:
    """t0 and the commands sent survive a change of term."""

    def mutant(self: Head, grant: Any) -> None:
        self.office.grant = grant

    patch.setattr(Head, "take_office", mutant)


def never_heard_uav_left_out(patch: Patch) -> None:
    """No hull is kept for a UAV that has never been heard."""
    hulls = Head.hulls

    def mutant(self: Head, slot: int) -> Any:
        return {uav: hull for uav, hull in hulls(self, slot).items() if uav in self._knowledge.newest}

    patch.setattr(Head, "hulls", mutant)


def ball_one_slot_short(patch: Patch) -> None:
    """The ball about an unheard UAV grows until t0 instead of t0 + 1."""
    hull = Knowledge.hull

    def mutant(self: Knowledge, uav: str, grant: Any, t0: int, sent: Any, rules: Any) -> Any:
        return hull(self, uav, grant, t0 - 1, sent, rules)

    patch.setattr(Knowledge, "hull", mutant)


def hull_grown_by_the_speed_of_the_mission(patch: Patch) -> None:
    """The ball about an unheard UAV grows as if it had no speed of its own."""
    init = Head.__init__

    def mutant(self: Head, mission: Any, uav: str, barred_term: int, *knowledge: Any) -> None:
        init(self, mission, uav, barred_term, *knowledge)
        self._rules = replace(self._rules, u_max_m=dict.fromkeys(self._roster, mission.u_max_m))

    patch.setattr(Head, "__init__", mutant)


def speed_of_a_uav_ignored(patch: Patch) -> None:
    """Planner and UAV know one speed for all: the UAV accepts a step that is longer than its own longest one."""
    flown = property(lambda self: self._mission.v_max_mps * (self._mission.dt_s - 2 * self._mission.guard_s))
    patch.setattr(vehicle.Vehicle, "u_max_m", flown)
    init = Edc.__init__

    def mutant(self: Edc, mission: Mission, *rest: Any) -> None:
        roster = [msgspec.structs.replace(entry, v_max_mps=0.0) for entry in mission.roster]
        init(self, msgspec.structs.replace(mission, roster=roster), *rest)

    patch.setattr(Edc, "__init__", mutant)


def report_tells_of_a_slot_too_many(patch: Patch) -> None:
    """A listed hull is taken for good a slot longer than its head can answer for."""
    hear_report = Knowledge.hear_report

    def mutant(self: Knowledge, report: Report) -> None:
        hear_report(self, msgspec.structs.replace(report, slot=report.slot + 1))

    patch.setattr(Knowledge, "hear_report", mutant)


def hull_reset_by_a_duplicate_fix(patch: Patch) -> None:
    """The last fix to arrive counts, not the newest."""

    def mutant(self: Knowledge, fix: Fix, slot: int) -> None:
        if fix.uav in self._roster and fix.voter and fix.slot <= slot:
            self._count(self.newest.get(fix.uav), -1)
            self.newest[fix.uav] = fix
            self._count(fix, 1)

    patch.setattr(Knowledge, "hear_fix", mutant)


def joint_row_only(patch: Patch) -> None:
    """Solver and certificate keep only the corner "both move", where one UAV may make up for the other's approach."""
    rows_over_m = certificate._rows_over_m

    def mutant(self: slot_qp.Problem, step_m: NDArray[np.float64]) -> tuple[Any, Any]:
        moved = (self.normal * (step_m[self.second] - step_m[self.first])).sum(axis=1)
        return np.maximum(moved, 0.0), np.zeros(len(moved))

    def both_move(first_m: NDArray[np.float64], second_m: NDArray[np.float64], _gap_m: NDArray[np.float64]) -> Any:
        pair = np.flatnonzero((first_m > 0) & (second_m > 0))
        return pair, np.full(len(pair), solution._BOTH)

    patch.setattr(slot_qp.Problem, "closing_m", mutant)
    patch.setattr(solution, "_corners", both_move)
    # The first four rows are those of pairs; the joint corner has been checked with `closing_m`.
    patch.setattr(certificate, "_rows_over_m", lambda *arguments: rows_over_m(*arguments)[4:])


def negative_gap_taken(patch: Patch) -> None:
    """Where there is no room, steps are not slowed down."""
    share = certificate._share

    def mutant(closing_m: NDArray[np.float64], room_m: NDArray[np.float64]) -> Any:
        return np.where(room_m < DELTA_M, 1.0, share(closing_m, room_m))

    patch.setattr(certificate, "_share", mutant)
    patch.setattr(certificate, "_refused", lambda _problem, waypoint_m: np.zeros(len(waypoint_m), dtype=bool))


def _with_barriers(patch: Patch, change: Callable[[Barriers], Barriers]) -> None:
    """Assemble the rows, which solver and certificate share, from changed barriers."""
    rows = barrier_rows

    def mutant(position_m: Floats, wish_m: Floats, r_m: Floats, u_max_m: Floats, airspace: Airspace) -> tuple[Any, ...]:
        changed = Airspace.of(change(airspace.barriers), airspace.r_m, 2 * float(u_max_m.max(initial=0.0)))
        return rows(position_m, wish_m, r_m, u_max_m, changed)

    patch.setattr(slot_qp, "barrier_rows", mutant)


def rows_of_one_zone_left_out(patch: Patch) -> None:
    """The last zone has no rows."""

    def without_last(barriers: Barriers) -> Barriers:
        kept = barriers.zone < barriers.zone.max(initial=0)
        return Barriers(*(getattr(barriers, name)[kept] for name in Barriers.__dataclass_fields__))

    _with_barriers(patch, without_last)


def zones_kept_by_centres_alone(patch: Patch) -> None:
    """The distance to keep from a zone lacks the radius of the UAV."""
    _with_barriers(patch, lambda barriers: replace(barriers, keeps_disc=np.zeros_like(barriers.keeps_disc)))


def rows_for_the_end_of_the_step_only(patch: Patch) -> None:
    """A UAV whose preferred waypoint keeps its distance from all barriers has no row, whatever lies between."""
    rows = barrier_rows

    def mutant(position_m: Floats, wish_m: Floats, r_m: Floats, u_max_m: Floats, airspace: Airspace) -> tuple[Any, ...]:
        uav, normal, room_m, frozen = rows(position_m, wish_m, r_m, u_max_m, airspace)
        barriers = airspace.barriers
        away_m = point_segment_distance_m(wish_m[:, None], barriers.a_m, barriers.b_m) - barriers.least_m(r_m)
        counts = (away_m.min(axis=1, initial=np.inf) < 0)[uav]
        return uav[counts], normal[counts], room_m[counts], frozen

    patch.setattr(slot_qp, "barrier_rows", mutant)


def zones_neither_solved_nor_checked(patch: Patch) -> None:
    """Neither the slot QP nor the certificate has a row of a barrier."""
    _with_barriers(patch, lambda _: Barriers.none())


def planner_that_gives_up_after_a_fault(patch: Patch) -> None:
    """No UAV moves any more after one was unheard."""
    wishes, shaken = Edc._wishes, set[Edc]()

    def mutant(self: Edc, arrays: Arrays) -> Floats:
        if len(arrays.obstacles.keep_m):
            shaken.add(self)
        return arrays.position_m.copy() if self in shaken else wishes(self, arrays)

    patch.setattr(Edc, "_wishes", mutant)


def guidance_that_ignores_one_uav(patch: Patch) -> None:
    """The first UAV of the roster never moves."""
    wishes = Guidance.wishes

    def mutant(self: Guidance, scene: Scene, *, in_flight: bool = False) -> Floats:
        return np.where((scene.uav == 0)[:, None], scene.position_m, wishes(self, scene, in_flight=in_flight))

    patch.setattr(Guidance, "wishes", mutant)


def hull_dropped_one_slot_too_early(patch: Patch) -> None:
    """A head takes a UAV for landed one slot before its airspace is free."""
    has_landed = Head._has_landed
    patch.setattr(Head, "_has_landed", lambda self, uav, slot: has_landed(self, uav, slot + 1))


def hull_dropped_by_the_fix_alone(patch: Patch) -> None:
    """A head forgets that the head before it may have commanded a UAV after the newest fix that it heard itself."""
    patch.setattr(Knowledge, "last_step", lambda self, uav, _grant, _t0, _sent: self.last_slot(uav))


def landed_uav_that_flies(patch: Patch) -> None:
    """The vehicle never lands, and accepts a step after any time."""
    patch.setattr(vehicle, "failsafe_of", lambda _: None)


def limit_forgotten_over_a_restart(patch: Patch) -> None:
    """The time without an accepted step begins anew with each process, also for its vehicle."""
    patch.setattr(computers, "comes_too_late", lambda *_: False)
    begin = UavNode._begin_slots

    def mutant(self: UavNode, now_ns: int) -> bool:
        if not self._announcer.has_begun:
            self._vehicle.stepped_slot = max(self._vehicle.stepped_slot, self._clock.slot_at(now_ns) - 1)
        return begin(self, now_ns)

    patch.setattr(UavNode, "_begin_slots", mutant)


def controller_steered_by_the_true_position(patch: Patch) -> None:
    """The controller knows the error of the estimated position, and corrects it."""
    fly = Multirotor._flight

    def mutant(self: Multirotor, reference: Any, _shift_mps: complex, *rest: Any) -> Any:
        state, self.state = self.state, msgspec.structs.replace(self.state, error_m=(0.0, 0.0))
        try:
            return fly(self, reference, 0j, *rest)
        finally:
            self.state = state

    patch.setattr(Multirotor, "_flight", mutant)


def gps_change_left_out_of_the_budget(patch: Patch) -> None:
    """The tracking bound has no part for an error of the estimate that changes."""
    honest = vehicle_budget.settled_loop

    def mutant(*vehicle: Any) -> LoopBounds:
        loop = honest(*vehicle)
        return replace(loop, correction=replace(loop.correction, deviation=0.0))

    patch.setattr(vehicle_budget, "settled_loop", mutant)
    patch.setattr(vehicle_budget, "_budget", cache(vehicle_budget._budget.__wrapped__))


def freezes(seed: int) -> Mission:
    """UAVs that stop just before a tick and go on so early in the slot that the head still hears them."""
    faults = [f"freeze u00{1 + slot % 4} @{slot * 0.5 - 0.01:.3f}s for 0.17s" for slot in range(3, 65)]
    return _crowd(seed, faults)


def restarts(seed: int) -> Mission:
    """Heads that come back at once; a UAV that they have just commanded reports it, and is then unheard."""
    faults = []
    for slot in range(4, 62, 6):
        at_s = slot * 0.5 + 0.01
        faults += [f"restart head @{at_s:.3f}s", f"partition u00{1 + slot // 2 % 4}>rest @{at_s + 0.02:.3f}s for 3"]
    return _crowd(seed, faults)


def failovers(seed: int) -> Mission:
    """Heads that die as soon as they have planned, while one UAV hears of no newer term."""
    faults = []
    for slot in range(4, 64, 4):
        at_s = slot * 0.5 + 0.005
        faults += [f"partition u00{1 + slot // 4 % 4}|rest @{at_s:.3f}s for 0.7s", f"restart head @{at_s + 0.001:.3f}s"]
    return _crowd(seed, faults, uavs=5, standbys=3)


def fast_failovers(seed: int) -> Mission:
    """The same, but every UAV is faster than the mission says."""
    slow = complete_mission(msgspec.structs.replace(failovers(seed), v_max_mps=1.0))
    fast = [msgspec.structs.replace(entry, v_max_mps=5.0) for entry in slow.roster]
    return msgspec.structs.replace(slow, roster=fast)


def relapses(seed: int) -> Mission:
    """The same, but the UAV was unheard in the slot before too, and that slot's report lists it."""
    faults = []
    for slot in range(6, 66, 6):
        at_s, uav = slot * 0.5, f"u00{1 + slot // 6 % 5}"
        faults += [
            f"partition {uav}|rest @{at_s - 0.51:.3f}s for 0.45s",
            f"partition {uav}|rest @{at_s + 0.005:.3f}s for 0.7s",
        ]
        faults.append(f"restart head @{at_s + 0.006:.3f}s")
    return _crowd(seed, faults, uavs=5, standbys=3)


SHORT = {"failsafe": "land", "land_after_s": 3.0, "landing_s": 0.5}
"""A failsafe of six slots, and two until the airspace is free."""


def deaths(seed: int) -> Mission:
    """UAVs that die when they have accepted a step and told nobody."""
    faults = [f"kill u00{1 + k} mid-step @{(5 + 7 * k + seed % 3) * 0.5 - 0.01:.3f}s" for k in range(3)]
    return _crowd(seed, faults, uavs=7, standbys=3, **SHORT)


def deaf_candidates(seed: int) -> Mission:
    """A head that dies, when nobody else has heard one UAV for long, which the head commanded all the time."""
    roster = complete_mission(_crowd(seed, [], uavs=7, standbys=3, **SHORT)).roster
    head, *others, uav = [entry.uav for entry in sorted(roster, key=lambda entry: -entry.energy_j)]
    faults = [f"partition {uav}>{','.join(others)} @2s for 30", f"restart {head} @{8.01 + seed % 3:.2f}s"]
    return _crowd(seed, faults, uavs=7, standbys=3, **SHORT)


def returns(seed: int) -> Mission:
    """UAVs that come back after their landing, when nobody keeps clear of them any more."""
    faults = []
    for k in range(3):
        at_s, uav = (4 + 4 * k) * 0.5 + 0.01, f"u00{1 + (seed + k) % 7}"
        faults += [f"kill {uav} @{at_s:.3f}s", f"restart {uav} @{at_s + 0.5 * (9 + seed % 6):.3f}s"]
    return _crowd(seed, faults, uavs=7, standbys=3, **SHORT)


def calm(seed: int) -> Mission:
    """Vehicles with a constant GPS error in calm air; who arrives first rests until the last has arrived."""
    fields = {"uavs": 4, "area_m2": 6000.0, "gps_model": "bias", "vehicle": {"model": "multirotor"}}
    return mission_from_dict({**fields, "seed": seed})


def outages(seed: int) -> Mission:
    """Outages of GPS: the estimate is corrected faster than the vehicle follows, and discs have no room to spare."""
    faults = [f"gps u00{1 + k} outage @{at} for {14 + (seed + k) % 6}" for k in range(8) for at in (3 + k, 45 + k)]
    model = {"model": "multirotor", "a_max_mps2": 0.5, "position_gain_per_s": 0.3, "drift_mps": 0.5}
    return mission_from_dict(
        {"uavs": 8, "area_m2": 40_000.0, "r_m": 4.5, "max_slots": 90, "planner": RECKLESS, "gps_model": "bias"}
        | {"seed": seed, "fault": faults, "vehicle": {**model, "correction_mps": 1.0}}
    )


def _crowd(seed: int, faults: list[str], uavs: int = 4, standbys: int = 0, **more: Any) -> Mission:
    crowd = {"area_m2": 300.0 * uavs, "planner": RECKLESS, "max_slots": 70, **more}
    return mission_from_dict({**crowd, "uavs": uavs, "standbys": standbys, "seed": seed, "fault": faults})


def goals_before_restarts(seed: int) -> Mission:
    """New goals to UAVs whose processes die as soon as they have acknowledged them."""
    faults = []
    for slot in range(6, 60, 9):
        at_s, uav = slot * 0.5 + 0.1, f"u00{1 + slot // 9 % 4}"
        faults += [f"goal {uav} {1 + slot % 20},{1 + slot % 17} @{at_s:.3f}s", f"restart {uav} @{at_s + 0.05:.3f}s"]
    return _crowd(seed, faults)


AIMED = [
    (goal_acknowledged_before_it_is_persisted, goals_before_restarts, 0, 5),
    (frozen_uav_executes_late, freezes, 0, 20),
    (restarted_head_plans_in_its_term, restarts, 0, 20),
    (ball_one_slot_short, failovers, 6, 20),
    (hull_grown_by_the_speed_of_the_mission, fast_failovers, 18, 20),
    (report_tells_of_a_slot_too_many, relapses, 3, 20),
    (hull_dropped_one_slot_too_early, deaths, 0, 20),
    (hull_dropped_by_the_fix_alone, deaf_candidates, 0, 20),
    (landed_uav_that_flies, returns, 0, 5),
    (limit_forgotten_over_a_restart, returns, 0, 5),
    (controller_steered_by_the_true_position, calm, 0, 5),
    (gps_change_left_out_of_the_budget, outages, 0, 5),
]
"""Defects that random schedules meet too rarely: found by schedules of one kind, crowded together.

Each has its first seed and the number of runs. A first seed above 0 only saves time: earlier ones find nothing today.
"""


@pytest.mark.parametrize(("defect", "mission", "first", "runs"), AIMED, ids=[defect.__name__ for defect, *_ in AIMED])
def test_aimed_schedules_find(
    defect: Defect, mission: Callable[[int], Mission], first: int, runs: int, monkeypatch: Patch
) -> None:
    """A planted defect breaks a guarantee in one of a few aimed missions, and none breaks without it."""
    seeds = range(first, first + runs)
    seed = next((seed for seed in seeds if _breaks(defect, mission(seed), monkeypatch)), None)
    assert seed is not None, f"{defect.__name__} went unnoticed in {runs} runs from seed {first}"
    assert fuzzing.fly(mission(seed)) == []


def _breaks(defect: Defect, mission: Mission, monkeypatch: Patch) -> bool:
    with monkeypatch.context() as patch:
        defect(patch)
        return bool(fuzzing.fly(mission))


# First seeds and numbers of runs, as above.
DEFECTS: list[tuple[Defect, int, int]] = [
    (quorum_of_half, 5, 60),
    (second_grant_in_one_term, 5, 60),
    (term_goes_back, 0, 60),
    (grant_forgotten_over_a_restart, 0, 200),
    (waypoint_forgotten_over_a_restart, 0, 60),
    (course_forgotten_over_a_restart, 6, 60),
    (promise_written_after_the_step_began, 5, 200),
    (lost_memory_that_grants, 8, 200),
    (late_command_accepted, 0, 200),
    (ungranted_uav_commanded, 0, 60),
    (quorum_remembered, 0, 200),
    (planning_twice_in_a_slot, 0, 200),
    (memory_of_an_older_term_used, 20, 200),
    (never_heard_uav_left_out, 35, 200),
    (speed_of_a_uav_ignored, 2, 20),
    (hull_reset_by_a_duplicate_fix, 3, 200),
    (joint_row_only, 0, 20),
    (negative_gap_taken, 0, 200),
    (rows_of_one_zone_left_out, 0, 20),
    (zones_kept_by_centres_alone, 5, 20),
    (rows_for_the_end_of_the_step_only, 0, 60),
    (zones_neither_solved_nor_checked, 0, 20),
    (planner_that_gives_up_after_a_fault, 12, 60),
    (guidance_that_ignores_one_uav, 17, 60),
    (landed_uav_that_flies, 0, 20),
    (limit_forgotten_over_a_restart, 7, 60),
    (hull_dropped_one_slot_too_early, 21, 60),
]


@pytest.mark.long
@pytest.mark.parametrize(("defect", "first", "runs"), DEFECTS, ids=[defect.__name__ for defect, *_ in DEFECTS])
def test_the_fuzzer_finds(defect: Defect, first: int, runs: int, monkeypatch: Patch) -> None:
    """A planted defect breaks a guarantee within the stated number of runs."""
    defect(monkeypatch)
    found = next((finding for seed in range(first, first + runs) if (finding := fuzzing.search(seed))), None)
    assert found is not None, f"{defect.__name__} went unnoticed in {runs} runs from seed {first}"
    print(defect.__name__, found.seed, found.broken[0])
