"""Slot arithmetic: what a delay leaves of a slot, before anything is flown.

A fix leaves at the start of slot t and is with the head `delay` later, and what the transport takes
(`TRANSIT_NS` in the simulator, about as much in real processes on one host). The head plans when all fixes
are in, at `tau_s` when a quorum is, or as soon as one is. A command takes as long to its UAV, and counts only
when it arrives before slot t + 1 begins. Hence

- 2 (delay + transit) + plan time >= slot: no command is ever in time. All hold, but for the head, whose own
  fix and command need no network;
- delay > tau: the head does not wait for more than its quorum, so UAVs whose fix is later than the
  quorum's hold in the next slot although their fix is heard in the same slot;
- jitter and loss make it a matter of chance: `in_time_share`.

All functions take a mission whose first link is the one that is swept, from everyone to everyone. A slot
is as long as it is on the wall, where delays are.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from edc_swarm.emulation.links import LinkEmulator
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import complete_mission
from edc_swarm.simulation.network import TRANSIT_NS

TRANSIT_MS = TRANSIT_NS / 1e6
SLOTS = 400
"""Slots that are drawn for a share."""


def hold_delay_ms(mission: Mission) -> float:
    """Least delay with which the swarm can only hold, in milliseconds, however quickly it plans."""
    return mission.slot_ns / 2e6 - TRANSIT_MS


def only_holds(mission: Mission) -> bool:
    """Whether no command can be in time, however lucky."""
    return mission.link[0].delay_ms >= hold_delay_ms(mission)


def starves(mission: Mission, share: float, limit_slots: int) -> bool:
    """Whether, with this share of commands in time, the longest way is too long for `limit_slots`."""
    longest_m = max(entry.straight_m for entry in complete_mission(mission).roster)
    return share * limit_slots < longest_m / mission.u_max_m


def in_time_share(mission: Mission) -> float:
    """Share of the UAV-slots, the head's not counted, that have a command in time, as far as the link decides.

    Drawn from the link model itself, over `SLOTS` slots in which the UAV with most energy leads undisturbed, plans
    in no time, and all stay where they start. Who has no command says its fix once more, as in `edc_swarm.agent.node`.
    """
    whole = complete_mission(mission)
    head, *others = (entry.uav for entry in sorted(whole.roster, key=lambda entry: -entry.energy_j))
    ears, links = LinkEmulator(whole, head), [LinkEmulator(whole, uav) for uav in others]
    slot_ms, tau_ms = whole.slot_ns / 1e6, 1e3 * whole.tau_s / whole.time_scale
    in_time, lacks = 0, np.zeros(len(others), bool)
    for _ in range(SLOTS):
        fixes_ms = np.array([_first_ms(ears, uav) for uav in others])
        for index in np.flatnonzero(lacks):
            fixes_ms[index] = min(fixes_ms[index], tau_ms / 2 + _first_ms(ears, others[index]))
        planned_ms = _planned_ms(fixes_ms, whole.quorum - 1, tau_ms)
        commands_ms = planned_ms + np.array([_first_ms(own, head) for own in links])
        arrived = (fixes_ms <= planned_ms) & (commands_ms < slot_ms)
        lacks = ~arrived
        in_time += int(arrived.sum())
    return in_time / (SLOTS * len(others))


def _first_ms(links: LinkEmulator, sender: str) -> float:
    """When the first copy of a message arrives, infinite when it is lost."""
    return TRANSIT_MS + min(links.arrivals_ns(sender, 0.0), default=np.inf) / 1e6


def _planned_ms(fixes_ms: NDArray[np.float64], needed: int, tau_ms: float) -> float:
    """When the head plans: not before `needed` others are heard, at once when all are, else at tau."""
    ordered = np.sort(fixes_ms)
    return float(max(ordered[needed - 1], min(tau_ms, ordered[-1])))
