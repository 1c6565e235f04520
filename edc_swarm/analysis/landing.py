"""The landings of UAVs, derived from a recording: no process need live to tell of one.

A UAV lands a fixed time after its last accepted step (`edc_swarm.mission.failsafe`), which its promise says before it
flies. So the last step in the record tells where and when. A UAV that died may have accepted one step more than it
told of, if a head sent it a command for the slot after its newest fix; the landing is derived from that slot then.
"""

from __future__ import annotations

from msgspec import Struct

from edc_swarm.analysis.autopilots import strays_of
from edc_swarm.analysis.tracks import Tracks, stepped_slots
from edc_swarm.mission.failsafe import failsafe_of
from edc_swarm.protocol.events import EventKind
from edc_swarm.recording.model import Recording


class Landing(Struct, frozen=True):
    """A UAV that the failsafe has made land.

    Attributes
    ----------
    stepped_slot
        Slot of the last step that it accepted, or may have accepted; -1 for none.
    slot
        Slot in which it begins to land.
    free_slot
        Slot from which its airspace is free.
    x_m, y_m
        Centre of its disc, where it lands.
    told
        True if the UAV itself said so; False if the landing is derived from its promise and the last evidence alone.
    """

    uav: str
    stepped_slot: int
    slot: int
    free_slot: int
    x_m: float
    y_m: float
    told: bool

    def __str__(self) -> str:
        """Return one line with the UAV, the slots and the evidence."""
        how = "as it said" if self.told else f"derived from its promise: no step after slot {self.stepped_slot}"
        return f"{self.uav}: landed from slot {self.slot}, airspace free from slot {self.free_slot} ({how})"


def landings(recording: Recording, tracks: Tracks) -> list[Landing]:
    """Return the UAVs, in roster order, that have begun to land by the last slot of the record."""
    failsafe = failsafe_of(recording.mission)
    if failsafe is None:
        return []
    strays = strays_of(recording)
    told = {event.source: event.slot for event in recording.events if event.kind == EventKind.LANDED}
    found = []
    for k, stepped in enumerate(stepped_slots(recording, tracks.executed, tracks.heard).tolist()):
        slot = failsafe.landing_slot(stepped)
        uav = tracks.uavs[k]
        if slot < tracks.slots and not tracks.lost[stepped + 1 :, k].any() and uav not in strays:
            x_m, y_m = tracks.centre_m[-1, k].tolist()
            begun = min(slot, told.get(uav, slot))
            found.append(Landing(uav, stepped, begun, failsafe.free_slot(stepped), x_m, y_m, uav in told))
    return found
