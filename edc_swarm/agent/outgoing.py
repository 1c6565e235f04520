"""Messages of one UAV: fix, truth, event and claim, stamped with instance and sequence number."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import msgspec
from msgspec import UNSET

from edc_swarm.agent.election import Election, TermClaim
from edc_swarm.agent.flight import Flight
from edc_swarm.agent.local import NoElection
from edc_swarm.agent.vehicle import Vehicle
from edc_swarm.emulation.body import PastFlight
from edc_swarm.geodesy import to_wgs84
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.keys import Keys
from edc_swarm.protocol.messages import Event, Fix, Message, MissionMessage, Report, Truth

M = TypeVar("M", bound=Message)


class Outgoing:
    """Maker of one UAV's messages. It keeps the last sequence number of each key."""

    def __init__(
        self,
        mission: MissionMessage,
        uav: str,
        instance: str,
        voter: bool,
        response_ms: float,
        cpu_s: Callable[[], float],
    ) -> None:
        self._mission = mission
        self._uav = uav
        self._instance = instance
        self._voter = voter
        self._response_ms = response_ms
        self._cpu_s = cpu_s
        self._keys = Keys(mission.name)
        self.seqs: dict[str, int] = {}

    def stamped(self, message: M) -> M:
        """Return the message with the instance and the next sequence number of its key."""
        key = self._keys.of(message)
        seq = self.seqs.get(key, -1) + 1
        self.seqs[key] = seq
        return msgspec.structs.replace(message, instance=self._instance, seq=seq)

    def take_back(self, unsaid: Sequence[Message]) -> None:
        """Give the numbers of stamped messages that are never published to the next ones on their keys."""
        for message in unsaid:
            key = self._keys.of(message)
            self.seqs[key] = min(self.seqs[key], message.seq - 1)

    def event(self, slot: int, kind: EventKind, detail: str) -> Event:
        """Return an event, not yet stamped."""
        return Event(source=self._uav, slot=slot, kind=kind, detail=detail)

    def truths(self, slot: int, vehicle: Vehicle) -> list[Truth]:
        """Return the true motion of a slot, not yet stamped; of an autopilot, of the slots that it has reported."""
        flown = vehicle.flown
        if flown.past is not None:
            return [self._reported(past) for past in flown.past]
        (from_x_m, from_y_m), (to_x_m, to_y_m) = flown.from_m, flown.to_m
        truth = Truth(uav=self._uav, slot=slot, from_x_m=from_x_m, from_y_m=from_y_m, to_x_m=to_x_m, to_y_m=to_y_m)
        if flown.between_m is None:
            return [truth]
        return [
            msgspec.structs.replace(
                truth,
                waypoint_x_m=vehicle.waypoint_m[0],
                waypoint_y_m=vehicle.waypoint_m[1],
                between_x_m=[x_m for x_m, _ in flown.between_m],
                between_y_m=[y_m for _, y_m in flown.between_m],
                propulsion_j=flown.propulsion_j,
                saturated=flown.saturated,
            )
        ]

    def _reported(self, past: PastFlight) -> Truth:
        """Return the truth of a slot by an autopilot's reports, which say nothing of the energy of propulsion."""
        (from_x_m, from_y_m), *between_m, (to_x_m, to_y_m) = past.path_m
        return Truth(
            uav=self._uav,
            slot=past.slot,
            from_x_m=from_x_m,
            from_y_m=from_y_m,
            to_x_m=to_x_m,
            to_y_m=to_y_m,
            waypoint_x_m=past.waypoint_m[0],
            waypoint_y_m=past.waypoint_m[1],
            between_x_m=[x_m for x_m, _ in between_m],
            between_y_m=[y_m for _, y_m in between_m],
        )

    def claim(self, slot: int, claim: TermClaim) -> Report:
        """Return the report of a standby's claim, not yet stamped."""
        return Report(
            head=self._uav,
            slot=slot,
            term=claim.term,
            planner=self._mission.planner,
            status="claim",
            grants=list(claim.suspecting),
            quorum=self._mission.quorum,
        )

    def fix(self, slot: int, vehicle: Vehicle, flight: Flight, election: Election | NoElection) -> Fix:
        """Return the fix of a slot, not yet stamped."""
        flown = flight.flown
        x_m, y_m = vehicle.position_m
        lat_deg, lon_deg = self.wgs84(vehicle.position_m)
        term, head = election.grant
        return Fix(
            uav=self._uav,
            slot=slot,
            x_m=x_m,
            y_m=y_m,
            lat_deg=lat_deg,
            lon_deg=lon_deg,
            r_m=vehicle.r_m,
            waypoint_x_m=vehicle.waypoint_m[0],
            waypoint_y_m=vehicle.waypoint_m[1],
            executing=flown is not None,
            command_term=flown.term if flown is not None else -1,
            command_seq=flown.seq if flown is not None else -1,
            arrived=vehicle.arrived,
            term=term,
            head=head,
            suspects=election.suspects,
            voter=self._voter and vehicle.flown.stray_m is None,
            stray_m=UNSET if vehicle.flown.stray_m is None else vehicle.flown.stray_m,
            on_ground=vehicle.flown.on_ground or UNSET,
            from_x_m=vehicle.from_m[0],
            from_y_m=vehicle.from_m[1],
            energy_j=vehicle.energy_j,
            response_ms=self._response_ms,
            held_slots=flight.held_slots,
            late_ticks=flight.late_ticks,
            cpu_s=self._cpu_s(),
            course=vehicle.course,
        )

    def wgs84(self, position_m: tuple[float, float]) -> tuple[float, float]:
        """Return latitude and longitude of a position; the conversion is cached."""
        return to_wgs84(*position_m, self._mission.origin_lat_deg, self._mission.origin_lon_deg)
