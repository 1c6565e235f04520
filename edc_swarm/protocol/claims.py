"""Who flies which UAV: the operator's book of the ids that it issues.

A *claimant* is one start of `edc-swarm join` with its folder of state; its token, 16 hexadecimal
digits, outlives its process there. An id is issued to one claimant. Once the mission has begun that is
final, since the UAV's promise is in that folder and nowhere else: a claimant that comes back gets
its ids back, everybody else gets nothing. Before, nothing has been promised, so the ids of a
claimant that has gone are free again; should it come back after all, the mission message, which
names the claimant of every UAV, tells its UAVs to leave.

The book is written from liveliness tokens as well as from requests, so that of an operator that was
started again is soon whole: every UAV's instance ends with its claimant.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Annotated

from msgspec import Meta, Struct

from edc_swarm.mission.configuration import MAX_UAVS, Mission
from edc_swarm.protocol.messages import UavIds

LAUNCHED = ""
"""Stands for the claimant of the UAVs that the operator's own command has started."""

MAX_CLAIMANTS = 10_000
"""Claimants whose presence is remembered, more than can hold an id: a flood of tokens fills no memory."""

Claimant = Annotated[str, Meta(pattern=r"^[0-9a-f]{16}$(?!\n)")]


class Claim(Struct, frozen=True, kw_only=True):
    """The request for `uavs` ids, or for those that this claimant has already.

    `among`: the ids that it can fly, any where there are none.
    """

    claimant: Claimant
    uavs: Annotated[int, Meta(ge=1, le=MAX_UAVS)]
    among: UavIds = []


class Issued(Struct, frozen=True, kw_only=True):
    """The answer: the ids, all that were asked for or none, and how many there were left.

    `begun`: the mission is being flown, and so is what these UAVs have promised.
    """

    mission: Mission
    uavs: UavIds = []
    left: int = 0
    begun: bool = False


class Claims:
    """The book of one mission; `remote` are the ids to be issued, in the order in which they are.

    Attributes
    ----------
    begun
        Nothing is issued any more: the mission has begun.
    """

    def __init__(self, remote: Sequence[str]) -> None:
        self._holder: dict[str, str | None] = dict.fromkeys(remote)
        self._there: set[str] = set()
        self.begun = False

    def see_claimant(self, claimant: str, there: bool) -> None:
        """Take in that a claimant is there, or has gone."""
        if not there:
            self._there.discard(claimant)
        elif len(self._there) < MAX_CLAIMANTS:
            self._there.add(claimant)

    def see_uav(self, uav: str, instance: str) -> None:
        """Take in that a UAV is there: its claimant holds the id, unless another one does."""
        claimant = claimant_of(instance)
        if claimant != LAUNCHED and uav in self._holder and self._holder[uav] is None:
            self._holder[uav] = claimant

    def issue(self, claim: Claim) -> list[str]:
        """The ids that the claimant holds now: as many as it asks for, or none.

        A claim may overtake the claimant's token, and shows as well that it is there.
        """
        self.see_claimant(claim.claimant, True)
        held = self.held_by(claim.claimant)
        if held:
            return held
        free = self.free(claim.among)
        if len(free) < claim.uavs:
            return []
        self._holder.update(dict.fromkeys(free[: claim.uavs], claim.claimant))
        return free[: claim.uavs]

    def held_by(self, claimant: str) -> list[str]:
        """The ids of a claimant."""
        return [uav for uav, holder in self._holder.items() if holder == claimant]

    @property
    def held(self) -> set[str]:
        """The ids of claimants that are there."""
        return {uav for uav, holder in self._holder.items() if holder in self._there}

    def free(self, among: Sequence[str] = ()) -> list[str]:
        """The ids that can be issued, of those in `among` if there are any.

        Last those of claimants that have gone, who may be back in a moment.
        """
        wanted = self._holder.keys() & among if among else self._holder.keys()
        free = [uav for uav, holder in self._holder.items() if holder not in self._there and uav in wanted]
        return [] if self.begun else sorted(free, key=lambda uav: self._holder[uav] is not None)

    def begin(self) -> None:
        """Issue nothing from now on: the mission begins."""
        self.begun = True

    def resume(self, holders: dict[str, str]) -> None:
        """Go on with the book of a mission that has begun."""
        self._holder = dict(holders)
        self.begun = True

    def claimants(self, roster: Sequence[str]) -> tuple[str, ...]:
        """The claimant of every UAV of `roster`; empty where none is remote."""
        return tuple(self._holder.get(uav) or LAUNCHED for uav in roster) if self._holder else ()


def instance_name(process: str, claimant: str) -> str:
    """Name of one life of a UAV process, by which its claimant is known."""
    return f"{process}-{claimant}" if claimant else process


def claimant_of(instance: str) -> str:
    """The claimant in the name of an instance."""
    end = instance.rpartition("-")[2]
    return end if re.fullmatch("[0-9a-f]{16}", end) else LAUNCHED
