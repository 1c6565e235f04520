"""The rota: the few UAVs that may claim to lead, and so hear all fixes, in a slot of a swarm without a head.

If every UAV that suspects its head heard every other one, a swarm of K without a head would deliver K^2 fixes in each
slot, which keeps an overloaded swarm without a head. So `CANDIDATES` UAVs are on duty for `WINDOW_SLOTS` slots, then
the next ones. All UAVs compute the same rota from the mission.

*First* are those that the mission's criterion prefers, as far as the roster tells; the others follow in an order drawn
from the mission's seed. So faults that take neighbours in the roster take no whole window, unless by chance. If half
of the UAVs live, a window has nobody alive with a probability of about 2^-4; no UAV waits for longer than one round.
"""

from __future__ import annotations

from random import Random

from edc_swarm.mission.configuration import Mission

CANDIDATES = 4
"""Most UAVs on duty in a slot: one may be dead, one deaf, and two are left to outbid each other."""
WINDOW_SLOTS = CANDIDATES + 2
"""Slots of one duty: one to hear the fixes, two for the best candidate, then one for each of the others."""


class Rota:
    """The windows of a mission's rota, in turn; the last one begins anew with the first UAVs if it is not full."""

    def __init__(self, mission: Mission) -> None:
        roster = list(mission.roster)
        if mission.elect == "energy":
            roster.sort(key=lambda entry: -entry.energy_j)
        ids = [entry.uav for entry in roster]
        first, others = ids[:CANDIDATES], ids[CANDIDATES:]
        Random(f"{mission.seed}/rota").shuffle(others)
        order = [*first, *others]
        size = min(CANDIDATES, len(order))
        self._windows = [tuple((order + order)[i : i + size]) for i in range(0, len(order), size)]

    def on_duty(self, slot: int) -> tuple[str, ...]:
        """Return the ids of the UAVs on duty in `slot`; the first window also has the time before the mission."""
        return self._windows[max(slot, 0) // WINDOW_SLOTS % len(self._windows)]
