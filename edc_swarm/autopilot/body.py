"""The vehicle of an autopilot as a `Body`: steps in, reported positions out.

A step begins at the start of its slot, so `fly` hands it to the pilot, which sends the set-points from another thread.
The true motion is known when the autopilot has reported a position after the slot's end. At the start of the next
slot that report is mostly still on its way, so a slot is told one or two slots late: `Flown.past`.
"""

from __future__ import annotations

import math
from collections import deque

from edc_swarm.autopilot.path import Point, Step
from edc_swarm.autopilot.pilot import Pilot, Stage
from edc_swarm.autopilot.telemetry import track_s
from edc_swarm.emulation.body import Flown, PastFlight
from edc_swarm.mission.configuration import NS_PER_S, Mission
from edc_swarm.mission.control_loop import loop_step
from edc_swarm.mission.failsafe import failsafe_of
from edc_swarm.mission.faults import VehicleFault
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.mission.vehicle_budget import vehicle_of


class AutopilotBody:
    """The vehicle that `pilot` flies, at its first waypoint `at_m`."""

    state = None

    def __init__(self, mission: Mission, epoch_ns: int, entry: RosterEntry, pilot: Pilot, at_m: Point) -> None:
        self._mission = mission
        self._epoch_ns = epoch_ns
        self._at_m = at_m
        self._pilot = pilot
        self._free_mps = vehicle_of(mission, entry).free_mps
        self._failsafe = failsafe_of(mission)
        self._parts = loop_step(1.0, 0.0, mission.dt_s).samples
        self._untold: deque[tuple[int, Point]] = deque(maxlen=math.ceil(track_s(mission) / mission.dt_s))
        self.standing = Flown(at_m, at_m, None, at_m, 0.0, past=[])

    def fly(self, slot: int, from_m: Point, to_m: Point) -> Flown:
        """Let the pilot fly the step of `slot`, and return what the autopilot has reported of earlier slots."""
        before = self._pilot.step
        start_ns = self._start_ns(slot)
        begun = before is not None and before.there_m == from_m and before.start_ns == start_ns - self._mission.slot_ns
        self._pilot.step = Step(start_ns, before.here_m if begun and before is not None else from_m, from_m, to_m)
        self._at_m = to_m
        past = self._take_past()
        self._untold.append((slot, to_m))
        return self._flown(slot, past)

    def brake(self, slot: int, from_m: Point, to_m: Point) -> None:
        """Note a step for which the process did not run: the autopilot has long flown on."""
        del slot, from_m
        self._at_m = to_m

    def disturb(self, fault: VehicleFault) -> None:
        """Do nothing: no fault bends a real vehicle."""

    @property
    def next_measured_m(self) -> Point:
        """The waypoint, which the next reported position is near."""
        return self._at_m

    def _start_ns(self, slot: int) -> int:
        return self._epoch_ns + slot * self._mission.slot_ns

    def _take_past(self) -> list[PastFlight]:
        """Return the slots that are reported by now; those that never will be, for want of reports, are dropped."""
        seen, found = self._pilot.telemetry, []
        while self._untold and seen.newest is not None and seen.newest.at_ns >= self._start_ns(self._untold[0][0] + 1):
            slot, waypoint_m = self._untold.popleft()
            shares = [round(part / self._parts * self._mission.slot_ns) for part in range(self._parts + 1)]
            path_m = [point for share in shares if (point := seen.at(self._start_ns(slot) + share)) is not None]
            if len(path_m) == len(shares):
                found.append(PastFlight(slot, path_m, waypoint_m))
        return found

    def _flown(self, slot: int, past: list[PastFlight]) -> Flown:
        newest = self._pilot.telemetry.newest
        here_m = (newest.x_m, newest.y_m) if newest is not None else self._at_m
        strays = self._pilot.stage is Stage.STRAYING or self._pilot.is_down
        return Flown(
            here_m,
            here_m,
            None,
            here_m,
            0.0,
            past=past,
            charge_share=self._pilot.telemetry.battery_share,
            stray_m=self._stray_m(self._start_ns(slot + 1)) if strays else None,
            on_ground=strays and (self._pilot.is_down or self._has_landed(slot)),
        )

    def _stray_m(self, end_ns: int) -> float:
        """Return how far the vehicle can be at a time from where it was last reported."""
        newest = self._pilot.telemetry.newest
        age_s = (end_ns - newest.at_ns) / NS_PER_S if newest is not None else 0.0
        return self._free_mps * max(age_s, 0.0)

    def _has_landed(self, slot: int) -> bool:
        """Return True if the own failsafe of an autopilot that says nothing has landed it by now."""
        newest = self._pilot.telemetry.newest
        heard_ns = newest.at_ns if newest is not None else self._epoch_ns
        silent_slots = (self._start_ns(slot) - heard_ns) / self._mission.slot_ns
        return self._failsafe is not None and silent_slots > self._failsafe.slots
