"""Candidates for the head: their ranking, failed attempts, and the successor that a head names."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from functools import cached_property
from typing import Protocol

from edc_swarm.agent.knowledge import Grant
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.plug_ins import called, made, number
from edc_swarm.protocol.messages import Fix, roster_index

HANDOVER_SLOTS = 20
"""Least number of slots between two planned handovers."""
ACTING_SLOTS = 3
"""Least number of slots for which a head by the rota leads: the standbys that it names can load the planner."""


class Criterion(Protocol):
    """A criterion of the user, made as `Class(mission)`; every UAV has one, and all must agree."""

    def value(self, fix: Fix) -> float:
        """Return the value of the UAV of a fix as a head, from the fix alone: the least one is elected."""


class Candidates:
    """Ranking of candidates by the mission's criterion, and the heads that were granted and never led.

    Attributes
    ----------
    failed
        Heads that were granted and never led, since a head led last.
    led
        True if the head granted has led.
    """

    def __init__(self, mission: Mission) -> None:
        self._key = _CRITERIA.get(mission.elect) or _own_criterion(mission)
        self._margin = mission.handover_margin
        self._mission = mission
        self.failed: set[str] = set()
        self.led = True

    @cached_property
    def _order(self) -> dict[str, int]:
        return roster_index(self._mission.roster)

    def note_lead(self) -> None:
        """Note that the head granted leads."""
        self.led = True
        self.failed.clear()

    def ranked(self, among: Sequence[Fix]) -> list[str]:
        """Return the ids of the voters by the mission's criterion, best first, ties in roster order.

        UAVs that suspect their head come last: they may not hear.
        """
        voters = [fix for fix in among if fix.voter]
        return [fix.uav for fix in sorted(voters, key=lambda fix: (fix.suspects, self._key(fix), self._order[fix.uav]))]

    def in_turn(self, among: Sequence[Fix], granted: Collection[str]) -> list[str]:
        """Return the ids in the order in which they may claim; `granted` are the heads of the newest term.

        A head that was granted and never led (it cannot hear or cannot plan) is a candidate again after all
        others. All heads of the newest term count as such, not only the own one: so the UAVs agree again after a
        split vote.
        """
        if not self.led:
            self.failed.update(granted)
        return sorted(self.ranked(among), key=lambda uav: uav in self.failed)

    def successor(self, head: Grant, heard: Sequence[Fix], newest: Sequence[Fix], may_hand_over: bool) -> Grant | None:
        """Return the grant that the head's next report asks for, or None if the head stays.

        The head succeeds itself in a higher term if a UAV cannot join this one: its newest fix shows a newer term,
        or this term with another head. Otherwise, if it may hand over, the best UAV of those heard succeeds it if its
        criterion is better by `handover_margin`.
        """
        term, uav = head
        astray = [fix.term for fix in newest if fix.term > term or (fix.term == term and fix.head != uav)]
        if astray:
            return (max(astray) + 1, uav)
        if not may_hand_over:
            return None
        best = self.ranked(heard)[0]
        keys = {fix.uav: self._key(fix) for fix in heard}
        if best != uav and keys[uav] - keys[best] > self._margin * abs(keys[uav]):
            return (term + 1, best)
        return None


def _by_energy(fix: Fix) -> float:
    """Return the key of the paper's criterion i: most remaining energy first."""
    return -fix.energy_j


def _by_response_time(fix: Fix) -> float:
    """Return the key of the paper's criterion ii: shortest response time first, an unmeasured one last."""
    return fix.response_ms if fix.response_ms > 0 else float("inf")


def _own_criterion(mission: Mission) -> Callable[[Fix], float]:
    """Return the key of a criterion of the user: the least value first."""
    name = mission.elect
    criterion: Criterion = made("elect", name, "value", mission)
    return lambda fix: number("elect", name, called("elect", name, lambda: criterion.value(fix)))


_CRITERIA: dict[str, Callable[[Fix], float]] = {"energy": _by_energy, "response-time": _by_response_time}
