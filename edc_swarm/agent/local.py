"""Local control: no head, no election; each UAV plans its own steps from the fixes that it has heard.

`NoElection` stands beside `election.Election`, `LocalControl` beside `leadership.Leadership`; each answers what the
node asks. The UAV grants nobody, and its own plan is a command of nobody in term 0, which no message carries: what it
does is in its next fix. So the only messages of the swarm are fixes, and every UAV hears all of them.

A UAV plans the next slot once it has heard all others in this one, and at the latest at `PLAN_AT_SHARE` of the slot.
Of a neighbour it knows the newest fix that has arrived over its links, and the start in the roster before the first.
"""

from __future__ import annotations

from edc_swarm.agent.election import TermClaim
from edc_swarm.agent.knowledge import Grant, Knowledge
from edc_swarm.agent.planning_state import PlanningState
from edc_swarm.agent.slot_clock import SlotClock
from edc_swarm.agent.vehicle import Vehicle
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.planner.interface import Neighbour, Plan, Planner, PlanRequest
from edc_swarm.protocol.messages import NO_ONE, Command, Fix, Report

PLAN_AT_SHARE = 0.9
"""Share of a slot after which a UAV plans without the fixes that it lacks: no command has to travel afterwards."""
LATELY_SLOTS = 3
"""A UAV does not wait for a neighbour that it has not heard for more slots than this."""


class NoElection:
    """The election of a swarm without a head: every UAV grants nobody, suspects nobody, and hears all fixes."""

    def __init__(self, uav: str) -> None:
        self._uav = uav
        self.term = 0
        self.grant: Grant = (0, NO_ONE)
        self.leads = False
        self.in_office = False
        self.suspects = False
        self.listens = True
        self.claim: TermClaim | None = None

    def begin_slot(self, slot: int) -> None:
        """Let time pass, which changes nothing."""

    def hear_fix(self, fix: Fix) -> None:
        """Ignore what a fix says of heads."""

    def renew_lease(self) -> None:
        """Trust nobody for longer: a command comes from the UAV itself."""

    def hear_report(self, report: Report) -> None:
        """Ignore a report: nobody leads."""

    def peer_gone(self, uav: str) -> None:
        """Ignore a UAV that vanished: it was no head."""


class LocalControl(PlanningState):
    """One UAV that plans for itself; the node asks it what it asks `Leadership`."""

    def __init__(self, mission: Mission, uav: str, knowledge: Knowledge, clock: SlotClock) -> None:
        super().__init__()
        self._mission = mission
        self._uav = uav
        self._knowledge = knowledge
        self._clock = clock
        self._entries = list(mission.roster)
        self._index = knowledge.index
        self._planned_slot = -1

    def take_office(self, slot: int, now_ns: int) -> bool:  # noqa: ARG002  (as in Leadership)
        """Return False: there is no office."""
        return False

    def collects(self, slot: int) -> bool:
        """Return True if this UAV has not planned from the fixes of `slot` yet."""
        return slot >= 0 and self._planned_slot < slot

    def missed(self, slot: int) -> Report | None:  # noqa: ARG002  (as in Leadership)
        """Return None: nobody reports."""
        return None

    def deadline_ns(self, slot: int) -> int:
        """Return the time until which this UAV waits for fixes."""
        return self._clock.start_ns(slot) + round(PLAN_AT_SHARE * self._clock.slot_ns)

    def plan_due(self, slot: int, now_ns: int) -> bool:
        """Return True if it is time to plan from the fixes of `slot`."""
        if self.planner is None or not self.collects(slot):
            return False
        return now_ns >= self.deadline_ns(slot) or self._has_all(slot)

    def plan(self, slot: int, planner: Planner, vehicle: Vehicle) -> Plan:
        """Plan the own step for slot + 1 and keep it as the own command."""
        self._planned_slot = slot
        plan = planner.plan(self.request(slot, vehicle))
        (x_m, y_m), (to_x_m, to_y_m) = vehicle.waypoint_m, plan.waypoint_m[0]
        self.own_command = Command(
            head=NO_ONE,
            uav=self._uav,
            slot=slot + 1,
            term=0,
            start_x_m=x_m,
            start_y_m=y_m,
            target_x_m=to_x_m,
            target_y_m=to_y_m,
        )
        return plan

    def request(self, slot: int, vehicle: Vehicle) -> PlanRequest:
        """Return the request for the own step of slot + 1: the own state, and what is known of the neighbours."""
        own = self._index[self._uav]
        entry, here_m = self._entries[own], vehicle.waypoint_m
        aim_m, rest_m = vehicle.course.aim(entry, here_m, vehicle.u_max_m, self._mission.dt_s)
        return PlanRequest(
            slot=slot + 1,
            uav=[own],
            position_m=[here_m],
            target_m=[aim_m],
            rest_m=[rest_m],
            r_m=[vehicle.r_m],
            neighbours=[self._neighbour(other, slot) for other in self._entries if other.uav != self._uav],
        )

    def _has_all(self, slot: int) -> bool:
        """Return True if every UAV that is on the bus and was heard lately is heard in `slot`."""
        last_slots = (self._knowledge.last_slot(uav) for uav in self._index if uav not in self.gone)
        return all(last == slot for last in last_slots if slot - last <= LATELY_SLOTS)

    def _neighbour(self, entry: RosterEntry, slot: int) -> Neighbour:
        index, fix = self._index[entry.uav], self._knowledge.newest.get(entry.uav)
        if fix is None:
            return Neighbour(index, entry.start_x_m, entry.start_y_m, 0.0, 0.0, entry.r_m, slot + 1)
        step_m = fix.waypoint_x_m - fix.from_x_m, fix.waypoint_y_m - fix.from_y_m
        return Neighbour(index, fix.waypoint_x_m, fix.waypoint_y_m, *step_m, fix.r_m, slot - fix.slot)
