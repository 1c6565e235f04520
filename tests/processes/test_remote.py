"""What an operator may ask of another host, and nothing else."""

from __future__ import annotations

import signal

import pytest

from processes.operator.host_requests import Restart, Send, asked_for, told
from processes.operator.remote_parts import GIVE_UP_S, Remote


@pytest.mark.parametrize(
    "deed", [Send(uav="u001", number=signal.SIGKILL), Restart(uav="u002", lose_memory=True), Restart(uav="u003")]
)
def test_deeds_are_understood(deed):
    """What was told is what is done."""
    assert asked_for(told(deed)) == deed


@pytest.mark.parametrize(
    "detail",
    ["", "kill u001", '{"type":"signal","uav":"u001","number":15}', '{"type":"restart","uav":"../x"}', "[" * 10_000],
)
def test_anything_else_is_not(detail):
    """No other signal, no other id, no crash."""
    assert asked_for(detail) is None


def test_who_is_away_is_waited_for_a_while_and_may_come_back():
    """A cut link is no death, until it has lasted."""
    remote = Remote(["u1", "u2"])
    assert remote.look({"u1"}, set(), 0.0) == ([], [])
    assert remote.look({"u1"}, set(), GIVE_UP_S - 1) == ([], [])
    assert remote.look({"u1"}, set(), GIVE_UP_S) == (["u2"], [])
    assert remote.expected == {"u1"}
    assert remote.look({"u1"}, set(), GIVE_UP_S + 1) == ([], [])
    assert remote.look({"u1", "u2"}, set(), GIVE_UP_S + 2) == ([], ["u2"])
    assert remote.expected == {"u1", "u2"}


def test_who_was_killed_is_not_waited_for():
    """As soon as it is off the bus."""
    remote = Remote(["u1", "u2"])
    assert remote.look({"u1", "u2"}, {"u2"}, 0.0) == ([], [])
    assert remote.look({"u1"}, {"u2"}, 1.0) == (["u2"], [])
