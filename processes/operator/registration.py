"""Registration of claimants and remote parts with the operator, which answers each with ids or orders."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import msgspec
import zenoh

from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roles import JOIN
from edc_swarm.protocol.claims import Claims, IdClaim, Issued
from edc_swarm.protocol.keys import Keys
from processes.bus.session import hand_over
from processes.bus.subscriptions import Token
from processes.runtime.inbox import Inbox


class Registration:
    """Issue ids to claimants, and orders to parts that the operator has not launched; one answer at a time.

    Attributes
    ----------
    hosts
        Name of the host or container of each UAV that was issued to a claimant which says it.

    Parameters
    ----------
    mission
        The mission to be flown, under its id.
    remote
        The UAVs to be flown by others.
    orders
        Orders of parts, by name.
    by_name
        True on a secured bus: a claimant must name the ids whose certificates it has, and receives ids of those alone.
    """

    def __init__(
        self,
        mission: Mission,
        remote: Sequence[str] = (),
        orders: Mapping[str, bytes] | None = None,
        *,
        by_name: bool = False,
    ) -> None:
        self.mission = mission
        self._by_name = by_name
        self.claims = Claims(remote)
        self.hosts: dict[str, str] = {}
        self._orders = {Keys(mission.name).orders(name): payload for name, payload in (orders or {}).items()}

    def declare(self, session: zenoh.Session, inbox: Inbox[object]) -> None:
        """Declare the keys of claims and orders."""
        for key in (Keys(self.mission.name).claims, *self._orders):
            session.declare_queryable(key, hand_over(inbox.put))

    def see(self, token: Token) -> None:
        """Register a liveliness token that appeared or vanished."""
        if token.uav == JOIN:
            self.claims.see_claimant(token.instance, token.alive)
        elif token.alive:
            self.claims.see_uav(token.uav, token.instance)

    def answers(self, query: zenoh.Query) -> list[bytes]:
        """Return the answers to a query, none if it is for somebody else."""
        key = str(query.key_expr)
        if key == Keys(self.mission.name).claims:
            return self._issue(query.payload.to_bytes() if query.payload is not None else b"")
        return [self._orders[key]] if key in self._orders else []

    def _issue(self, payload: bytes) -> list[bytes]:
        """Return the answer to a claim, none to a malformed one."""
        try:
            claim = msgspec.json.decode(payload, type=IdClaim)
        except msgspec.DecodeError:
            return []
        if self._by_name and not claim.among:
            return [msgspec.json.encode(Issued(mission=self.mission))]
        of_cluster = claim.by_name(self.mission)
        if of_cluster is None:
            return [msgspec.json.encode(Issued(mission=self.mission))]
        claim = of_cluster
        left, uavs = len(self.claims.free(claim.among)), self.claims.issue(claim)
        self.hosts.update(dict.fromkeys(uavs, claim.host) if claim.host else {})
        return [msgspec.json.encode(Issued(mission=self.mission, uavs=uavs, left=left, begun=self.claims.begun))]
