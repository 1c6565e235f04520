"""Slot arithmetic: what a delay leaves of a slot, before anything is flown.

A fix leaves at the start of slot t and is with the head `delay` later; the head plans when all fixes are
in, at `tau_s` when a quorum is, or as soon as one is; a command takes `delay` to its UAV and counts only
when it arrives before slot t + 1 begins. Hence

- 2 delay + plan time >= slot: no command is ever in time. All hold, but for the head, whose own fix and
  command need no network;
- delay > tau: the head does not wait for more than its quorum, so UAVs whose fix is later than the
  quorum's hold in the next slot although their fix was heard in the same slot;
- jitter and loss make it a matter of chance: `in_time_share`.
"""

from __future__ import annotations

import numpy as np

from edc_swarm.config import Link, Mission, default_tau_s
from edc_swarm.links import LinkEmulator

SLOTS = 400
"""Slots that are drawn for a share."""


def only_holds(delay_ms: float, slot_s: float, plan_ms: float = 0.0) -> bool:
    """Whether no command can be in time, however lucky."""
    return 2 * delay_ms + plan_ms >= 1e3 * slot_s


def hold_delay_ms(slot_s: float, plan_ms: float = 0.0) -> float:
    """Least delay with which the swarm can only hold."""
    return (1e3 * slot_s - plan_ms) / 2


def in_time_share(link: Link, uavs: int, slot_s: float, plan_ms: float = 0.0) -> float:
    """Share of the UAV-slots, the head's not counted, that have a command in time, as far as the link decides.

    Drawn from the link model itself, over `SLOTS` slots in which one head leads undisturbed.
    """
    mission = Mission(uavs=uavs, dt_s=slot_s, link=[link])
    head = LinkEmulator(mission, "head")
    others = [f"u{index}" for index in range(uavs - 1)]
    links = [LinkEmulator(mission, uav) for uav in others]
    tau_ms, quorum = 1e3 * default_tau_s(mission), uavs // 2 + 1
    in_time = 0
    for _ in range(SLOTS):
        fixes_ms = np.array([_first_ms(head, uav) for uav in others])
        planned_ms = _planned_ms(fixes_ms, quorum - 1, tau_ms) + plan_ms
        commands_ms = np.array([_first_ms(own, "head") for own in links]) + planned_ms
        in_time += int(np.sum((fixes_ms <= planned_ms - plan_ms) & (commands_ms < 1e3 * slot_s)))
    return in_time / (SLOTS * len(others))


def _first_ms(links: LinkEmulator, sender: str) -> float:
    """When the first copy of a message arrives, infinite when it is lost."""
    return min(links.arrivals_ns(sender, 0.0), default=np.inf) / 1e6


def _planned_ms(fixes_ms: np.ndarray, needed: int, tau_ms: float) -> float:
    """When the head plans: not before its quorum, at once when all are in, else at tau."""
    ordered = np.sort(fixes_ms)
    quorum_ms = float(ordered[needed - 1]) if needed else 0.0
    return max(quorum_ms, min(tau_ms, float(ordered[-1])))
