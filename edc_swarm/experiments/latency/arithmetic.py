"""Slot arithmetic: the effect of delay, jitter and loss on a slot, predicted without any mission.

A UAV sends its fix at the start of slot t; it reaches the head after delay + transit, where transit is the time of
the transport (`TRANSIT_NS` in the simulator, similar for real processes on one host). The head plans at once when
it has all fixes, at `tau_s` if it has those of a quorum then, or else when a quorum is complete. A command takes
delay + transit too, and is valid only if it arrives before slot t + 1 begins. Hence:

- If 2 (delay + transit) + plan time >= slot, no command is in time. Every UAV holds except the head, whose own fix
  and command need no network.
- If delay > tau, the head waits for a quorum only. A UAV whose fix arrives later than those of the quorum holds in
  the next slot.
- With jitter and loss the share of commands in time is random: see `in_time_share`.
- A UAV that gets no command in time for long lands: see `lands`.

All functions take a mission whose first link is the swept one, from every UAV to every UAV. Slots are in wall time,
as delays are.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from edc_swarm.emulation.links import LinkEmulator
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.failsafe import failsafe_of
from edc_swarm.mission.roster import complete_mission
from edc_swarm.simulation.network import TRANSIT_NS

TRANSIT_MS = TRANSIT_NS / 1e6
SLOTS = 400
"""Number of random slots behind a share."""
FEW_LANDINGS = 0.01
"""Expected landings of a mission for want of commands, below which all UAVs count on reaching their targets."""


def hold_delay_ms(mission: Mission) -> float:
    """Return the least delay with which all UAVs but the head must hold, in milliseconds, for a plan time of 0."""
    return mission.slot_ns / 2e6 - TRANSIT_MS


def only_holds(mission: Mission) -> bool:
    """Return True if no command can be in time, for any random draw."""
    return mission.link[0].delay_ms >= hold_delay_ms(mission)


def starves(mission: Mission, share: float, limit_slots: int) -> bool:
    """Return True if this share of commands in time is too small to fly the longest way in `limit_slots`."""
    whole = complete_mission(mission)
    return share * limit_slots < max(entry.straight_m / whole.step_m(entry) for entry in whole.roster)


def lands(mission: Mission, share: float) -> bool:
    """Return True if UAVs are expected to land for want of commands: one of a hundred missions has a landing, or more.

    Of a share p of commands in time, a UAV flies N straight steps in N / p slots. In p (1 - p)^W of them begin W slots
    without a command, after which it lands. So N (1 - p)^W landings are expected, and their sum over all UAVs counts.
    """
    whole = complete_mission(mission)
    failsafe = failsafe_of(whole)
    if failsafe is None:
        return False
    steps = math.fsum(entry.straight_m / whole.step_m(entry) for entry in whole.roster)
    return bool(steps * (1 - share) ** failsafe.wait_slots >= FEW_LANDINGS)


def in_time_share(mission: Mission) -> float:
    """Return the predicted share of UAV-slots, without those of the head, with a command in time.

    The share is a Monte Carlo estimate with the link model over `SLOTS` slots. It assumes that the UAV with the most
    energy is head throughout, that planning takes no time, and that no UAV moves. A UAV without a command sends its
    fix a second time in the slot, as in `edc_swarm.agent.node`.
    """
    whole = complete_mission(mission)
    head, *others = (entry.uav for entry in sorted(whole.roster, key=lambda entry: -entry.energy_j))
    head_links, links = LinkEmulator(whole, head), [LinkEmulator(whole, uav) for uav in others]
    slot_ms, tau_ms = whole.slot_ns / 1e6, 1e3 * whole.tau_s / whole.time_scale
    in_time, lacks = 0, np.zeros(len(others), bool)
    for _ in range(SLOTS):
        fixes_ms = np.array([_first_ms(head_links, uav) for uav in others])
        for index in np.flatnonzero(lacks):
            fixes_ms[index] = min(fixes_ms[index], tau_ms / 2 + _first_ms(head_links, others[index]))
        planned_ms = _planned_ms(fixes_ms, whole.quorum - 1, tau_ms)
        commands_ms = planned_ms + np.array([_first_ms(own, head) for own in links])
        arrived = (fixes_ms <= planned_ms) & (commands_ms < slot_ms)
        lacks = ~arrived
        in_time += int(arrived.sum())
    return in_time / (SLOTS * len(others))


def _first_ms(links: LinkEmulator, sender: str) -> float:
    """Return the arrival time of the first copy of a message, infinite if it is lost."""
    return TRANSIT_MS + min(links.arrivals_ns(sender, 0.0), default=np.inf) / 1e6


def _planned_ms(fixes_ms: NDArray[np.float64], needed: int, tau_ms: float) -> float:
    """Return the time at which the head plans: min(arrival of the last fix, max(tau, arrival of fix `needed`))."""
    ordered = np.sort(fixes_ms)
    return float(max(ordered[needed - 1], min(tau_ms, ordered[-1])))
