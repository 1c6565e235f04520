"""The number of UAVs that this machine carries, from a short measurement before take-off.

The measurement times the Python work of one UAV in a slot: begin, encode, decode a command and a report of a swarm of
the same size. `WHOLE` stands for the ratio of all the processor time of a run per UAV and slot (router, recorder, head,
Zenoh, wake-ups) to that work. It is an estimate, and the measurement does not see what else the machine does; so the
number tells a swarm that fits from one that does not only roughly. On the two cores for which it was chosen, 200 UAVs
have flown at a slot of 0.5 s and 250 have not.
"""

from __future__ import annotations

import math
import os
import time

from edc_swarm.agent.node import Publish, Received, Tick, UavNode
from edc_swarm.agent.vehicle import first_airframe, first_promise
from edc_swarm.errors import InputError
from edc_swarm.mission.configuration import NS_PER_S, Mission
from edc_swarm.protocol.codec import decode, encode
from edc_swarm.protocol.keys import Keys
from edc_swarm.protocol.messages import Command, MissionMessage, Report, mission_message

WHOLE = 11.0
"""Processor time of a run per UAV and slot, over the measured work of a UAV."""
LOAD = 0.7
"""Share of the processors that a swarm may use on average: a slot's work comes in bursts."""
BATCHES = 5
BATCH_SLOTS = 20
CHECKED_UAVS = 100
"""Smallest swarm that is checked: any machine of two cores carries fewer UAVs at the default slot."""


def check_capacity(mission: Mission) -> None:
    """Raise `InputError` if this machine is too slow for the mission.

    Only missions of at least `CHECKED_UAVS` UAVs are measured, which takes a tenth of a second.
    """
    uavs, slot_s = len(mission.roster), mission.dt_s / mission.time_scale
    if uavs < CHECKED_UAVS:
        return
    carried = carried_uavs(slot_s, uav_slot_s(mission))
    if uavs > carried:
        enough_s = stretched_slot_s(mission) / mission.time_scale
        raise InputError(
            "--uavs",
            uavs,
            f"at most about {carried}: this machine carries no more at {slot_s:g} s a slot; "
            f"use --slot {enough_s * mission.time_scale:g}, --overload stretch, or --overload fly",
        )


def stretched_slot_s(mission: Mission) -> float:
    """Return the shortest slot, in tenths of a second of the mission, in which this machine carries all UAVs."""
    needed_s = len(mission.roster) * uav_slot_s(mission) / (LOAD * _cores())
    return max(mission.dt_s, math.ceil(10 * needed_s * mission.time_scale) / 10)


def carried_uavs(slot_s: float, uav_s: float) -> int:
    """Return how many UAVs fit into slots of `slot_s`, if each takes `uav_s` of processor time in a slot."""
    return int(LOAD * _cores() * slot_s / uav_s)


def uav_slot_s(mission: Mission) -> float:
    """Return the processor time that a run of this mission takes per UAV and slot: measured, in seconds.

    The least of `BATCHES` counts, since everything that disturbs the measurement lengthens it.
    """
    message = mission_message(mission)
    entry = message.roster[-1]
    node = UavNode(message, entry.uav, "capacity", first_promise(entry), first_airframe(entry))
    took_s = []
    for batch in range(BATCHES):
        start_s = time.thread_time()
        for slot in range(batch * BATCH_SLOTS, (batch + 1) * BATCH_SLOTS):
            _fly(node, message, slot)
        took_s.append((time.thread_time() - start_s) / BATCH_SLOTS)
    return WHOLE * min(took_s)


def _fly(node: UavNode, mission: MissionMessage, slot: int) -> None:
    """Give a UAV one slot: its beginning, a command to hold, and the head's report."""
    keys, entry, ids = Keys(mission.name), mission.roster[-1], [entry.uav for entry in mission.roster]
    now_ns = mission.epoch_ns + slot * mission.slot_ns
    head, start_m = ids[0], (entry.start_x_m, entry.start_y_m)
    for effect in node.step(Tick(), now_ns):
        if isinstance(effect, Publish):
            encode(effect.message)
    command = Command(
        head=head,
        uav=entry.uav,
        slot=slot + 1,
        term=1,
        start_x_m=start_m[0],
        start_y_m=start_m[1],
        target_x_m=start_m[0],
        target_y_m=start_m[1],
    )
    report = Report(head=head, slot=slot, term=1, status="no-qp-needed", grants=ids, heard=ids, quorum=mission.quorum)
    for message in (command, report):
        node.step(Received(decode(keys.of(message), encode(message))), now_ns + NS_PER_S // 10)


def _cores() -> int:
    return len(os.sched_getaffinity(0))
