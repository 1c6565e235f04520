"""What the operator asks of the hosts that fly UAVs for it: deaths, freezes and restarts that faults call for.

They are the `detail` of the operator's events of kind `deed`, so they are in the record as well.
"""

from __future__ import annotations

import signal
from typing import Annotated

import msgspec
from msgspec import Meta, Struct

from edc_swarm.mission.configuration import UavId

SIGNALS = frozenset({signal.SIGKILL, signal.SIGSTOP, signal.SIGCONT})


class Send(Struct, frozen=True, kw_only=True, tag="signal"):
    """Send a signal to the process of a UAV."""

    uav: UavId
    number: Annotated[int, Meta(ge=1, le=64)]


class Restart(Struct, frozen=True, kw_only=True, tag="restart"):
    """Kill the process of a UAV if it lives, and start it again."""

    uav: UavId
    lose_memory: bool = False


Deed = Send | Restart


def told(deed: Deed) -> str:
    """A deed as the detail of an event."""
    return msgspec.json.encode(deed).decode()


def asked_for(detail: str) -> Deed | None:
    """The deed that is asked for; None for anything else."""
    try:
        deed: Deed = msgspec.json.decode(detail, type=Deed)
    except msgspec.DecodeError:
        return None
    return None if isinstance(deed, Send) and deed.number not in SIGNALS else deed
