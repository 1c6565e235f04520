"""Codec of messages: JSON bytes, with a decoder that rejects every malformed message."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, get_args

import msgspec
from msgspec import Struct

from edc_swarm.errors import MessageError, MissionError
from edc_swarm.mission.faults import parse_faults
from edc_swarm.mission.validation import check_links, validate_mission
from edc_swarm.protocol.keys import KEY_FORMS, PREFIX, kind_of, names_of
from edc_swarm.protocol.messages import Message, MissionMessage, Report

MAX_MESSAGE_BYTES = 1 << 20
MAX_MISSION_BYTES = 5 << 20
"""Largest mission message: its roster has every UAV."""
MISPLACED = "sender or receiver is not the one in the key"
"""Reason why a message on the key of another is rejected."""
_DECODERS: dict[type[Struct], msgspec.json.Decoder[Any]] = {
    kind: msgspec.json.Decoder(kind) for kind in get_args(Message)
}
_ENCODER = msgspec.json.Encoder()
REMEMBERED_KEYS = 16_384
"""Keys that a receiver has taken apart before: all of the largest mission's UAVs, with a command to each."""


def encode(message: Message) -> bytes:
    """Return the bytes of a message (JSON, shortest round-trip floats)."""
    return _ENCODER.encode(message)


def decode(key: str, payload: bytes) -> Message:
    """Return the message in `payload`, checked against the type, the limits and the sender in its key.

    Raises
    ------
    MessageError
        The key is unknown, the payload is too large or malformed, a number is beyond its (finite) limits, a
        sender or receiver differs from the one in the key, or no mission file could describe the mission.
    """
    form = _form_of(key)
    if form is None:
        raise MessageError(key, "no message is defined for this key")
    if len(payload) > form.most_bytes:
        raise MessageError(key, f"{len(payload)} bytes, more than {form.most_bytes}")
    try:
        message: Message = form.decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise MessageError(key, str(error)) from None
    if isinstance(message, Report) and not message.has_ids:
        raise MessageError(key, "a text that is no id of a UAV")
    if form.names is not None and form.names_in(message) != form.names:
        raise MessageError(key, MISPLACED)
    if isinstance(message, MissionMessage):
        if form.mission not in {None, message.name}:
            raise MessageError(key, "another mission's")
        _check_mission(key, message)
    return message


def limit_bytes(key: str) -> int:
    """Return the size of the largest message on a key."""
    return MAX_MISSION_BYTES if kind_of(key) is MissionMessage else MAX_MESSAGE_BYTES


@dataclass(frozen=True, slots=True)
class _Form:
    """What a key says of the messages on it; `names` and `mission` are None on a key without the prefix."""

    decode: Callable[[bytes], Any]
    names_in: Callable[[Any], tuple[str, ...]]
    names: tuple[str, ...] | None
    mission: str | None
    most_bytes: int


@lru_cache(maxsize=REMEMBERED_KEYS)
def _form_of(key: str) -> _Form | None:
    """Return what a key says, None if no message is defined for it. A mission has few keys, and each comes often."""
    kind = kind_of(key)
    if kind is None:
        return None
    parts = key.split("/")
    known = parts[0] == PREFIX
    mission = parts[1] if known else None
    names = names_of(kind, parts[2:]) if known else None
    return _Form(_DECODERS[kind].decode, KEY_FORMS[kind].names, names, mission, limit_bytes(key))


def _check_mission(key: str, mission: MissionMessage) -> None:
    """Raise `MessageError` for a mission that would be rejected as a file, or that lacks a field to fly."""
    try:
        validate_mission(mission)
        check_links(mission)
        parse_faults(mission)
    except MissionError as error:
        raise MessageError(key, str(error)) from None
    if not (mission.roster and mission.max_slots and mission.tau_s):
        raise MessageError(key, "a mission without roster, max_slots or tau_s")
    if not all(entry.r_m and entry.body_m and entry.energy_j for entry in mission.roster):
        raise MessageError(key, "a UAV without r_m, body_m or energy_j")
    if len(mission.claimants) not in {0, len(mission.roster)}:
        raise MessageError(key, "claimants must be none, or one for every UAV of the roster")
