"""The check of all autopilots of this host before a run starts any process; one line for each autopilot."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Collection
from contextlib import ExitStack

from edc_swarm.autopilot.pilot import Pilot
from edc_swarm.errors import InputError, SwarmError
from edc_swarm.foreign_text import listed
from edc_swarm.mission.autopilots import autopilots
from edc_swarm.mission.configuration import Mission
from processes.runtime.console import note
from processes.uav.autopilot_link import AutopilotLink, check_package

READY_S = 10.0
"""Longest wait until every autopilot has said all that is checked."""
SETTLED_S = 1.2
"""Time for which no autopilot may raise an objection: a second one at an address sends a heartbeat in it."""
LISTEN_S = 0.1
"""Time between two looks at what the autopilots have said."""


def check_ready(mission: Mission, local: Collection[str], *, arm: bool) -> None:
    """Check the autopilots of the UAVs of this host; nothing is armed meanwhile.

    Raises
    ------
    SwarmError
        One of them is not ready, or the user has not given the permission to arm; or there is nothing to arm.
    """
    addresses = {uav: address for uav, address in autopilots(mission).items() if uav in local}
    if arm and not autopilots(mission):
        raise InputError("--arm", arm, "absent in a mission that no autopilot flies")
    if not addresses:
        return
    with ExitStack() as stack:
        flown = {}
        for entry in mission.roster:
            if entry.uav in addresses:
                check_package(addresses[entry.uav])
                pilot = Pilot(mission, entry, 1 << 62, arm=False)
                link = AutopilotLink(addresses[entry.uav], pilot, time.monotonic_ns)
                stack.callback(link.close)
                flown[entry.uav] = pilot, link
        _await({uav: pilot for uav, (pilot, _) in flown.items()})
        found = {uav: _objections(pilot, link) for uav, (pilot, link) in flown.items()}
        for uav, other in _twins({uav: pilot for uav, (pilot, _) in flown.items()}).items():
            found[uav].append(f"it has the system number of the autopilot of {other}: give each its own")
        names = {uav: _described(pilot) for uav, (pilot, _) in flown.items()}
        wrong = {uav: pilot.failsafe[1] for uav, (pilot, _) in flown.items() if not found[uav]}
    _report(addresses, names, found, wrong, arm=arm)


def _await(pilots: dict[str, Pilot]) -> None:
    """Wait until no autopilot has an objection for a while, or for `READY_S`."""
    end_s = time.monotonic() + READY_S
    since_s = None
    while (now_s := time.monotonic()) < end_s:
        now_ns = time.monotonic_ns()
        if any(pilot.objections(now_ns) or not pilot.knows_failsafe(now_ns) for pilot in pilots.values()):
            since_s = None
        elif since_s is None:
            since_s = now_s
        elif now_s - since_s >= SETTLED_S:
            return
        time.sleep(LISTEN_S)


def _objections(pilot: Pilot, link: AutopilotLink) -> list[str]:
    if pilot.telemetry.system is None:
        if link.heard["unknown"]:
            return [f"no heartbeat within {READY_S:g} s, but {link.heard['unknown']} messages of another dialect"]
        if link.heard["bad"]:
            return [f"no heartbeat within {READY_S:g} s: what comes is no MAVLink ({link.heard['bad']} pieces)"]
        if link.heard["messages"]:
            return [f"no heartbeat of an autopilot within {READY_S:g} s, among {link.heard['messages']} messages"]
        return [f"no autopilot: nothing came within {READY_S:g} s"]
    return pilot.objections(time.monotonic_ns())


def _twins(pilots: dict[str, Pilot]) -> dict[str, str]:
    """Return the UAVs whose autopilot has the system number of another one, with that one."""
    by_system: dict[int, list[str]] = defaultdict(list)
    for uav, pilot in pilots.items():
        if pilot.telemetry.system is not None:
            by_system[pilot.telemetry.system[0]].append(uav)
    return {uav: uavs[0] for uavs in by_system.values() for uav in uavs[1:]}


def _described(pilot: Pilot) -> str:
    """Return an autopilot and its failsafe in words."""
    return "; ".join(filter(None, [pilot.telemetry.name, pilot.failsafe[0]]))


def _report(
    addresses: dict[str, str],
    names: dict[str, str],
    found: dict[str, list[str]],
    wrong: dict[str, list[str]],
    *,
    arm: bool,
) -> None:
    for uav, address in addresses.items():
        note(f"{uav} at {address}: {'; '.join(found[uav]) or f'ready, {names[uav]}'}")
    for text in dict.fromkeys(text for texts in wrong.values() for text in texts):
        note(f"warning: {listed([uav for uav, texts in wrong.items() if text in texts])}: {text}")
    unready = [uav for uav, objections in found.items() if objections]
    if unready:
        raise SwarmError(f"nothing was armed: {len(unready)} of {len(addresses)} autopilots are not ready")
    if not arm:
        raise SwarmError("nothing was armed: --arm on the command line arms the vehicles")
