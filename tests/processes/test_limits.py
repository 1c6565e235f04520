"""Limits on the memory and files of a part on an open bus."""

from __future__ import annotations

import resource
import subprocess
import sys

import pytest
import zenoh

from edc_swarm.errors import InputError
from edc_swarm.mission.roles import OPERATOR
from edc_swarm.protocol.codec import MAX_MESSAGE_BYTES
from edc_swarm.protocol.keys import Keys
from processes.bus.address import free_endpoint
from processes.bus.operator_presence import OperatorPresence
from processes.bus.session import MAX_SESSIONS, hand_over, open_client, put
from processes.bus.subscriptions import Heard, heard_from
from processes.runtime.limits import FILES, FILES_PER_UAV
from tests.processes.conftest import await_true


def test_operators_are_remembered_up_to_a_limit(endpoint: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A part remembers the first few operators; there is room again when they have gone."""
    monkeypatch.setattr("processes.bus.operator_presence.MAX_OPERATORS", 3)
    with open_client(endpoint) as crowd, open_client(endpoint) as session:
        tokens = [crowd.liveliness().declare_token(Keys(f"m{number}").alive(OPERATOR, "1")) for number in range(8)]
        operators = OperatorPresence(session)
        await_true(lambda: len(operators.missions()) == 3)
        with pytest.raises(InputError, match="the router of one mission, not of m"):
            operators.only_mission(endpoint)
        for token in tokens:
            token.undeclare()
        await_true(lambda: not operators.missions())
        own = crowd.liveliness().declare_token(Keys("own").alive(OPERATOR, "1"))
        await_true(lambda: operators.only_mission(endpoint) == "own")
        assert operators.absences == 3
        assert operators.away_s("own") == 0.0
        own.undeclare()
        await_true(lambda: operators.away_s("own") > 0.0)


def test_of_a_huge_message_only_the_beginning_is_kept(endpoint: str) -> None:
    """The replacement is just too large for the codec."""
    heard: list[Heard] = []
    with open_client(endpoint) as speaker, open_client(endpoint) as session:

        def take(sample: zenoh.Sample) -> None:
            heard.append(heard_from(sample))

        session.declare_subscriber("huge", hand_over(take))

        def arrived() -> bool:
            put(speaker, "huge", bytes(2 * MAX_MESSAGE_BYTES))
            return bool(heard)

        await_true(arrived)
    assert len(heard[0].payload) == MAX_MESSAGE_BYTES + 1


@pytest.mark.parametrize(("hard", "raised"), [(20_000, FILES + FILES_PER_UAV * MAX_SESSIONS), (100, 100)])
def test_a_standalone_router_raises_its_limit_on_open_files(hard: int, raised: int) -> None:
    """It raises the soft limit to that of all its sessions; a lower hard limit bounds it."""
    if resource.getrlimit(resource.RLIMIT_NOFILE)[1] < hard:
        pytest.skip("the hard limit of this shell is lower")
    limited = ("bash", "-c", f'ulimit -Sn 64 && ulimit -Hn {hard} && exec "$@"', "limited")
    command = [*limited, sys.executable, "-m", "processes.services.router", free_endpoint()]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as router:
        assert router.stdout is not None
        listens = router.stdout.readline()
        limits = resource.prlimit(router.pid, resource.RLIMIT_NOFILE)
        router.terminate()
    assert (listens, limits, router.returncode) == (b"ready\n", (raised, hard), 0)
