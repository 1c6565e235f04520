"""Work of the cluster head in one term: it collects fixes, counts the quorum, plans, commands, reports.

Rules kept here (named as in ARCHITECTURE.md):

- *quorum*: the head counts it anew in every slot, among the UAVs heard in that slot and itself;
- *heard*: the head commands for slot t + 1 only UAVs heard in slot t;
- *once*: the head makes one plan per (term, slot); a restarted process never plans in a term on its disk;
- *hull*: the plan keeps clear of every place where an unheard UAV can be; the head remembers hulls per term;
- *landed*: an unheard UAV that the failsafe has taken out of the airspace has no hull;
- *stray*: the hull of a UAV that does not follow its commands grows by what its vehicle can fly.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from functools import cached_property

from msgspec import UNSET

from edc_swarm.agent.foreign import Foreign
from edc_swarm.agent.knowledge import ABSENT_SLOTS, Grant, HullRules, Knowledge
from edc_swarm.mission.braking import changes_m
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.failsafe import failsafe_of
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.planner.interface import Hull, Plan, Planner, PlanRequest, plan_ms
from edc_swarm.protocol.messages import Command, Fix, Report


@dataclass(slots=True)
class Office:
    """Memory of one head in one term; the next term starts without it."""

    grant: Grant
    t0: int = -1
    planned_slot: int = -1
    sent: dict[str, Command] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of planning one slot: commands to the heard UAVs, the report, and the planner's problem or ""."""

    commands: list[Command]
    report: Report
    problem: str


