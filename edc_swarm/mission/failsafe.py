"""The failsafe: when a UAV without accepted steps lands, and from when on its airspace is free.

Both follow from the slot of the UAV's last accepted step and from the mission, which never changes in flight. So the
vehicle needs no process to land, and everybody who knows that slot, or a bound on it, knows where and when it lands.
ARCHITECTURE.md, "The failsafe", has the proof.

Assumption: every clock, also the timer of a vehicle whose process is dead, is within `guard_s` of the mission's time
when its UAV accepts its last step, and its rate is within `CLOCK_RATE` of the true one after that.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from edc_swarm.mission.configuration import Mission

CLOCK_RATE = 1e-3
"""Greatest error of a clock's rate. Quartz oscillators are 10 to 50 times better."""
LATE_FRACTION = 0.2
"""A tick later than this fraction of the slot is late: the UAV holds and counts it."""
FAILOVER_SLOTS = 4
"""Slots that a fail-over, or the first election, may take beyond the lease: nobody lands before."""
ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class Failsafe:
    """The limits of a mission whose UAVs land, in slots.

    Attributes
    ----------
    wait_slots
        Slots without an accepted step after which a UAV lands.
    descent_slots
        Slots from the one in which a UAV begins to land until its airspace is free for certain: a tick that is just
        not late, the descent, the guard, and a slot for a vehicle that lags.
    """

    wait_slots: int
    descent_slots: int

    def landing_slot(self, stepped_slot: int) -> int:
        """Return the last slot in which a UAV may accept a step, -1 for none so far; without one it begins to land."""
        return stepped_slot + self.wait_slots + 1

    def free_slot(self, stepped_slot: int) -> int:
        """Return the slot from which the airspace of a UAV is free, if it accepts no step after `stepped_slot`."""
        return self.landing_slot(stepped_slot) + self.descent_slots

    @property
    def slots(self) -> int:
        """Slots from the one after a UAV's last accepted step until its airspace is free."""
        return self.wait_slots + self.descent_slots


def failsafe_of(mission: Mission) -> Failsafe | None:
    """Return the limits of a mission, None if its UAVs hold for ever."""
    if mission.failsafe == "hold":
        return None
    wait_slots = max(math.ceil(mission.land_after_s / mission.dt_s - ROUNDING), mission.lease_slots + FAILOVER_SLOTS)
    guard_s = 2 * mission.guard_s + CLOCK_RATE * (wait_slots * mission.dt_s + mission.landing_s)
    descent_slots = math.ceil(LATE_FRACTION + (mission.landing_s + guard_s) / mission.dt_s) + mission.lag_slots
    return Failsafe(wait_slots, descent_slots)
