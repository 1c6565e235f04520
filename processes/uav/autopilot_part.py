"""The autopilot of one UAV process: its pilot, its link and the body that the node flies."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from edc_swarm.autopilot.body import AutopilotBody
from edc_swarm.autopilot.pilot import Pilot, Said, Stage
from edc_swarm.mission.autopilots import autopilots
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.protocol.messages import MissionMessage
from processes.runtime.clock import MissionClock
from processes.runtime.inbox import Inbox
from processes.uav.autopilot_link import AutopilotLink, check_package
from processes.uav.state import UavState

LANDING_SPARE_S = 12.0
"""Time beyond `landing_s` after which a process no longer waits for the landing of its vehicle."""
LOOK_DOWN_S = 0.05
"""Time between two looks at a landing."""


@dataclass(frozen=True, slots=True)
class AutopilotPart:
    """Pilot, link and body of one UAV."""

    mission: MissionMessage
    pilot: Pilot
    link: AutopilotLink
    body: AutopilotBody

    @classmethod
    def of(
        cls,
        mission: MissionMessage,
        entry: RosterEntry,
        state: UavState,
        clock: MissionClock,
        inbox: Inbox[Any],
        *,
        arm: bool,
    ) -> AutopilotPart | None:
        """Open the link to the autopilot of a UAV; None for a UAV that is emulated."""
        address = autopilots(mission).get(entry.uav)
        if address is None:
            return None
        check_package(address)
        promise = state.promise
        flies = promise is not None and promise.slot >= 0
        pilot = Pilot(mission, entry, mission.epoch_ns, arm=arm, flies=flies)
        at_m = (entry.start_x_m, entry.start_y_m)
        if promise is not None:
            at_m = (promise.waypoint_x_m, promise.waypoint_y_m)
        link = AutopilotLink(address, pilot, clock.now_ns, inbox.put_always)
        return cls(mission, pilot, link, AutopilotBody(mission, mission.epoch_ns, entry, pilot, at_m))

    def landed(self) -> Iterator[Said]:
        """Land, wait for the ground, and yield what is to be said of it; then close the link."""
        flew = self.pilot.stage in {Stage.ARMING, Stage.CLIMBING, Stage.FLYING, Stage.LANDING}
        news: list[Said] = []
        self.link.tell_to(news.append)
        self.link.land()
        end_s = time.monotonic() + (self.mission.landing_s + LANDING_SPARE_S if flew else 0.0)
        while flew and self.pilot.stage is not Stage.DONE and time.monotonic() < end_s:
            time.sleep(LOOK_DOWN_S)
        self.link.close()
        yield from news
        if self.link.complaints:
            yield Said("autopilot", f"on its link came {self.link.complaints}")
