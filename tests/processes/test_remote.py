"""Requests of the operator to other hosts, and its view of the parts that they run."""

from __future__ import annotations

import signal

import pytest

from processes.operator.host_requests import HostRequest, RestartProcess, SendSignal, decode_request, encode_request
from processes.operator.remote_parts import PART_LOST_S, Remote

REQUESTS = [
    SendSignal(uav="u001", number=signal.SIGKILL),
    RestartProcess(uav="u002", lose_memory=True),
    RestartProcess(uav="u003"),
]


@pytest.mark.parametrize("sent", REQUESTS)
def test_a_host_reads_the_request_that_the_operator_wrote(sent: HostRequest) -> None:
    """The detail of the event is the request."""
    assert decode_request(encode_request(sent)) == sent


@pytest.mark.parametrize(
    "detail",
    ["", "kill u001", '{"type":"signal","uav":"u001","number":15}', '{"type":"restart","uav":"../x"}', "[" * 10_000],
)
def test_anything_else_is_not(detail: str) -> None:
    """No other signal, no other id, no crash."""
    assert decode_request(detail) is None


def test_who_is_away_is_waited_for_a_while_and_may_come_back() -> None:
    """A cut link is no death, until it has lasted."""
    remote = Remote(["u1", "u2"])
    assert remote.is_settled({"u1", "u2"})
    assert not remote.is_settled({"u1"}), "before the next look too: a mission must not end in between"
    assert remote.look({"u1"}, set(), 0.0) == ([], [])
    assert remote.look({"u1"}, set(), PART_LOST_S - 1) == ([], [])
    assert not remote.is_settled({"u1"})
    assert remote.look({"u1"}, set(), PART_LOST_S) == (["u2"], [])
    assert remote.is_settled({"u1"})
    assert remote.expected == {"u1"}
    assert remote.look({"u1"}, set(), PART_LOST_S + 1) == ([], [])
    assert remote.look({"u1", "u2"}, set(), PART_LOST_S + 2) == ([], ["u2"])
    assert remote.expected == {"u1", "u2"}


def test_who_leaves_the_bus_is_told_once_each_time() -> None:
    """At the first look without it, and again after it was back."""
    remote = Remote(["u1", "u2"])
    told = []
    for now_s, alive in enumerate([{"u1", "u2"}, {"u1"}, {"u1"}, {"u1", "u2"}, {"u1"}]):
        told.append(remote.left(alive))
        remote.look(alive, set(), float(now_s))
    assert told == [[], ["u2"], [], [], ["u2"]]


def test_who_was_killed_is_not_waited_for() -> None:
    """As soon as it is off the bus."""
    remote = Remote(["u1", "u2"])
    assert remote.look({"u1", "u2"}, {"u2"}, 0.0) == ([], [])
    assert remote.look({"u1"}, {"u2"}, 1.0) == (["u2"], [])