class Head:
    """Head state of one UAV, which may or may not lead at present.

    Parameters
    ----------
    mission
        The mission as run.
    uav
        The own id.
    barred_term
        The term on disk when the process started: it never plans in this term or an older one.
    knowledge
        Newest fixes and relayed hulls.
    foreign
        UAVs of other clusters; None if there are none.
    """

    def __init__(
        self, mission: Mission, uav: str, barred_term: int, knowledge: Knowledge, foreign: Foreign | None = None
    ) -> None:
        self._mission = mission
        self._foreign = Foreign(mission, mission.roster[0].cluster) if foreign is None else foreign
        self._uav = uav
        self._barred_term = barred_term
        self._knowledge = knowledge
        self._quorum = mission.quorum
        self._failsafe = failsafe_of(mission)
        self._index = knowledge.index
        self.office = Office((0, ""))

    # Most UAVs never lead: they do without these tables.

    @cached_property
    def _roster(self) -> dict[str, RosterEntry]:
        return {entry.uav: entry for entry in self._mission.roster}

    @cached_property
    def _rules(self) -> HullRules:
        return self._foreign.tables.rules

    @cached_property
    def _with_previous(self) -> bool:
        return self._mission.lag_slots > 0 or changes_m(self._mission) is not None

    def take_office(self, grant: Grant) -> None:
        """Begin a term and forget the older one."""
        if grant != self.office.grant:
            self.office = Office(grant)

    def may_plan(self, slot: int) -> bool:
        """Return True if this process may still make the plan from the fixes of `slot` in this term."""
        return self.office.grant[0] > self._barred_term and self.office.planned_slot < slot

    def heard(self, slot: int) -> list[str]:
        """Return the ids of the UAVs heard in `slot`, in roster order."""
        return self._knowledge.heard(slot, self.office.grant)

    def has_quorum(self, slot: int) -> bool:
        """Return True if more than half of the roster, with this UAV, is heard in `slot`."""
        own = self._knowledge.newest.get(self._uav)
        return (
            own is not None
            and own.slot == slot
            and (own.term, own.head) == self.office.grant
            and self._knowledge.count_heard(slot, self.office.grant) >= self._quorum
        )

    def complete(self, slot: int, gone: Collection[str]) -> bool:
        """Return True if every UAV heard lately is heard in `slot`, except those in `gone` (they left the bus)."""
        newest, grant = self._knowledge.newest, self.office.grant
        # It ends with the first UAV that is missing: the head asks after every message.
        for uav in self._roster:
            fix = newest.get(uav)
            if fix is not None and fix.slot == slot and (fix.term, fix.head) == grant:
                continue
            if uav not in gone and slot - (-1 if fix is None else fix.slot) <= ABSENT_SLOTS:
                return False
        return True

    def plan(self, slot: int, planner: Planner) -> Outcome:
        """Plan slot + 1 from the fixes of `slot`; the caller has checked the quorum and `may_plan`."""
        assert self.has_quorum(slot), "a head plans with a quorum"
        assert self.may_plan(slot), "a head plans once per slot"
        office = self.office
        office.planned_slot = slot
        office.t0 = slot if office.t0 < 0 else office.t0
        fixes = [self._knowledge.newest[uav] for uav in self.heard(slot)]
        hulls = self.hulls(slot)
        plan = planner.plan(self._request(slot, fixes, hulls))
        commands = [self._command(slot, fix, to_m) for fix, to_m in zip(fixes, plan.waypoint_m, strict=True)]
        office.sent.update({command.uav: command for command in commands})
        return Outcome(commands, self._report(slot, fixes, hulls, plan), plan.problem)

    def hulls(self, slot: int) -> dict[str, Hull]:
        """Return the hull of every UAV not heard in `slot`, in roster order, but of those that have landed."""
        heard = set(self.heard(slot))
        return {
            uav: self._hull(uav, slot)
            for uav in self._roster
            if uav not in heard and not self._has_landed(uav, slot + 1)
        }

    def _has_landed(self, uav: str, slot: int) -> bool:
        """Return True if the failsafe has taken an unheard UAV out of the airspace before `slot` begins."""
        if self._knowledge.strays(uav):
            return self._knowledge.is_on_ground(uav, slot)
        if self._failsafe is None:
            return False
        office = self.office
        stepped_slot = self._knowledge.last_step(uav, office.grant, office.t0, office.sent)
        return self._knowledge.has_landed(uav, slot, self._failsafe.free_slot(stepped_slot))

    def _hull(self, uav: str, slot: int) -> Hull:
        if self._knowledge.strays(uav):
            return self._knowledge.stray_hull(uav, slot + 1, self._foreign.tables.free_m[uav])
        office = self.office
        return self._knowledge.hull(uav, office.grant, office.t0, office.sent, self._rules)

    def powerless(self, slot: int) -> Report:
        """Return the report of a slot that ended without a quorum."""
        heard = self.heard(slot)
        return Report(
            head=self._uav,
            slot=slot,
            term=self.office.grant[0],
            planner=self._mission.planner,
            status="no-quorum",
            heard=heard,
            unheard=[uav for uav in self._roster if uav not in set(heard)],
            grants=heard,
            quorum=self._quorum,
        )

    def _request(self, slot: int, fixes: Sequence[Fix], hulls: dict[str, Hull]) -> PlanRequest:
        aims = [self._aim(fix) for fix in fixes]
        here_m = [(fix.waypoint_x_m, fix.waypoint_y_m) for fix in fixes]
        return PlanRequest(
            slot=slot + 1,
            uav=[self._index[fix.uav] for fix in fixes],
            position_m=here_m,
            target_m=[aim_m for aim_m, _ in aims],
            rest_m=[rest_m for _, rest_m in aims],
            r_m=[fix.r_m for fix in fixes],
            hulls=[*hulls.values(), *self._foreign.hulls(slot, strays=True)],
            foreign=self._foreign.heard(slot),
            foreign_hulls=self._foreign.hulls(slot, strays=False, own=here_m),
            previous_m=[(fix.from_x_m, fix.from_y_m) for fix in fixes] if self._with_previous else None,
        )

    def _aim(self, fix: Fix) -> tuple[tuple[float, float], float]:
        """Return the point that the plan for this UAV aims at, and the length of the way beyond."""
        here_m = (fix.waypoint_x_m, fix.waypoint_y_m)
        return fix.course.aim(self._roster[fix.uav], here_m, self._rules.u_max_m[fix.uav], self._mission.dt_s)

    def _command(self, slot: int, fix: Fix, to_m: tuple[float, float]) -> Command:
        """Return the command to `fix.uav`, with the paper's action V_k, theta_k, alpha_k (eq. 10, 11).

        The heading of eq. 11 is theta = atan2(V_y, V_x). Eq. 12, V = V_x / cos(alpha), holds only without
        deviation; this code does not use it.
        """
        flown_s = self._mission.dt_s - 2 * self._mission.guard_s
        vx_mps, vy_mps = (to_m[0] - fix.waypoint_x_m) / flown_s, (to_m[1] - fix.waypoint_y_m) / flown_s
        heading_rad = math.atan2(vy_mps, vx_mps)
        return Command(
            head=self._uav,
            uav=fix.uav,
            slot=slot + 1,
            term=self.office.grant[0],
            start_x_m=fix.waypoint_x_m,
            start_y_m=fix.waypoint_y_m,
            target_x_m=to_m[0],
            target_y_m=to_m[1],
            vx_mps=vx_mps,
            vy_mps=vy_mps,
            speed_mps=math.hypot(vx_mps, vy_mps),
            heading_rad=heading_rad,
            deviation_rad=_deviation_rad(self._aim(fix)[0], fix, heading_rad, (vx_mps, vy_mps)),
            fix_seq=fix.seq,
        )

    def _report(self, slot: int, fixes: Sequence[Fix], hulls: dict[str, Hull], plan: Plan) -> Report:
        heard = [fix.uav for fix in fixes]
        unheard = [uav for uav in self._roster if uav not in set(heard)]
        listed = {**hulls, self._uav: self._hull(self._uav, slot)}
        return Report(
            head=self._uav,
            slot=slot,
            term=self.office.grant[0],
            planner=self._mission.planner,
            status=plan.status,
            heard=heard,
            unheard=unheard,
            grants=heard,
            quorum=self._quorum,
            plan_ms=plan_ms(plan),
            guidance_ms=plan.guidance_ms,
            assemble_ms=plan.assemble_ms,
            solve_ms=plan.solve_ms,
            iterations=plan.iterations,
            min_gap_m=plan.min_gap_m,
            hull_uav=list(listed),
            hull_ax_m=[hull.ax_m for hull in listed.values()],
            hull_ay_m=[hull.ay_m for hull in listed.values()],
            hull_bx_m=[hull.bx_m for hull in listed.values()],
            hull_by_m=[hull.by_m for hull in listed.values()],
            hull_r_m=[hull.radius_m for hull in listed.values()],
            landed=[uav for uav in unheard if uav not in hulls],
            strays=[uav for uav in hulls if self._knowledge.strays(uav)] or UNSET,
        )


def _deviation_rad(aim_m: tuple[float, float], fix: Fix, heading_rad: float, v_mps: tuple[float, float]) -> float:
    """Return the signed angle from the bearing to the aim to the velocity, in (-pi, pi]; 0 during a hold."""
    if v_mps == (0.0, 0.0):
        return 0.0
    bearing_rad = math.atan2(aim_m[1] - fix.waypoint_y_m, aim_m[0] - fix.waypoint_x_m)
    return math.remainder(heading_rad - bearing_rad, math.tau)
