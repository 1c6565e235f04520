"""Property: what is encoded is decoded again, and nothing else ever gets in."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edc_swarm.errors import MessageError
from edc_swarm.mission.field_types import MOST, MOST_M
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.protocol.codec import MAX_MESSAGE_BYTES, decode, encode
from edc_swarm.protocol.keys import Keys, kind_of
from edc_swarm.protocol.messages import Command, Event, Fix, Message, MissionMessage, Report, Truth

KEYS = Keys("m1")
ids = st.from_regex(r"\A[A-Za-z0-9_-]{1,32}\Z")
metres = st.floats(-MOST_M, MOST_M)
amounts = st.floats(0, MOST)
slots = st.integers(-1, (1 << 40) - 1)
terms = st.integers(0, (1 << 40) - 1)
stamps: dict[str, Any] = {
    "instance": st.text(st.characters(exclude_categories=["Cs"]), max_size=64),
    "seq": st.integers(0, (1 << 53) - 1),
    "sent_ns": st.integers(0, (1 << 63) - 1),
}
heads = st.one_of(st.just(""), ids)


def _floats(*names: str) -> dict[str, Any]:
    return dict.fromkeys(names, metres)


fixes = st.builds(
    Fix, uav=ids, slot=slots, term=terms, head=heads, suspects=st.booleans(), voter=st.booleans(),
    arrived=st.booleans(), executing=st.booleans(), command_seq=st.integers(-1, 1 << 40), **stamps,
    r_m=st.floats(1e-9, MOST), **_floats("x_m", "y_m", "waypoint_x_m", "waypoint_y_m", "from_x_m", "from_y_m"),
    energy_j=amounts, response_ms=amounts,
)  # fmt: skip
truths = st.builds(Truth, uav=ids, slot=slots, **stamps, **_floats("from_x_m", "from_y_m", "to_x_m", "to_y_m"))
commands = st.builds(
    Command, head=ids, uav=ids, slot=slots, term=terms, **stamps,
    **_floats("start_x_m", "start_y_m", "target_x_m", "target_y_m", "vx_mps", "heading_rad"),
)  # fmt: skip
reports = st.builds(
    Report, head=ids, slot=slots, term=terms, quorum=st.integers(0, 2000), next_term=terms, successor=heads,
    status=st.sampled_from(["planned", "no-qp-needed", "failed", "no-quorum", "claim"]), heard=st.lists(ids),
    hull_uav=st.lists(ids), hull_ax_m=st.lists(metres), hull_r_m=st.lists(amounts), min_gap_m=metres, **stamps,
)  # fmt: skip
events = st.builds(
    Event, source=ids, slot=slots, kind=st.text(st.characters(exclude_categories=["Cs"]), max_size=64), **stamps
)
lots = st.floats(1e-9, 1e9)


def _entry(place: int, uav: str, r_m: float, energy_j: float, compute_factor: float) -> RosterEntry:
    """A UAV that is in nobody's way."""
    x_m = 1e3 * place
    return RosterEntry(
        uav=uav, start_x_m=x_m, start_y_m=0.1, target_x_m=-x_m, target_y_m=0.3, r_m=r_m, body_m=r_m / 3,
        energy_j=energy_j, compute_factor=compute_factor,
    )  # fmt: skip


rosters = st.lists(st.tuples(ids, st.floats(1e-9, 400), lots, lots), min_size=1, unique_by=lambda drawn: drawn[0]).map(
    lambda drawn: [_entry(place, *fields) for place, fields in enumerate(drawn)]
)


def _missions(roster: list[RosterEntry]) -> st.SearchStrategy[MissionMessage]:
    tau_s, max_slots = st.floats(0.01, 0.4), st.integers(1, 1_000_000)
    fixed = {"name": st.just("m1"), "roster": st.just(roster), "uavs": st.just(len(roster))}
    return st.builds(MissionMessage, epoch_ns=stamps["sent_ns"], tau_s=tau_s, max_slots=max_slots, **fixed)


missions = rosters.flatmap(_missions)
messages = st.one_of(fixes, truths, commands, reports, events, missions)


@given(messages)
def test_round_trip(message: Message) -> None:
    """Every message comes back equal, floats to the last bit, on its own key."""
    key = KEYS.of(message)
    assert kind_of(key) is type(message)
    assert decode(key, encode(message)) == message
    assert decode(key.removeprefix("swarm/m1/"), encode(message)) == message


@given(messages, st.dictionaries(st.text("abc", min_size=4), st.integers()))
def test_unknown_fields_are_ignored(message: Message, extra: dict[str, int]) -> None:
    """Recordings of newer code can be read."""
    raw = {**extra, **msgspec.to_builtins(message)}
    assert decode(KEYS.of(message), msgspec.json.encode(raw)) == message


@given(st.one_of(st.binary(), st.text().map(str.encode)), messages)
def test_garbage(payload: bytes, message: Message) -> None:
    """Any bytes on any key give a message or `MessageError`, nothing else."""
    try:
        decode(KEYS.of(message), payload)
    except MessageError:
        return


@given(messages, st.data())
def test_damaged_messages(message: Message, data: st.DataObject) -> None:
    """A message cut short, or with bytes changed, is refused or read, and never anything else."""
    payload = bytearray(encode(message))
    for _ in range(data.draw(st.integers(0, 4))):
        payload[data.draw(st.integers(0, len(payload) - 1))] = data.draw(st.integers(0, 255))
    cut = data.draw(st.integers(0, len(payload)))
    try:
        decode(KEYS.of(message), bytes(payload[:cut]))
    except MessageError:
        return


@given(st.text())
def test_any_key(key: str) -> None:
    """A key that means nothing is refused."""
    if kind_of(key) is None:
        with pytest.raises(MessageError, match="no message is defined"):
            decode(key, b"{}")


@given(st.one_of(fixes, commands, truths, events), ids)
def test_the_sender_is_the_one_in_the_key(message: Fix | Command | Truth | Event, other: str) -> None:
    """Nobody speaks for another: access control by key then covers the contents too."""
    who = message.source if isinstance(message, Event) else message.uav
    parts = KEYS.of(message).split("/")
    parts[parts.index(who, 3)] = other
    if "/".join(parts) == KEYS.of(message):
        return
    with pytest.raises(MessageError, match="is not the one in the key"):
        decode("/".join(parts), encode(message))


def test_size_limit() -> None:
    """A message of a megabyte is read, one byte more is not even looked at."""
    event = Event(source="a", kind="k")
    payload = encode(event)
    padded = payload + b" " * (MAX_MESSAGE_BYTES - len(payload))
    assert decode(KEYS.of(event), padded) == event
    with pytest.raises(MessageError, match="more than"):
        decode(KEYS.of(event), padded + b" ")
