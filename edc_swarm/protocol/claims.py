"""Register of UAV ids: the operator issues each id to one claimant.

A *claimant* is one start of `edc-swarm join` with its folder of state; its token, 16 hexadecimal
digits, outlives its process in that folder.

==============  ================================================================================
the mission     an id whose claimant is gone
==============  ================================================================================
has not begun   is free: the claimant has promised nothing yet. If it returns, the mission
                message, which names the claimant of every UAV, tells its UAVs to leave.
has begun       stays with the claimant: only its folder has the UAV's promise. A claimant that
                returns gets its ids again, and no other claimant gets an id.
==============  ================================================================================

The operator fills the register from requests and from liveliness tokens, since the name of every UAV's instance
ends with its claimant. So the register of a restarted operator is soon complete.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Annotated

import msgspec
from msgspec import Meta, Struct

from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.field_types import MAX_UAVS, ClusterName
from edc_swarm.protocol.messages import UavIds

LAUNCHED = ""
"""Claimant of the UAVs that the operator's own command starts."""

MAX_CLAIMANTS = 10_000
"""Most claimants whose presence the register remembers, more than can hold an id: a limit on a flood of tokens."""

Claimant = Annotated[str, Meta(pattern=r"^[0-9a-f]{16}$(?!\n)")]


class IdClaim(Struct, frozen=True, kw_only=True):
    """Request for `uavs` ids, or for the ids that this claimant already has.

    `among` has the ids that it can fly; empty stands for all. With a `cluster` it wants UAVs of that alone. `host` is
    the name of its host or container, for people.
    """

    claimant: Claimant
    uavs: Annotated[int, Meta(ge=1, le=MAX_UAVS)]
    among: UavIds = []
    cluster: ClusterName = ""
    host: Annotated[str, Meta(pattern=r"^[A-Za-z0-9_.-]{0,64}$(?!\n)")] = ""

    def by_name(self, mission: Mission) -> IdClaim | None:
        """Return the claim with the ids of its cluster, if it names one; None if no UAV is of it and in `among`."""
        if not self.cluster:
            return self
        members = [entry.uav for entry in mission.roster if entry.cluster == self.cluster]
        among = [uav for uav in members if not self.among or uav in self.among]
        return msgspec.structs.replace(self, among=among) if among else None


class Issued(Struct, frozen=True, kw_only=True):
    """Answer to a request: as many ids as it asks for, or none, and the number of free ids.

    `begun` is true if the mission runs, so that the claimant must have these UAVs' promises.
    """

    mission: Mission
    uavs: UavIds = []
    left: int = 0
    begun: bool = False


class Claims:
    """Register of one mission; `remote` has the ids to issue, in order.

    Attributes
    ----------
    begun
        The mission has begun: the register issues no further id.
    """

    def __init__(self, remote: Sequence[str]) -> None:
        self._holder: dict[str, str | None] = dict.fromkeys(remote)
        self._there: set[str] = set()
        self.begun = False

    def see_claimant(self, claimant: str, there: bool) -> None:
        """Note that a claimant is present, or gone."""
        if not there:
            self._there.discard(claimant)
        elif len(self._there) < MAX_CLAIMANTS:
            self._there.add(claimant)

    def see_uav(self, uav: str, instance: str) -> None:
        """Note that a UAV is present: its claimant holds the id, unless another claimant does."""
        claimant = claimant_of(instance)
        if claimant != LAUNCHED and uav in self._holder and self._holder[uav] is None:
            self._holder[uav] = claimant

    def issue(self, claim: IdClaim) -> list[str]:
        """Return the ids that the claimant now holds: as many as it asks for, or none.

        A claim may overtake the claimant's token, and also shows that the claimant is present.
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
        """Return the ids of a claimant."""
        return [uav for uav, holder in self._holder.items() if holder == claimant]

    @property
    def held(self) -> set[str]:
        """Ids of the claimants that are present."""
        return {uav for uav, holder in self._holder.items() if holder in self._there}

    def free(self, among: Sequence[str] = ()) -> list[str]:
        """Return the ids that the register can issue, of those in `among` if there are any.

        The ids of claimants that are gone come last: these may be back in a moment.
        """
        wanted = self._holder.keys() & among if among else self._holder.keys()
        free = [uav for uav, holder in self._holder.items() if holder not in self._there and uav in wanted]
        return [] if self.begun else sorted(free, key=lambda uav: self._holder[uav] is not None)

    def begin(self) -> None:
        """Issue no further id: the mission begins."""
        self.begun = True

    def resume(self, holders: dict[str, str]) -> None:
        """Continue the register of a mission that has begun."""
        self._holder = dict(holders)
        self.begun = True

    def claimants(self, roster: Sequence[str]) -> tuple[str, ...]:
        """Return the claimant of every UAV of `roster`; empty if no UAV is remote."""
        return tuple(self._holder.get(uav) or LAUNCHED for uav in roster) if self._holder else ()


def instance_name(process: str, claimant: str) -> str:
    """Return the name of an instance of a UAV process, which ends with its claimant."""
    return f"{process}-{claimant}" if claimant else process


def claimant_of(instance: str) -> str:
    """Return the claimant in the name of an instance."""
    end = instance.rpartition("-")[2]
    return end if re.fullmatch("[0-9a-f]{16}", end) else LAUNCHED
