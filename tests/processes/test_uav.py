"""One UAV process that no fork source has forked: its imports, and its handling of malformed bytes."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TypeVar

import msgspec
import pytest
import zenoh

from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import complete_mission
from edc_swarm.protocol import retransmission
from edc_swarm.protocol.codec import decode, encode
from edc_swarm.protocol.keys import Keys
from edc_swarm.protocol.messages import Event, Fix, Report, mission_message
from edc_swarm.protocol.retransmission import Answer, Ask, Span
from processes.bus.session import hand_over, open_client
from processes.bus.subscriptions import MAX_QUERIES
from processes.runtime.clock import MissionClock
from processes.runtime.inbox import Inbox
from processes.uav.state import create_state
from tests.processes.conftest import await_true

Said = TypeVar("Said", Fix, Event)


class Bench:
    """A mission, by default of three, of which only the last UAV flies; the test plays the others and the operator.

    `module` is the UAV's, and `slot_s` the length of a slot in real time.
    """

    def __init__(
        self, endpoint: str, folder: Path, uavs: int = 3, module: str = "processes.uav.process", slot_s: float = 0.25
    ) -> None:
        # On a busy machine the UAV hears of no head for long, and shall not land for that.
        settings = Mission(name="bench", uavs=uavs, standbys=0, time_scale=2, dt_s=2 * slot_s, failsafe="hold")
        mission = complete_mission(settings)
        self.ranked = [entry.uav for entry in sorted(mission.roster, key=lambda entry: -entry.energy_j)]
        self.first, self.second, self.last = self.ranked[0], self.ranked[1], self.ranked[-1]
        self.mission = mission_message(mission, MissionClock().now_ns())
        self.keys = Keys(self.mission.name)
        self.inbox: Inbox[tuple[str, bytes]] = Inbox()
        self.heard: list[Fix | Event] = []
        for entry in mission.roster:
            create_state(folder, entry)
        self.session = open_client(endpoint)
        self._listen(self.keys.fix("*"))
        self._listen(self.keys.event("*"))
        token = hand_over(self._take_token)
        self._token = self.session.liveliness().declare_subscriber(self.keys.all_alive, token)
        arguments = ["--endpoint", endpoint, "--mission", "bench", "--uav", self.last, "--state", str(folder)]
        self.process = subprocess.Popen([sys.executable, "-m", module, *arguments], stderr=subprocess.PIPE)

    def _listen(self, key: str) -> None:
        self.session.declare_subscriber(key, hand_over(self._take))

    def _take(self, sample: zenoh.Sample) -> None:
        self.inbox.put((str(sample.key_expr), sample.payload.to_bytes()))

    def _take_token(self, sample: zenoh.Sample) -> None:
        self.inbox.put((str(sample.key_expr), b""))

    def say(self, *messages: Event | Report | Fix) -> None:
        """Publish a message in the name of its sender."""
        for message in messages:
            stamped = msgspec.structs.replace(message, sent_ns=MissionClock().now_ns())
            self.session.put(self.keys.of(stamped), encode(stamped))

    def await_heard(self, kind: type[Said], count: int = 1) -> list[Said]:
        """Wait for messages of a kind from the UAV."""

        def enough() -> bool:
            for key, payload in self.inbox.wait(0.05):
                if payload and self.last in key:
                    self.heard.append(decode(key, payload))  # type: ignore[arg-type]
            return len([m for m in self.heard if isinstance(m, kind)]) >= count

        await_true(enough)
        return [message for message in self.heard if isinstance(message, kind)]

    def begin(self) -> None:
        """Start the mission now: a UAV that took seconds to start would have to land at once in one begun before."""
        await_true(lambda: bool(self.inbox.wait(0.05)))
        self.mission = msgspec.structs.replace(self.mission, epoch_ns=MissionClock().now_ns())
        self.session.put(self.keys.mission, encode(self.mission))
        self.await_heard(Fix)

    def imports_numpy(self) -> bool:
        """Return True if numpy is mapped into the UAV process."""
        return "numpy" in Path(f"/proc/{self.process.pid}/maps").read_text()

    def report(self, **fields: object) -> Report:
        """Return a report of the first UAV as head, with a quorum."""
        newest = self.heard[-1].slot
        quorum = self.mission.quorum
        grants = self.ranked[:quorum]
        return Report(head=self.first, slot=newest, term=1, status="planned", grants=grants, quorum=quorum, **fields)  # type: ignore[arg-type]

    def ask_again(self, *spans: Span) -> list[Answer]:
        """Request a retransmission from the UAV, as the recorder does."""
        key = self.keys.again(self.last, self.heard[0].instance)
        replies = self.session.get(key, payload=retransmission.encode(Ask(list(spans))), timeout=30)
        return [retransmission.decode_answer(reply.ok.payload.to_bytes()) for reply in replies if reply.ok is not None]

    def close(self) -> None:
        """End the mission; the UAV must end with status 0."""
        self.say(Event(source="operator", kind="end"))
        _, said = self.process.communicate(timeout=30)
        self.session.close()
        assert (self.process.returncode, said) == (0, b"")


@pytest.fixture
def bench(request: pytest.FixtureRequest, endpoint: str, tmp_path: Path) -> Iterator[Bench]:
    """Start one UAV on a bus of its own; the parameter is the size of the swarm."""
    made = Bench(endpoint, tmp_path, getattr(request, "param", 3))
    yield made
    made.process.kill()
    made.process.communicate()


def test_what_has_not_arrived_is_said_again_also_after_the_last_word(bench: Bench) -> None:
    """The UAV retransmits the same bytes, and no others, until the recorder wants no more."""
    bench.begin()
    key = bench.keys.fix(bench.last)
    fixes = bench.await_heard(Fix, 4)
    (answer,) = bench.ask_again(Span(key, 1, 2), Span(key, 1 << 40, 1 << 40))
    assert [(kept.key, kept.payload) for kept in answer.found] == [(key, encode(fix)) for fix in fixes[1:3]]
    assert answer.gone == [(key, 1 << 40)]
    bench.say(Event(source="operator", kind="end"))
    (closed,) = (event for event in bench.await_heard(Event) if event.kind == "closed")
    assert len(bench.ask_again(Span(key, 0, 0))) == 1
    assert bench.ask_again() == []
    assert bench.process.communicate(timeout=30) == (None, b"")
    assert closed.instance == fixes[0].instance


@pytest.mark.parametrize("bench", [8], indirect=True)
def test_imports_numpy_only_when_it_is_a_standby(bench: Bench) -> None:
    """A UAV alone in its container stays small until it may have to lead, as the first four by charge may at once."""
    bench.begin()
    bench.say(bench.report())
    bench.await_heard(Fix, 5)
    assert not bench.imports_numpy()
    bench.say(bench.report(standby=[bench.last]))
    await_true(bench.imports_numpy)
    bench.close()


def test_ends_in_order_while_it_loads_the_planner(endpoint: str, tmp_path: Path) -> None:
    """An interpreter that ended with a thread in OSQP would abort, four times of five."""
    bench = Bench(endpoint, tmp_path, module="tests.processes.loading")
    bench.begin()
    await_true(lambda: "osqp" in Path(f"/proc/{bench.process.pid}/maps").read_text())
    bench.await_heard(Fix, 4)
    bench.close()


def test_queries_for_tokens_are_bounded_per_slot(endpoint: str, tmp_path: Path) -> None:
    """Forty heads within a slot or a few, as in a backlog: the UAV follows them all, and asks for few of their tokens.

    In the next slot it watches the last one.
    """
    bench, changes = Bench(endpoint, tmp_path, module="tests.processes.asking", slot_s=4.0), 40
    bench.begin()
    for term in range(1, changes + 1):
        head = bench.second if term % 2 else bench.first
        bench.say(msgspec.structs.replace(bench.report(), head=head, term=term))
    await_true(lambda: bench.await_heard(Fix)[-1].term == changes)
    last = bench.await_heard(Fix)[-1].slot
    await_true(lambda: bench.await_heard(Fix)[-1].slot > last)
    fixes = bench.await_heard(Fix)
    bench.say(Event(source="operator", kind="end"))
    _, said = bench.process.communicate(timeout=30)
    bench.session.close()
    asked, slots = said.decode().split(), {fix.slot for fix in fixes}
    assert len({fix.term for fix in fixes}) > MAX_QUERIES * len(slots), "it has more heads than it may ask for"
    assert len(asked) <= MAX_QUERIES * len(slots)
    assert asked[-1] == bench.keys.alive(bench.first, "*")


def test_a_uav_of_another_claimant_leaves(bench: Bench) -> None:
    """The operator has issued its id to another claimant during its absence: it must publish nothing."""
    claimants = tuple("a" * 16 if entry.uav == bench.last else "" for entry in bench.mission.roster)
    await_true(lambda: bool(bench.inbox.wait(0.05)))
    bench.session.put(bench.keys.mission, encode(msgspec.structs.replace(bench.mission, claimants=claimants)))
    _, said = bench.process.communicate(timeout=30)
    assert bench.process.returncode == 2
    assert f"uav = '{bench.last}'" in said.decode()
    assert not [key for key, payload in bench.inbox.wait(0.05) if payload and bench.last in key]
    bench.session.close()


def test_bad_bytes_are_counted_told_now_and_then_and_dropped(bench: Bench) -> None:
    """A thousand malformed messages make ten events and no crash."""
    bench.begin()
    for number in range(1000):
        garbage = b"\xff{garbage" + str(number).encode()
        bench.session.put(bench.keys.report(bench.first), garbage, congestion_control=zenoh.CongestionControl.BLOCK)
    bench.session.put(bench.keys.event("operator"), b"[" * 100_000)
    events = [event for event in bench.await_heard(Event, 11) if event.kind == "malformed"]
    assert [int(event.detail.split()[0]) for event in events[:10]] == [2**power for power in range(10)]
    bench.await_heard(Fix, len(bench.await_heard(Fix)) + 3)
    bench.close()
