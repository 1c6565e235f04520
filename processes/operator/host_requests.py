"""Requests of the operator to the hosts that fly UAVs for it: the deaths, freezes and restarts of faults.

They are the `detail` of the operator's events of kind `host-request`, so the recording holds them.
"""

from __future__ import annotations

import signal
from typing import Annotated

import msgspec
from msgspec import Meta, Struct

from edc_swarm.mission.field_types import UavId

SIGNALS = frozenset({signal.SIGKILL, signal.SIGSTOP, signal.SIGCONT})


class SendSignal(Struct, frozen=True, kw_only=True, tag="signal"):
    """Send a signal to the process of a UAV."""

    uav: UavId
    number: Annotated[int, Meta(ge=1, le=64)]


class RestartProcess(Struct, frozen=True, kw_only=True, tag="restart"):
    """Kill the process of a UAV if it lives, and start it again."""

    uav: UavId
    lose_memory: bool = False


HostRequest = SendSignal | RestartProcess


def encode_request(request: HostRequest) -> str:
    """Return a request as the detail of an event."""
    return msgspec.json.encode(request).decode()


def decode_request(detail: str) -> HostRequest | None:
    """Return the request that the detail of an event tells; None for anything else."""
    try:
        request: HostRequest = msgspec.json.decode(detail, type=HostRequest)
    except msgspec.DecodeError:
        return None
    return None if isinstance(request, SendSignal) and request.number not in SIGNALS else request
