"""The parts of a UAV process that need the mission."""

from __future__ import annotations

from dataclasses import dataclass

import msgspec

from edc_swarm.agent.node import Effect, Publish, Tick, UavNode
from edc_swarm.agent.vehicle import first_airframe, first_promise
from edc_swarm.emulation.links import mission_s
from edc_swarm.mission.autopilots import autopilots
from edc_swarm.mission.configuration import NS_PER_S
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.protocol.codec import encode
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.messages import MissionMessage, Truth
from processes.bus.subscriptions import Postbox
from processes.uav.autopilot_part import AutopilotPart
from processes.uav.local_faults import LocalFaults

INTERRUPTED, FAILED = "interrupted", "failed"
"""Ends of a mission that is broken off."""
FLY_OUT_SLOTS = 2
"""Slots for which UAVs stay after the end of a mission with autopilots."""


@dataclass(slots=True)
class Flight:
    """The parts of a UAV process that need the mission.

    `leave_ns` is the time from which on the process leaves, once the mission is over.
    """

    mission: MissionMessage
    node: UavNode
    postbox: Postbox
    faults: LocalFaults
    autopilot: AutopilotPart | None = None
    wake_ns: int = 0
    leave_ns: int | None = None

    def mission_s(self, now_ns: int) -> float:
        """Return the mission seconds at `now_ns` of the own clock."""
        return mission_s(now_ns - self.mission.epoch_ns, self.mission.time_scale)

    def left_s(self, part: float, now_ns: int) -> float:
        """Return the wall time until this part of the slot that the node has begun is over, negative if it is."""
        return (self.mission.epoch_ns + (self.node.slot + part) * self.mission.slot_ns - now_ns) / NS_PER_S

    def end(self, why: str, now_ns: int) -> None:
        """Set the time to leave: now, or two slots later if the mission has autopilots and was not broken off.

        A vehicle flies its declared path half a slot late, so it is still on its last step when the mission is over;
        and a slot is told one or two slots late. All UAVs stay, so that the head stays too.
        """
        stays = why not in {INTERRUPTED, FAILED} and autopilots(self.mission)
        slot = (now_ns - self.mission.epoch_ns) // self.mission.slot_ns
        self.leave_ns = self.mission.epoch_ns + (slot + FLY_OUT_SLOTS) * self.mission.slot_ns if stays else now_ns

    def place(self, truth: Truth) -> None:
        """Give the emulated radio the true position of a UAV."""
        self.postbox.links.place(truth.uav, truth.to_x_m, truth.to_y_m)

    def delay_error(self) -> list[Effect]:
        """Return the event about the lateness of postponed messages, none if there were none."""
        error = self.postbox.delay_error
        if error is None:
            return []
        return [self.node.event(EventKind.DELAY_ERROR, msgspec.json.encode(error).decode())]

    def link_delays(self) -> list[Effect]:
        """Return the event about the delays of the emulated links, none where all links are perfect."""
        if not self.postbox.links.has_rules:
            return []
        told = msgspec.json.encode(self.postbox.links.log.told()).decode()
        return [self.node.event(EventKind.LINK_DELAYS, told)]


def rehearse(mission: MissionMessage, entry: RosterEntry) -> None:
    """Begin a slot with a UAV that nobody hears of, before take-off.

    A forked process gets its own copy of each page of memory that it writes to, when it first does. K processes that
    did this in the tick of slot 0 were late for it.
    """
    node = UavNode(mission, entry.uav, "rehearsal", first_promise(entry), first_airframe(entry))
    for effect in node.step(Tick(), mission.epoch_ns):
        if isinstance(effect, Publish):
            encode(effect.message)
