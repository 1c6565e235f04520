"""Slots of one UAV's clock: their starts, late ticks, and other clocks that are ahead."""

from __future__ import annotations

from edc_swarm.mission.failsafe import LATE_FRACTION
from edc_swarm.protocol.messages import Fix, MissionMessage


class SlotClock:
    """Conversion between slots and wall nanoseconds of the own clock. It reads no clock: callers pass the time."""

    def __init__(self, mission: MissionMessage) -> None:
        self._epoch_ns = mission.epoch_ns
        self.slot_ns = mission.slot_ns
        self.tau_ns = round(mission.tau_s * 1e9 / mission.time_scale)
        self._tolerance_s = max(mission.guard_s, 1e-3)
        self._reported: set[str] = set()

    def slot_at(self, now_ns: int) -> int:
        """Return the slot at a time."""
        return (now_ns - self._epoch_ns) // self.slot_ns

    def start_ns(self, slot: int) -> int:
        """Return the start of a slot."""
        return self._epoch_ns + slot * self.slot_ns

    def is_late(self, slot: int, now_ns: int) -> bool:
        """Return True if a tick at this time is too late to fly in `slot`."""
        return now_ns - self.start_ns(slot) > LATE_FRACTION * self.slot_ns

    def offset_of(self, fix: Fix, now_ns: int) -> str:
        """Return the detail of a clock-offset event, once per UAV whose fix is from the future beyond the guard."""
        ahead_s = (fix.sent_ns - now_ns) / 1e9
        if ahead_s <= self._tolerance_s or fix.uav in self._reported:
            return ""
        self._reported.add(fix.uav)
        return f"{fix.uav} is {ahead_s * 1e3:.1f} ms ahead or more"
