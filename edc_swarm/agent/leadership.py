"""Leadership of one UAV: its grants, its wait for fixes, its plans and its reports."""

from __future__ import annotations

import msgspec

from edc_swarm.agent.election import Election
from edc_swarm.agent.foreign import Foreign
from edc_swarm.agent.head import Head
from edc_swarm.agent.knowledge import ABSENT_SLOTS, Knowledge
from edc_swarm.agent.planning_state import PlanningState
from edc_swarm.agent.rota import Rota
from edc_swarm.agent.slot_clock import SlotClock
from edc_swarm.mission.clusters import cluster_names, of_cluster
from edc_swarm.mission.configuration import Mission
from edc_swarm.protocol.messages import Report

CLAIM_WAIT_FRACTION = 0.1
"""Fraction of a slot for which a new head waits for retransmitted fixes."""


def startup_candidates(mission: Mission) -> set[str]:
    """Return the UAVs that plan first: those on duty when the mission begins, all in a mission without a head."""
    if mission.control == "local":
        return {entry.uav for entry in mission.roster}
    clusters = (of_cluster(mission, name) for name in cluster_names(mission.roster))
    return {uav for cluster in clusters for uav in Rota(cluster).on_duty(0)}


class Leadership(PlanningState):
    """One UAV's duty as head, or as a UAV that may have to lead.

    Attributes
    ----------
    head
        The head's memory of its term, and its plans.
    """

    def __init__(
        self,
        mission: Mission,
        uav: str,
        knowledge: Knowledge,
        election: Election,
        clock: SlotClock,
        foreign: Foreign | None = None,
    ) -> None:
        super().__init__()
        self._mission = mission
        self._uav = uav
        self._knowledge = knowledge
        self._election = election
        self._clock = clock
        self._office_ns = 0
        self._foreign = foreign
        self.head = Head(mission, uav, election.term, knowledge, foreign)

    def take_office(self, slot: int, now_ns: int) -> bool:
        """Begin the term granted if this UAV leads it; return True if it may plan."""
        if not self._election.leads:
            return False
        self.head.take_office(self._election.grant)
        self._office_ns = now_ns
        return self.head.may_plan(slot)

    def collects(self, slot: int) -> bool:
        """Return True if this UAV is head and has not planned from the fixes of `slot` yet."""
        election = self._election
        return election.leads and self.head.office.grant == election.grant and slot >= 0 and self.head.may_plan(slot)

    def missed(self, slot: int) -> Report | None:
        """Return the report of a slot that is over and had no plan for want of a quorum; None for any other."""
        return self.head.powerless(slot) if self.collects(slot) else None

    def deadline_ns(self, slot: int) -> int:
        """Return the time until which the head waits for fixes; it is later in the slot in which it took office."""
        tau_ns = self._clock.start_ns(slot) + self._clock.tau_ns
        return max(tau_ns, self._office_ns + round(CLAIM_WAIT_FRACTION * self._clock.slot_ns))

    def plan_due(self, slot: int, now_ns: int) -> bool:
        """Return True if it is time to plan from the fixes of `slot`."""
        if self.planner is None or not self.collects(slot) or not self.head.has_quorum(slot):
            return False
        if now_ns >= self.deadline_ns(slot):
            return True
        # Without their fixes foreign UAVs are hulls a step wide, which may cover targets for as long as that lasts.
        return not (self._foreign is not None and self._foreign.awaited) and self.head.complete(slot, self.gone)

    def planned(self) -> None:
        """Note that this UAV has planned as head."""
        self._election.planned()

    def with_succession(self, report: Report) -> Report:
        """Return the report with the standbys, and with the successor if the head names one.

        The standbys are ranked anew in each slot that lacks no fix. In any other one those stay whose fixes are only
        late: each new standby loads and rehearses the planner and hears all fixes, so an overloaded swarm whose head
        named others in each slot would never get rid of its load.
        """
        heard = [self._knowledge.newest[uav] for uav in report.heard]
        ranked = [uav for uav in self._election.candidates.ranked(heard) if uav != self._uav]
        if not self.head.complete(report.slot, self.gone):
            kept = [uav for uav in self._election.standbys if self._stays(uav, report.slot)]
            ranked = [*kept, *(uav for uav in ranked if uav not in kept)]
        next_term, successor = self._election.pick_successor(heard, not report.unheard) or (0, "")
        return msgspec.structs.replace(
            report, standby=ranked[: self._mission.standbys], successor=successor, next_term=next_term
        )

    def _stays(self, uav: str, slot: int) -> bool:
        """Return True if a standby was heard lately, trusts its head, and has not left the bus."""
        fix = self._knowledge.newest.get(uav)
        return fix is not None and slot - fix.slot <= ABSENT_SLOTS and not fix.suspects and uav not in self.gone

    @property
    def may_plan_soon(self) -> bool:
        """True if this UAV may have to lead."""
        return self._election.listens
